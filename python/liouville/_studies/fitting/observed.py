"""Functions of states that are measured, with their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._solution.solution import Solution
from liouville._studies.fitting.measurements import System
from liouville.analysis.point import Array


class Observed:
    """Measured quantities of a motion: states, multipliers, and functions of states.

    Attributes
    ----------
    places : dict of str to tuple of str
        The names of the entries of each quantity, by its name, in the order of the columns.
    """

    def __init__(self, system: System, functions: Mapping[str, Callable[..., Any]] | None) -> None:
        self.system = system
        known = {"t", *system.places, *(x for own in system.places.values() for x in own)}
        for name in functions or ():
            if name in known:
                what = "the time" if name == "t" else "a state, or of an entry of one"
                sentence = f"observed '{name}' has the name of {what}"
                raise ValueError(hinted(sentence, "call it otherwise, in the data too"))
        self._tape, widths = system.measured(functions or {})
        self._width = sum(widths.values())
        own = {
            name: (name,) if width == 1 else tuple(f"{name}[{k}]" for k in range(width))
            for name, width in widths.items()
        }
        self.places = {**system.places, **own}

    @property
    def labels(self) -> list[str]:
        """A name for each column: of its entry, with its state where another has that too."""
        found: list[str] = []
        for state, own in self.places.items():
            found += [f"{state}[{x}]" if x in found else x for x in own]
        return found

    def of(self, run: Solution, values: Array) -> Array:
        """Return all quantities of all records side by side, shape (k, w)."""
        states = [run.states[name] for name in self.system.places]
        return np.concatenate([*states, self._mapped(run, values)[:, : self._width]], axis=1)

    def slopes(
        self, run: Solution, values: Array, along: Mapping[str, Array], of_params: Array
    ) -> Array:
        """Return derivatives of all quantities in d directions, shape (k, d, w).

        `along` has those of the states by name, each of shape (k, d, n), `of_params` those of the
        parameters, shape (d, P). That of a function g is g_y dy + g_z dz + g_lam dlam + g_theta
        dtheta. Multipliers without derivatives, and functions of these, have NaN.
        """
        k, d = next(iter(along.values())).shape[:2]
        moved = {
            name: along[name] if name in along else np.full((k, d, len(own)), np.nan)
            for name, own in self.system.places.items()
        }
        names = [*self.system.states, *self._lam]
        moves = [*(moved[x] for x in names), np.broadcast_to(of_params, (k, *of_params.shape))]
        ends = np.cumsum([x.shape[2] for x in moves])
        by = self._mapped(run, values)[:, self._width :].reshape(k, ends[-1], self._width)
        # what a function does not depend on needs no derivative
        terms = []
        for x, own in zip(moves, np.split(by, ends[:-1], axis=1), strict=True):
            depends = np.asarray(own.any(axis=1))[:, None]
            terms.append(np.where(depends, np.einsum("kdi,kiw->kdw", x, own), 0.0))
        return np.concatenate([*moved.values(), np.sum(terms, axis=0)], axis=2)

    @property
    def _lam(self) -> list[str]:
        """The name of the multipliers, where the system has a state that is called so."""
        return ["lam"] if "lam" in self.system.places else []

    def _mapped(self, run: Solution, values: Array) -> Array:
        states = [run.states[name] for name in (*self.system.states, *self._lam)]
        states += [] if self._lam else [np.empty((len(run.t), 0))]
        args = [np.ascontiguousarray(x) for x in (run.t[:, None], *states)]
        found: Array = self._tape.map(values, args)
        return found
