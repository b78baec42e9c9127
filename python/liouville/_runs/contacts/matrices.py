"""Matrices of contacts at a state, and coefficients of their laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liouville._runs.contacts.complementarity import Array

EPS, TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)

#: A gap is closed within this part of the sizes of its terms, or so many roundings of its time: as
#: many as an event may be off zero where a stretch starts, beyond which it is met as a hit.
CLOSED, ROUNDINGS = 1e-12, 512
#: Slips are zero within this part of the sizes of their terms, rates within the second.
AT_REST, STILL = 1e-9, 1e-13


def of_contacts(slips: Array, owner: Array) -> Array:
    """Return the sizes of slips, or of friction, by contact."""
    if len(owner) == owner[-1] + 1:  # one of each
        return np.abs(slips)
    found = np.zeros(owner[-1] + 1)
    np.hypot.at(found, owner, slips)
    return found


@dataclass(frozen=True)
class Laws:
    """Coefficients of contacts at some parameters: restitution, sliding and static friction."""

    restitution: Array
    friction: Array
    static: Array

    def check(self, names: tuple[str, ...]) -> None:
        """Refuse what functions of the parameters must not give."""
        for k, name in enumerate(names):
            what = f"of contact '{name}' must be"
            if not 0 <= self.restitution[k] <= 1:
                raise ValueError(f"restitution {what} from 0 to 1, not {self.restitution[k]:g}")
            if not 0 <= self.friction[k] < np.inf:
                raise ValueError(f"friction {what} zero or positive, not {self.friction[k]:g}")
            if not self.friction[k] <= self.static[k] < np.inf:
                least = f"at least friction = {self.friction[k]:g}"
                raise ValueError(f"static_friction {what} {least}, not {self.static[k]:g}")


@dataclass(frozen=True)
class Matrices:
    r"""Matrices of contacts at a state, bilateral constraints eliminated.

    With :math:`W` the inverse mass on the motions that these leave, rates :math:`\dot\varphi` and
    accelerations without contact forces :math:`b`, of gaps first and of slips behind them,

    .. math:: (\ddot\varphi, \dot s) = A\, (N, T) + b .

    Attributes
    ----------
    gap, rate, slip : ndarray, shapes (c,), (c,), (s,)
        The gaps, their rates and the slips: one of a contact, or two in space.
    size : ndarray, shape (c,)
        Sizes of the terms of the gaps, whose roundings the gaps have: what they change by over the
        largest coordinate, and over the way of a step from there.
    way, speed : float
        That coordinate and way; the largest velocity, and what a step adds to it.
    A, b : ndarray, shape (c + s, c + s) and (c + s,)
        As above.
    moves : ndarray, shape (n, c + s)
        How a unit of each N and T changes z'.
    free, v : ndarray, shape (n,)
        z' without contact forces, and y'.
    v_z : ndarray, shape (n, n)
        The derivative of y' by z.
    rows : ndarray, shape (c + s + b, n)
        Derivatives of all rates, those of the bilateral constraints first, by z.
    laws : Laws
        The coefficients.
    pull : float
        The largest acceleration without contact forces, and by friction of those given.
    load, is_pressed : ndarray, shape (c,)
        Normal forces that are given, and which are.
    owner : ndarray of int, shape (s,)
        The contact of each slip.
    """

    gap: Array
    rate: Array
    slip: Array
    size: Array
    way: float
    speed: float
    A: Array
    b: Array
    moves: Array
    free: Array
    v: Array
    v_z: Array
    rows: Array
    laws: Laws
    pull: float
    load: Array
    is_pressed: Array
    owner: Array

    @property
    def sizes(self) -> Array:
        """Sizes of the terms of rates, and of slips behind them."""
        found: Array = np.abs(self.rows[-len(self.b) :]).sum(axis=1) * self.speed
        return found

    @property
    def still(self) -> Array:
        """The rates of gaps that are zero by roundoff."""
        found: Array = STILL * self.sizes[: len(self.gap)]
        return found
