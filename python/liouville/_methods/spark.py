"""SPARK methods with Gauss or Radau stages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from liouville._methods.brief import Brief

#: More stages take more time than they save, long before this.
MOST_STAGES = 64

SOLVERS = ("auto", "node-schur", "newton")

#: The largest tolerance of the iteration.
LARGEST_NEWTON_TOL = 1e-2

NEWTON_TOL_HELP = "the tolerance of the equations, by default roundoff or by rtol"

#: Where the stages are.
POINTS = ("gauss", "radau")


def check_stages(stages: object, least: int, most: int) -> None:
    """Refuse what is no number of stages."""
    if isinstance(stages, bool) or not isinstance(stages, (int, np.integer)):
        raise TypeError(f"stages must be an integer, not {stages!r}")
    if not least <= stages <= most:
        raise ValueError(f"stages must be from {least} to {most}, not {stages}")


def check_solver(solver: object) -> None:
    """Refuse what is no solver."""
    if solver not in SOLVERS:
        raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, not {solver!r}")


def check_newton_tol(tolerance: object) -> None:
    """Refuse what is no tolerance of Newton's iteration."""
    if tolerance is None:
        return
    if isinstance(tolerance, bool) or not isinstance(tolerance, (float, np.floating)):
        raise TypeError(f"newton_tol must be a float or None, not {tolerance!r}")
    if not 0.0 < tolerance <= LARGEST_NEWTON_TOL:
        raise ValueError(
            f"newton_tol must be above 0 and at most {LARGEST_NEWTON_TOL:g}, not {tolerance:g}"
        )


@dataclass(frozen=True, repr=False)
class Spark(Brief):
    r"""SPARK for constrained mechanics: s Gauss stages, order 2s, or Radau stages, order 2s - 1.

    With stages :math:`T_i = t_0 + c_i h`, :math:`i = 1..s`, and Lobatto nodes
    :math:`\hat T_j = t_0 + \hat c_j h`, :math:`j = 0..s`:

    .. math::

        Y_i &= y_0 + h \sum_{j=1}^s a_{ij} v(T_j, Y_j, Z_j) \\
        \hat Y_i &= y_0 + h \sum_{j=1}^s \bar a_{ij} v(T_j, Y_j, Z_j) \\
        p(T_i, Y_i, Z_i) &= p_0 + h \sum_{j=1}^s a_{ij} f(T_j, Y_j, Z_j)
            + h \sum_{j=0}^{s-1} \hat a_{ij} r(\hat T_j, \hat Y_j, \Lambda_j) \\
        0 &= g(\hat T_i, \hat Y_i), \quad i = 1..s \\
        y_1 &= y_0 + h \sum_{j=1}^s b_j v(T_j, Y_j, Z_j) \\
        p(t_1, y_1, z_1) &= p_0 + h \sum_{j=1}^s b_j f(T_j, Y_j, Z_j)
            + h \sum_{j=0}^{s} \hat b_j r(\hat T_j, \hat Y_j, \Lambda_j) \\
        0 &= g_t(t_1, y_1) + g_y(t_1, y_1) v(t_1, y_1, z_1)

    Order :math:`2s` in positions and velocities, and in the multipliers, which are solved for at
    the output points. Keeps both constraints to roundoff, is symmetric, and symplectic for
    Lagrangian and Hamiltonian systems. Needs :math:`p_z` and :math:`g_y v_z p_z^{-1} r_\lambda`
    invertible; without constraints it is the Gauss collocation method.

    Nonholonomic constraints have their reactions at the stages, with the coefficients of f, and
    hold at the end of every step to roundoff, alone or beside holonomic ones
    :cite:p:`jay2009lagrange`; orders and symmetry are the same.

    A ``SemiExplicit`` system is stepped by the specialised Runge-Kutta method on the same points
    :cite:p:`jay2006`, with the same orders; on Radau points that is Radau IIA.

    With ``points="radau"`` the :math:`c_i` are the Radau points, :math:`c_s = 1`, in the same
    equations. This is for dissipative systems: order :math:`2s - 1` in positions, velocities and
    multipliers, both constraints to roundoff, neither symmetric nor symplectic, and stiff forces
    are damped out within a few steps, which Gauss stages leave oscillating for ever. Without
    constraints it is Radau IIA.

    Parameters
    ----------
    stages : int, default 3
        Number s of stages, from 1 to 64.
    solver : {"auto", "node-schur", "newton"}, default "auto"
        How the stage equations are solved; the result is the same to roundoff.
    points : {"gauss", "radau"}, default "gauss"
        Where the stages are.
    newton_tol : float, optional
        Corrections of the stage equations that are expected to be below this fraction of the
        velocities are not made; at most 0.01. By default they are solved to roundoff, and a little
        further, which is what energies without drift need, and to a hundredth of ``rtol=`` where
        errors control the steps. Constraints hold to roundoff all the same: the end of each step is
        moved onto them.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`jay2007`, and :cite:t:`hairer1996` on Radau IIA; see :doc:`/theory/spark`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> lv.Spark(3).order, lv.Spark(3, points="radau").order
    (6, 5)
    >>> run = lv.integrate(pendulum.system, lv.Spark(3), t=(0, 1), h=0.1, **pendulum.start)
    >>> bool(abs(run.residuals["constraint"]).max() < 1e-15)
    True
    """

    form: ClassVar[str] = "general"
    stages: int = field(default=3, metadata={"help": "number of stages, from 1 to 64"})
    solver: str = field(default="auto", metadata={"help": "one of " + ", ".join(SOLVERS)})
    points: str = field(default="gauss", metadata={"help": "one of " + ", ".join(POINTS)})
    newton_tol: float | None = field(default=None, metadata={"help": NEWTON_TOL_HELP})

    def __post_init__(self) -> None:
        """Refuse numbers that make no method."""
        check_stages(self.stages, 1, MOST_STAGES)
        check_solver(self.solver)
        check_newton_tol(self.newton_tol)
        if self.points not in POINTS:
            raise ValueError(f"points must be one of {', '.join(POINTS)}, not {self.points!r}")

    @property
    def order(self) -> int:
        """Order of the method, 2s or 2s - 1."""
        return 2 * int(self.stages) - (self.points == "radau")

    @property
    def intervals(self) -> int:
        """Intervals between the nodes of the constraints."""
        return int(self.stages)

    @property
    def is_symmetric(self) -> bool:
        """Whether a step back undoes a step."""
        return self.points == "gauss"
