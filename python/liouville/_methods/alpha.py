"""The alpha family: methods of second order that damp fast oscillations."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

from liouville._basics.arguments import number
from liouville._methods.brief import Brief
from liouville._methods.spark import NEWTON_TOL_HELP, check_newton_tol

Coefficients = tuple[float, float, float, float]

#: The reactions of a step differ by 1 - 2b, and roundoff in them grows as its inverse.
LEAST_GAP = 0.01

_B = "weight of the last reaction of a step in the positions, not 1/2"
_RHO = "spectral radius at infinity, from 0 (damps most) to 1 (not at all)"
_LESS_IMPLICIT = "take the reaction at a predicted position"


@dataclass(frozen=True, repr=False)
class HHT(Brief):
    r"""Extended HHT-alpha method for constrained mechanics, order 2.

    A step of size h from :math:`(y_0, z_0, a_0)`, with
    :math:`\varphi := M^{-1} (f - p_t - p_y z)` and :math:`M := p_z`:

    .. math::

        y_1 &= y_0 + h z_0 + h^2 \left((\tfrac12 - \beta) a_0 + \beta a_1\right)
            + \tfrac{h^2}2 \left((1 - b) A_0 + b A_1\right) \\
        z_1 &= z_0 + h \left((1 - \gamma) a_0 + \gamma a_1\right) + \tfrac h2 (A_0 + A_1) \\
        a_1 &= (1 + \alpha)\, \varphi(t_1, y_1, z_1) - \alpha\, \varphi(t_0, y_0, z_0) \\
        M(t_0, y_0)\, A_0 &= r(t_0, y_0, \Psi_0), \qquad M(t_1, Y)\, A_1 = r(t_1, Y, \Psi_1) \\
        0 &= g(t_1, y_1), \qquad 0 = g_t(t_1, y_1) + g_y(t_1, y_1)\, z_1

    where :math:`\gamma = \frac12 - \alpha`, :math:`\beta = \frac14 (1 - \alpha)^2`, and
    :math:`Y = y_1`, or :math:`y_0 + h z_0` in the less implicit variant. The method's
    :math:`a_n \approx \varphi(t_n + \alpha h)` leaves the reactions out.

    Order 2 in positions, velocities and multipliers, which are solved for at the output points.
    Keeps both constraints to roundoff. Stable for every stiff force, and damps what oscillates
    fast: such a mode loses the factor :math:`\rho = (1 + \alpha) / (1 - \alpha)` in a step,
    0.90 for :math:`\alpha = -0.05`, 0.82 for -0.1, 0.5 for -1/3. With :math:`\alpha = 0` it is
    Newmark's method of average acceleration, the trapezoidal rule, which damps nothing. It is
    neither symmetric nor symplectic. Takes large sparse systems, and controls its steps where
    ``rtol=`` is given: on conservative systems by reversible steps, which keep the energy as equal
    ones do.

    Needs a velocity z of its own, :math:`v(t, y, z) = z`, and a momentum linear in it: a
    ``Lagrangian`` quadratic in the velocity, or a ``Mechanical`` system of that form.

    Parameters
    ----------
    alpha : float, default -0.1
        From -1/3, which damps most, to 0, which damps nothing.
    b : float, default 1/3
        Weight of :math:`A_1` in the positions. With 1/3 the reactions add nothing to the leading
        error of y; near 1/2 they cannot be separated. Modes that taut constraints keep stiff are
        stable for :math:`h \omega < 2 / \sqrt{1 - 2 b}`, and for every h with b above 1/2.
    less_implicit : bool, default False
        Take :math:`A_1` at :math:`Y = y_0 + h z_0`, which is known before the step; order 2 too.
    newton_tol : float, optional
        Corrections of the equations of a step that are expected to be below this fraction of the
        positions and velocities are not made; at most 0.01. By default it is roundoff, and a tenth
        of ``rtol=`` where errors control the steps one by one. Both constraints hold to roundoff
        all the same: the end of each step is moved onto them.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`jay2007hht`, after :cite:t:`hilber1977` and :cite:t:`newmark1959`; see
    :doc:`/theory/hht`.

    Examples
    --------
    >>> import liouville as lv
    >>> structure = lv.Structure([1.0], [[1.0]])
    >>> run = lv.integrate(structure, lv.HHT(-0.3), t=(0, 10), h=0.1, q=[1.0], v=[0.0])
    >>> f"{run.dissipated[-1]:.2e}"  # of an energy of 0.5
    '2.29e-04'
    """

    form: ClassVar[str] = "second order"
    order: ClassVar[int] = 2
    alpha: float = field(default=-0.1, metadata={"help": "from -1/3 (damps most) to 0 (nothing)"})
    b: float = field(default=1 / 3, metadata={"help": _B})
    less_implicit: bool = field(default=False, metadata={"help": _LESS_IMPLICIT})
    newton_tol: float | None = field(default=None, metadata={"help": NEWTON_TOL_HELP})

    def __post_init__(self) -> None:
        """Refuse numbers that make no method."""
        if not -1 / 3 <= number("alpha must be a number", self.alpha) <= 0:
            raise ValueError(
                f"alpha must be from -1/3 to 0, not {self.alpha:g}: above 0 the method is "
                "unstable, below -1/3 it damps fast oscillations less again"
            )
        _check_reactions(self.b, self.less_implicit)
        check_newton_tol(self.newton_tol)

    @property
    def coefficients(self) -> Coefficients:
        r""":math:`\alpha_m, \alpha_f, \gamma, \beta` in the notation of the whole family."""
        return _second_order(0.0, -float(self.alpha))

    @property
    def reaction(self) -> str:
        """How the reactions enter: "extended", or "predicted" if less implicit."""
        return "predicted" if self.less_implicit else "extended"


@dataclass(frozen=True, repr=False)
class GeneralizedAlpha(Brief):
    r"""Extended generalised-alpha method for constrained mechanics, order 2.

    As :class:`HHT`, but for

    .. math::

        (1 - \alpha_m)\, a_1 + \alpha_m a_0
            = (1 - \alpha_f)\, \varphi(t_1, y_1, z_1) + \alpha_f\, \varphi(t_0, y_0, z_0)

    with :math:`\alpha_m = \frac{2 \rho - 1}{\rho + 1}`, :math:`\alpha_f = \frac{\rho}{\rho + 1}`,
    :math:`\gamma = \frac12 - \alpha_m + \alpha_f`,
    :math:`\beta = \frac14 (1 - \alpha_m + \alpha_f)^2`, and
    :math:`a_n \approx \varphi(t_n + (\alpha_m - \alpha_f) h)`.

    A mode that oscillates fast loses the factor :math:`\rho` in a step; of all methods of this
    kind with that :math:`\rho`, this one damps slow modes least. What it keeps and what it needs
    of the system is as for :class:`HHT`.

    Parameters
    ----------
    rho : float, default 0.8
        Spectral radius at infinity, from 0, where a fast mode is gone in a step, to 1, where
        nothing is damped.
    b : float, default 1/3
        As for :class:`HHT`.
    less_implicit : bool, default False
        As for :class:`HHT`.
    newton_tol : float, optional
        As for :class:`HHT`.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`jay2009`, after :cite:t:`chung1993`; see :doc:`/theory/hht`.

    Examples
    --------
    >>> import liouville as lv
    >>> structure = lv.Structure([1.0], [[1.0]])
    >>> method = lv.GeneralizedAlpha(0.8)
    >>> run = lv.integrate(structure, method, t=(0, 10), h=0.1, q=[1.0], v=[0.0])
    >>> f"{run.dissipated[-1]:.2e}"  # of an energy of 0.5
    '1.11e-05'
    """

    form: ClassVar[str] = "second order"
    order: ClassVar[int] = 2
    rho: float = field(default=0.8, metadata={"help": _RHO})
    b: float = field(default=1 / 3, metadata={"help": _B})
    less_implicit: bool = field(default=False, metadata={"help": _LESS_IMPLICIT})
    newton_tol: float | None = field(default=None, metadata={"help": NEWTON_TOL_HELP})

    def __post_init__(self) -> None:
        """Refuse numbers that make no method."""
        _check_radius(self.rho)
        _check_reactions(self.b, self.less_implicit)
        check_newton_tol(self.newton_tol)

    @property
    def coefficients(self) -> Coefficients:
        r""":math:`\alpha_m, \alpha_f, \gamma, \beta`."""
        return _of_radius(self.rho)

    @property
    def reaction(self) -> str:
        """How the reactions enter: "extended", or "predicted" if less implicit."""
        return "predicted" if self.less_implicit else "extended"


@dataclass(frozen=True, repr=False)
class ArnoldBruls(Brief):
    r"""Generalised-alpha method with the position constraint alone, order 2.

    With the coefficients of :class:`GeneralizedAlpha`, but with the reaction as a part of the
    accelerations, :math:`M \varphi_1 = f - p_t - p_y z + r(t_1, y_1, \lambda_1)`:

    .. math::

        y_1 &= y_0 + h z_0 + h^2 \left((\tfrac12 - \beta) a_0 + \beta a_1\right) \\
        z_1 &= z_0 + h \left((1 - \gamma) a_0 + \gamma a_1\right) \\
        (1 - \alpha_m)\, a_1 + \alpha_m a_0 &= (1 - \alpha_f)\, \varphi_1 + \alpha_f \varphi_0,
            \qquad 0 = g(t_1, y_1)

    The method of much multibody software, for comparison. Order 2 in positions and velocities.
    Keeps the constraint to roundoff, the hidden constraint only to :math:`O(h^2)`. What it needs
    of the system is as for :class:`HHT`.

    Parameters
    ----------
    rho : float, default 0.8
        Spectral radius at infinity, from 0 to 1. With constraints, 1 is weakly unstable.
    newton_tol : float, optional
        As for :class:`HHT`; the end of a step is moved onto the constraint alone.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`arnold2007`; see :doc:`/theory/hht`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> method = lv.ArnoldBruls(0.8)
    >>> run = lv.integrate(pendulum.system, method, t=(0, 1), h=0.01, **pendulum.start)
    >>> run.status
    'done'
    """

    form: ClassVar[str] = "second order"
    order: ClassVar[int] = 2
    reaction: ClassVar[str] = "position"
    rho: float = field(default=0.8, metadata={"help": _RHO})
    newton_tol: float | None = field(default=None, metadata={"help": NEWTON_TOL_HELP})

    def __post_init__(self) -> None:
        """Refuse numbers that make no method."""
        _check_radius(self.rho)
        check_newton_tol(self.newton_tol)

    @property
    def coefficients(self) -> Coefficients:
        r""":math:`\alpha_m, \alpha_f, \gamma, \beta`."""
        return _of_radius(self.rho)


def _second_order(alpha_m: float, alpha_f: float) -> Coefficients:
    """Add the gamma of second order, and the beta that damps fast oscillations most."""
    shift = alpha_f - alpha_m
    return alpha_m, alpha_f, 0.5 + shift, (1 + shift) ** 2 / 4


def _of_radius(rho: float) -> Coefficients:
    rho = float(rho)
    return _second_order((2 * rho - 1) / (rho + 1), rho / (rho + 1))


def _check_radius(rho: Any) -> None:
    if not 0 <= number("rho must be a number", rho) <= 1:
        raise ValueError(
            f"rho must be from 0 to 1, not {rho:g}: it is what a step leaves of a fast oscillation"
        )


def _check_reactions(b: Any, less_implicit: Any) -> None:
    if not isinstance(less_implicit, bool):
        raise TypeError(f"less_implicit must be True or False, not {less_implicit!r}")
    gap = abs(1 - 2 * number("b must be a number", b))
    if not math.isfinite(gap):
        raise ValueError(f"b must be finite, not {b:g}")
    if gap < LEAST_GAP:
        raise ValueError(
            f"b must be at least {LEAST_GAP / 2:g} away from 1/2, not {b:g}: the two constraints "
            "of a step become dependent there, and errors grow as 1/|1 - 2b|"
        )
