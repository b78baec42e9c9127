"""The part of solutions that measures how far invariants have moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import check_name

Array = NDArray[Any]

#: An energy that starts below this part of the kinetic energy is a zero with roundoff.
ZERO = 1e-12


class Drifts:
    """A base of :class:`Solution`: drifts of its invariants, in units of their own sizes."""

    states: dict[str, Array]
    invariants: dict[str, Array]
    initial: dict[str, Any]

    def invariant_drift(self, name: str) -> Array:
        r"""Measure how far an invariant has moved from its start, :math:`|I(t) - I(0)| / |I(0)|`.

        The start is that of the run, whatever was kept of it. An energy that starts at zero but for
        roundoff, :math:`|E(0)| \le 10^{-12} T`, is measured by :math:`T`, the largest kinetic
        energy :math:`|v^T p| / 2` of the kept steps and coordinates. The drift is the absolute
        one, :math:`|I(t) - I(0)|`, of any other invariant that moves further than it was from zero
        at the start, since it has no size to compare with. No unit of the model matters.

        Parameters
        ----------
        name : str
            One of ``solution.invariants``.

        Returns
        -------
        ndarray, shape (k,) or (k, P)
            The drift; where :meth:`is_drift_absolute` says so, in the system's units.

        Raises
        ------
        ValueError
            The solution has no invariant of that name.
        """
        unit, _, _ = self._unit(name)
        drift: Array = self._distance(name) / unit
        return drift

    def is_drift_absolute(self, name: str) -> Array:
        r"""Say whether a drift is absolute, since the start is zero to roundoff; () or (P,)."""
        return self._unit(name)[1]

    def drift_words(self, name: str) -> str:
        """Say what a drift is measured by where it is not the start: ", absolute", else empty."""
        _, is_absolute, is_kinetic = self._unit(name)
        words = {"absolute": is_absolute, "relative to the kinetic": is_kinetic}
        return "".join(
            f", {word}" + ("" if of.all() else f" of {of.sum()} members")
            for word, of in words.items()
            if of.any()
        )

    def _distance(self, name: str) -> Array:
        start = self._start(name)
        distance: Array = np.abs(self.invariants[name] - start)
        return distance

    def _unit(self, name: str) -> tuple[Array, Array, Array]:
        """Return the size that a drift is measured by, and whether it is 1 or the kinetic one."""
        start = np.abs(self._start(name)[0])
        kinetic: Array | None = self._kinetic() if name == "energy" else None
        if kinetic is None:
            kinetic, is_zero = np.zeros_like(start), start < _largest(self._distance(name))
        else:
            is_zero = start <= ZERO * kinetic
        is_kinetic = np.asarray(is_zero & (kinetic > 0))
        is_absolute = np.asarray((is_zero | (start == 0)) & ~is_kinetic)
        unit = np.where(is_kinetic, kinetic, np.where(is_absolute, 1.0, start))
        return unit, is_absolute, is_kinetic

    def _kinetic(self) -> Array | None:
        """Return the largest kinetic energy of the kept steps of each member; None without p."""
        if not {"v", "p"} <= self.states.keys():
            return None
        products = np.sum(self.states["v"] * self.states["p"], axis=-1)
        return _largest(np.abs(products) / 2)

    def _start(self, name: str) -> Array:
        """Return an invariant at the start of the run, shape (1,) or (1, P)."""
        check_name(name, self.invariants, "invariant")
        if name not in self.initial:
            return self.invariants[name][:1]
        return np.asarray(self.initial[name], dtype=float)[None]


def worst(words: str, sizes: Mapping[str, float]) -> list[str]:
    """Return the largest of some sizes with its name, of none nothing."""
    if not sizes:
        return []
    name = list(sizes)[int(np.argmax(list(sizes.values())))]  # a NaN counts as the largest
    return [f"{words} {sizes[name]:.1e} ({name})"]


def _largest(sizes: Array) -> Array:
    """Return the largest of all kept steps, which may be NaN where a member has failed."""
    largest: Array = np.fmax.reduce(sizes, axis=0, initial=0.0)
    return largest
