"""Pullbacks of runs of a Schrödinger equation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._runs.adjoint import OBSERVED, Adjoint, Gradients
from liouville._runs.edges import Kink
from liouville._runs.kinks import Kinks, directions, kink_of_drive
from liouville._runs.tangents import PARAMS
from liouville._runs.waves.derivative import direction_row, places_of
from liouville._solution.solution import Solution
from liouville._systems import Schrodinger
from liouville._systems.mechanics.branches import branches
from liouville._systems.waves.forms import of_states

if TYPE_CHECKING:
    from liouville._runs.waves.wave import WaveRunner


class WaveAdjoint(Adjoint):
    """The transposed derivative of a run of a Schrödinger equation; see :class:`Adjoint`."""

    runner: WaveRunner
    is_complex = True
    holds_run = True

    def __init__(self, runner: WaveRunner, names: tuple[str, ...], member: int = 0) -> None:
        self.runner, self._member = runner, member
        places = places_of(runner.system, len(runner.times))
        self.directions = {name: (places[name][1], name == "psi") for name in names}
        moves = any(name.startswith(PARAMS) for name in names)
        if moves and branches(runner.system.sensitivity) is not None:
            self.kinks = Kinks(self._first_kink)

    def _first_kink(self) -> Kink | None:
        system, shapes = self.runner.system, {x: shape for x, (shape, _) in self.directions.items()}
        row = direction_row(system, directions(shapes), len(self.runner.times))
        return kink_of_drive(self.runner, row[None])

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents: psi, and what was asked to be observed."""
        names = self.runner.observed
        found = {f"{OBSERVED}{name}": solution.observed[name].shape for name in names}
        return {"psi": solution.states["psi"].shape, **found}

    def pulled(self, solution: Solution, cotangents: Mapping[str, np.ndarray]) -> Gradients:
        """Return gradients from cotangents of psi and of observables; see :class:`Adjoint`."""
        rows = cotangents["psi"].reshape(len(solution.t), -1)
        for name, parts in self.runner.observed.items():
            own = cotangents[f"{OBSERVED}{name}"]
            if own.any():
                _check_real(name, own, solution.observed[name])
                rows = rows + of_observed(self.runner.system, parts, own, solution.states["psi"])
        derivative = self.runner.derivative(self.wrt, self._member)
        kept = np.cumsum([0, *(steps for _, steps in self.runner.plan.stops)])
        self.check(int(np.max(kept[rows.any(axis=1)], initial=0)))
        found = derivative.pulled(rows, self.wrt, solution.states["psi"])
        return {name: x if x.ndim else float(x) for name, x in found.items()}

    def moved(self, directions: Mapping[str, np.ndarray], size: float) -> Mapping[str, np.ndarray]:
        """Return psi of the run with all choices held, moved by so much of all directions."""
        row = direction_row(self.runner.system, directions, len(self.runner.times))
        return {"psi": self.runner.derivative(self.wrt, self._member).repeated(row, size)}


def _check_real(name: str, cotangents: np.ndarray, observed: np.ndarray) -> None:
    """Refuse complex cotangents of an observable that is real."""
    if cotangents.imag.any() and observed.dtype.kind != "c":
        sentence = f"the cotangent of '{name}' must be an array of real numbers"
        raise TypeError(f"{sentence}, as the observable is one, not of complex ones")


def of_observed(
    system: Schrodinger, parts: list[tuple[Any, ...]], cotangents: np.ndarray, psi: np.ndarray
) -> np.ndarray:
    """Return cotangents of states from those of an observable, 2 A psi and phi times them.

    An A that is not Hermitian has two parts, whose values are real and imaginary ones.
    """
    inward = system.frame.inward(psi)
    found = np.zeros_like(inward)
    for own, (kind, *core) in zip((cotangents.real, cotangents.imag), parts, strict=False):
        if kind == "overlap":
            re, im = core
            found += np.outer(cotangents, re + 1j * im)
        elif kind == "diagonal":
            found += 2 * own[:, None] * core[0] * inward
        else:
            found += 2 * own[:, None] * of_states(core[0].multiply, core[0].size, inward)
    return system.outward(found)
