"""The Lobatto IIIA-IIIB pair, of which RATTLE is the first."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from liouville._basics.errors import hinted, meant
from liouville._methods.brief import Brief
from liouville._methods.spark import (
    NEWTON_TOL_HELP,
    SOLVERS,
    check_newton_tol,
    check_solver,
    check_stages,
)

#: Most stages: more take more time than they save, long before this.
MOST_STAGES = 32

#: Lobatto coefficients of the forces, by the letter after III.
FORCES = ("A", "B", "C", "C*", "D")

#: Those that leave the pair symmetric; C and C* are each other's adjoints.
SYMMETRIC_FORCES = ("A", "B", "D")


@dataclass(frozen=True, repr=False)
class LobattoPair(Brief):
    r"""Lobatto IIIA-IIIB for constrained mechanics, order 2s - 2 with s stages.

    With the Lobatto points :math:`T_i = t_0 + c_i h`, :math:`0 = c_1 < \dots < c_s = 1`, as stages
    and as nodes of the constraints:

    .. math::

        Y_i &= y_0 + h \sum_{j=1}^s a^A_{ij} v(T_j, Y_j, Z_j), \qquad y_1 = Y_s \\
        p(T_i, Y_i, Z_i) &= p_0 + h \sum_{j=1}^s a^F_{ij} f(T_j, Y_j, Z_j)
            + h \sum_{j=1}^{s-1} a^B_{ij} r(T_j, Y_j, \Lambda_j) \\
        0 &= g(T_i, Y_i), \quad i = 2..s \\
        p(t_1, y_1, z_1) &= p_0 + h \sum_{j=1}^s b_j
            \bigl(f(T_j, Y_j, Z_j) + r(T_j, Y_j, \Lambda_j)\bigr) \\
        0 &= g_t(t_1, y_1) + g_y(t_1, y_1) v(t_1, y_1, z_1)

    Order :math:`2s - 2` in positions, velocities and multipliers, with any ``force``. Keeps both
    constraints to roundoff. With ``force="B"`` it is symmetric, and symplectic for Lagrangian and
    Hamiltonian systems; with "A" and "D" it is symmetric, with "C" and "C*" neither. For a constant
    mass and forces of t and y alone, B, C, C* and D are the same map.

    Nonholonomic constraints have their reactions at the stages, with the coefficients
    :math:`a^B`, and hold at the end of every step to roundoff; the order is the same.

    Two stages are RATTLE if the mass is constant and forces depend on t and y alone. The pair does
    not damp, and is stable for stiff forces only with small steps. ``Spark(s - 1)`` has the same
    order with one stage less, errors of the same size, and no such bound.

    Parameters
    ----------
    stages : int, default 2
        Number s of stages, from 2 to 32.
    force : {"B", "A", "C", "C*", "D"}, default "B"
        The Lobatto III coefficients :math:`a^F` of the forces.
    solver : {"auto", "node-schur", "newton"}, default "auto"
        How the stage equations are solved; the result is the same to roundoff.
    newton_tol : float, optional
        What the stage equations are solved to, as in :class:`Spark`.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    See Also
    --------
    Spark : Gauss-Lobatto SPARK, order 2s with s stages.

    References
    ----------
    :cite:t:`jay1996`; see :doc:`/theory/spark`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> run = lv.integrate(pendulum.system, lv.LobattoPair(), t=(0, 1), h=0.1, **pendulum.start)
    >>> run.stats["solver"]
    'rattle'
    """

    form: ClassVar[str] = "general"
    stages: int = field(default=2, metadata={"help": "number of stages, from 2 to 32"})
    force: str = field(default="B", metadata={"help": "one of " + ", ".join(FORCES)})
    solver: str = field(default="auto", metadata={"help": "one of " + ", ".join(SOLVERS)})
    newton_tol: float | None = field(default=None, metadata={"help": NEWTON_TOL_HELP})

    def __post_init__(self) -> None:
        """Refuse numbers that make no method."""
        check_stages(self.stages, 2, MOST_STAGES)
        if self.force not in FORCES:
            sentence = f"force must be one of {', '.join(FORCES)}, not {self.force!r}"
            near = meant(str(self.force).upper(), FORCES)
            near = f"{near} " if near.endswith("?") else ""
            raise ValueError(hinted(sentence, f"{near}'B' is the symplectic one"))
        check_solver(self.solver)
        check_newton_tol(self.newton_tol)

    @property
    def order(self) -> int:
        """Order of the method, 2s - 2."""
        return 2 * int(self.stages) - 2

    @property
    def intervals(self) -> int:
        """Intervals between the nodes of the constraints."""
        return int(self.stages) - 1

    @property
    def is_symmetric(self) -> bool:
        """Whether a step back undoes a step."""
        return self.force in SYMMETRIC_FORCES
