"""A contact, as a user gives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from liouville._basics.errors import hinted

#: A coefficient of a law, or a function of the parameters.
Coefficient = float | Callable[[Any], Any]


class Mode(IntEnum):
    """Mode of a contact: open, closed, slipping up or down, sticking, or sliding in space."""

    OPEN = 0
    CLOSED = 1
    SLIP_UP = 2
    SLIP_DOWN = 3
    STICK = 4
    SLIDE = 5

    @property
    def sign(self) -> int:
        """The sign of the slip, 0 where there is none or where it has two directions."""
        return (self is Mode.SLIP_UP) - (self is Mode.SLIP_DOWN)

    @property
    def slips(self) -> bool:
        """Whether there is a slip."""
        return self in (Mode.SLIP_UP, Mode.SLIP_DOWN, Mode.SLIDE)


@dataclass(frozen=True)
class Contact:
    r"""A unilateral contact: a gap that does not become negative, with impacts and dry friction.

    .. math::

        \varphi(t, q) \ge 0, \quad N \ge 0, \quad N \varphi = 0, \qquad
        |T| \le \mu_s N \ (s = 0), \quad T = -\mu N s / |s| \ (s \ne 0)

    The contact adds the forces :math:`\varphi_q^T N + s_v^T T`. In each of its modes it is a smooth
    system with constraints, so nothing is regularised: gaps are zero to roundoff while it is
    closed, and what sticks does not creep. At an impact compression and expansion follow Poisson's
    law: the impulses of the expansion are `restitution` times those of the compression.

    Parameters
    ----------
    gap : callable, optional
        ``gap(t, q, params)``, a scalar: the distance, negative where bodies would overlap.
    restitution : float or callable, default 0
        From 0 (no rebound) to 1; this and the next may be functions of the parameters.
    friction : float or callable, default 0
        The coefficient :math:`\mu` of sliding friction.
    static_friction : float or callable, optional
        The coefficient :math:`\mu_s` of what sticks, at least `friction`; `friction` by default.
    slip : callable, optional
        ``slip(t, q, v, params)``, the velocity along the contact, affine in v: a scalar, or of
        friction in space two, along directions at a right angle. Friction needs it.
    load : float or callable, optional
        In the place of a gap the normal force, zero or positive, ``load(t, q, params)`` or a
        number: a brake, or dry friction of a joint, that is pressed at all times.

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind, or out of range.

    References
    ----------
    :cite:t:`glocker2001`; :doc:`/theory/contacts`.

    Examples
    --------
    >>> import casadi as ca
    >>> import liouville as lv
    >>> block = lv.Lagrangian(
    ...     lambda t, q, v, params: ca.sumsqr(v) / 2 - 9.81 * q[1],
    ...     q=("x", "y"),
    ...     contacts={
    ...         "floor": lv.Contact(
    ...             lambda t, q, params: q[1], friction=0.5, slip=lambda t, q, v, params: v[0]
    ...         )
    ...     },
    ... )
    >>> run = lv.integrate(block, lv.Spark(2), t=(0, 1), h=0.1, q=[0.0, 0.0], v=[2.0, 0.0])
    >>> f"{run.q[-1, 0]:.6f}"  # v^2 / (2 mu g)
    '0.407747'
    >>> run.contacts["floor"].changes[-1].kind
    'stick'
    """

    gap: Callable[..., Any] | None = None
    restitution: Coefficient = 0.0
    friction: Coefficient = 0.0
    static_friction: Coefficient | None = None
    slip: Callable[..., Any] | None = None
    load: float | Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        """Refuse what makes no contact."""
        if (self.gap is None) == (self.load is None):
            raise TypeError(
                f"a contact has a gap or a load, not {'both' if self.gap else 'neither'}"
            )
        for what, function in (("gap", self.gap), ("slip", self.slip)):
            if function is not None and not callable(function):
                raise TypeError(f"{what} must be a function, not {function!r}")
        for what in ("restitution", "friction", "static_friction"):
            value = getattr(self, what)
            if value is not None and not callable(value):
                check_number(what, value)
        check_restitution(self.restitution)
        least, most = self.friction, self.largest
        if not (callable(least) or callable(most) or least <= most):
            raise ValueError(f"static_friction must be at least friction = {least:g}, not {most!r}")
        if self.load is not None:
            self._check_load()
        if self.is_rough and self.slip is None:
            sentence = "a contact with friction needs slip=, the velocity along it"
            raise TypeError(hinted(sentence, "slip=lambda t, q, v, params: v[0] of a block on x"))

    def _check_load(self) -> None:
        if not callable(self.load):
            check_number("load", self.load)
        if callable(self.restitution) or self.restitution or not self.is_rough:
            raise ValueError("a contact with a load has friction, and no restitution")

    @property
    def largest(self) -> Coefficient:
        """The coefficient of friction where the contact sticks."""
        return self.friction if self.static_friction is None else self.static_friction

    @property
    def is_rough(self) -> bool:
        """Whether there is friction, as far as numbers say."""
        return callable(self.largest) or self.largest > 0


def check_number(what: str, value: Any) -> None:
    """Refuse what is no coefficient."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{what} must be a number, not {value!r}")
    if not 0 <= value < float("inf"):
        raise ValueError(f"{what} must be zero or positive, not {value!r}")


def check_restitution(value: Any) -> None:
    """Refuse what is no restitution; functions of the parameters pass."""
    if callable(value):
        return
    check_number("restitution", value)
    if value > 1:
        raise ValueError(f"restitution must be from 0 to 1, not {value!r}")
