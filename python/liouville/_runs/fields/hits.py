r"""Derivatives of the events of a field's run: of their times, and of the states there.

A run knows the derivatives of a state at a time that is held, and by that time. The function g of
an event is zero there, so that

.. math::

    dt = -\frac{g_x \cdot dx + g_\theta\, d\theta}{g_t + g_x \cdot \dot x}, \qquad
    dx(t) = dx + \dot x\, dt .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liouville import _core
from liouville._basics.errors import IntegrationError, hinted
from liouville._solution.points import Points

#: A part of a step on either side of a zero, and by which part of themselves slopes may differ.
NEAR, BENDS = 2.0**-14, 1e-6


@dataclass(frozen=True)
class Hits:
    """The hits of an event.

    Attributes
    ----------
    points : Points
        Their times and states.
    held : ndarray, shape (k, d, n)
        Derivatives of the states at times that are held, in d directions.
    rate : ndarray, shape (k, n)
        The derivative by the time.
    members : ndarray or None
        Which members of an ensemble met them.
    of_time, of_x, of_params : ndarray, shapes (k,), (k, n) and (k, P)
        The derivatives of the event's function.
    bends : ndarray of bool, shape (k,)
        Whether they are others on either side of the zero.
    """

    points: Points
    held: np.ndarray
    rate: np.ndarray
    members: np.ndarray | None
    of_time: np.ndarray
    of_x: np.ndarray
    of_params: np.ndarray
    bends: np.ndarray

    @classmethod
    def of(
        cls,
        points: Points,
        rows: np.ndarray,
        members: np.ndarray | None,
        slopes: _core.Tape,
        params: np.ndarray,
        h: float,
    ) -> Hits:
        """Return hits with what the core keeps beside them, and the slopes of the function.

        Of an ensemble `params` has a row for each member, or one for all; h is the step.
        """
        x = points.states["x"]
        count, n = x.shape
        each = rows.reshape(count, rows.shape[-1] // n, n)
        rate = each[:, -1]
        own = np.zeros(count, dtype=int) if members is None or len(params) == 1 else members

        def beside(steps: float) -> np.ndarray:
            """Return the slopes so many small parts of a step after the hits."""
            t, y = points.t[:, None] + steps * NEAR * h, x + steps * NEAR * h * rate
            found = np.empty((count, 1 + n + params.shape[-1]))
            for member in np.unique(own):
                at = own == member
                args = [np.ascontiguousarray(part[at]) for part in (t, y)]
                found[at] = slopes.map(params[member], args)
            return found

        def side(way: int) -> np.ndarray:
            """Return the slopes of one side, in units of how fast the function changes there."""
            near, far = (_over_change(beside(k * way), rate) for k in (1, 2))
            found: np.ndarray = 2 * near - far
            return found

        found, (left, right) = beside(0), (side(-1), side(1))
        bends = np.abs(left - right).max(axis=1) > BENDS * np.abs(right).max(axis=1)
        return cls(
            points, each[:, :-1], rate, members, found[:, 0], found[:, 1 : 1 + n],
            found[:, 1 + n :], bends,
        )  # fmt: skip

    def _fall(self, name: str) -> np.ndarray:
        """Return how fast the function changes along the motion.

        Raises
        ------
        IntegrationError
            It does not, or bends, at one of them.
        """
        found: np.ndarray = self.of_time + np.einsum("ki,ki->k", self.of_x, self.rate)
        is_flat = ~(np.abs(found) > 0)
        bad = np.flatnonzero(is_flat | self.bends)
        if bad.size:
            t, does = float(self.points.t[bad[0]]), "is flat" if is_flat[bad[0]] else "bends"
            sentence = f"the function of event '{name}' {does} at t = {t:g}, where it is zero"
            hint = "its time has no derivative there: write a function that is smooth at its zero"
            raise IntegrationError(hinted(sentence, hint), t=t)
        return found

    def moved(self, name: str, params: np.ndarray) -> Points:
        """Return the derivatives of times and states, with those of parameters, shape (d, P)."""
        along = np.einsum("kdi,ki->kd", self.held, self.of_x) + self.of_params @ params.T
        t = -along / self._fall(name)[:, None]
        x = self.held + t[..., None] * self.rate[:, None]
        own = {} if self.members is None else {"member": self.members}
        return Points(t, {"x": x, **own})

    def pulled(self, name: str, t: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cotangents of the states at held times, and those of parameters, from both."""
        falls = -(t + np.einsum("ki,ki->k", x, self.rate)) / self._fall(name)
        return x + falls[:, None] * self.of_x, falls @ self.of_params


def _over_change(slopes: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return slopes by (t, x, params) over the rate at which they make a function change."""
    change = slopes[:, 0] + np.einsum("ki,ki->k", slopes[:, 1 : 1 + rate.shape[1]], rate)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: np.ndarray = slopes / change[:, None]
    return found
