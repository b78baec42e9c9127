"""Pullbacks of runs of a Schrödinger equation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from liouville._runs.adjoint import Adjoint, Gradients
from liouville._runs.edges import Kink
from liouville._runs.kinks import Kinks, directions, kink_of_drive
from liouville._runs.tangents import PARAMS
from liouville._runs.waves.derivative import direction_row, places_of
from liouville._solution.solution import Solution
from liouville._systems.mechanics.branches import branches

if TYPE_CHECKING:
    from liouville._runs.waves.wave import WaveRunner


class WaveAdjoint(Adjoint):
    """The transposed derivative of a run of a Schrödinger equation; see :class:`Adjoint`."""

    runner: WaveRunner
    is_complex = True
    holds_run = True

    def __init__(self, runner: WaveRunner, names: tuple[str, ...], member: int = 0) -> None:
        self.runner, self._member = runner, member
        places = places_of(runner.system)
        self.directions = {name: (places[name][1], name == "psi") for name in names}
        moves = any(name.startswith(PARAMS) for name in names)
        if moves and branches(runner.system.sensitivity) is not None:
            self.kinks = Kinks(self._first_kink)

    def _first_kink(self) -> Kink | None:
        system, shapes = self.runner.system, {x: shape for x, (shape, _) in self.directions.items()}
        row = direction_row(system, directions(shapes))
        return kink_of_drive(self.runner, row[None])

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shape of what has cotangents."""
        return {"psi": solution.states["psi"].shape}

    def pulled(self, solution: Solution, cotangents: Mapping[str, np.ndarray]) -> Gradients:
        """Return gradients from cotangents of psi; see :class:`Adjoint`."""
        rows = cotangents["psi"].reshape(len(solution.t), -1)
        derivative = self.runner.derivative(self.wrt, self._member)
        kept = np.cumsum([0, *(steps for _, steps in self.runner.plan.stops)])
        self.check(int(np.max(kept[rows.any(axis=1)], initial=0)))
        found = derivative.pulled(rows, self.wrt)
        return {name: x if x.ndim else float(x) for name, x in found.items()}

    def moved(self, directions: Mapping[str, np.ndarray], size: float) -> Mapping[str, np.ndarray]:
        """Return psi of the run with all choices held, moved by so much of all directions."""
        row = direction_row(self.runner.system, directions)
        return {"psi": self.runner.derivative(self.wrt, self._member).repeated(row, size)}
