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

    def of(self, run: Solution, values: Array) -> Array:
        """Return all quantities of all records side by side, shape (k, w)."""
        states = [run.states[name] for name in self.system.places]
        return np.concatenate([*states, self._mapped(run, values)[:, : self._width]], axis=1)

    def slopes(
        self, run: Solution, values: Array, along: Mapping[str, Array], of_params: Array
    ) -> Array:
        """Return derivatives of all quantities in d directions, shape (k, d, w).

        `along` has those of the states by name, each of shape (k, d, n), `of_params` those of the
        parameters, shape (d, P). That of a function g is g_y dy + g_z dz + g_θ dθ. Multipliers
        without derivatives have NaN.
        """
        k, d = next(iter(along.values())).shape[:2]
        first, second = self.system.states
        params = np.broadcast_to(of_params, (k, *of_params.shape))
        moves = np.concatenate([along[first], along[second], params], axis=2)
        by = self._mapped(run, values)[:, self._width :].reshape(k, moves.shape[2], self._width)
        states = [
            along[name] if name in along else np.full((k, d, len(own)), np.nan)
            for name, own in self.system.places.items()
        ]
        return np.concatenate([*states, np.einsum("kdi,kiw->kdw", moves, by)], axis=2)

    def _mapped(self, run: Solution, values: Array) -> Array:
        y, z = (run.states[name] for name in self.system.states)
        args = [np.ascontiguousarray(x) for x in (run.t[:, None], y, z)]
        found: Array = self._tape.map(values, args)
        return found
