"""Volume-preserving splitting of divergence-free polynomial fields."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from liouville._methods.brief import Brief
from liouville._methods.composition import SCHEMES, scheme_name

DIAGONAL = ("auto", "shears", "exponentials", "pairs", "regular", "n+d")
OFF_DIAGONAL = ("auto", "natural", "triangular")
LINEAR = ("auto", "split", "exact")
TURN = ("exact", "boris")
RUNGE_KUTTA = ("euler", "midpoint", "heun", "kutta3", "rk4")


@dataclass(frozen=True, repr=False)
class VolumeSplitting(Brief):
    r"""Explicit volume-preserving splitting of a divergence-free polynomial field.

    The field is a sum of pieces :math:`f = f_1 + \dots + f_m`, each divergence-free and with an
    explicit volume-preserving map :math:`\psi^k_h`. The basic step and its adjoint

    .. math::

        \Phi_h = \psi^m_h \circ \dots \circ \psi^1_h, \qquad
        \Phi^*_h = \psi^{1*}_h \circ \dots \circ \psi^{m*}_h

    are composed, :math:`\dots \Phi_{\alpha_2 h} \circ \Phi^*_{\alpha_1 h}`, to a symmetric method
    of order 2 to 10. The determinant of its Jacobian is 1 to roundoff for every step size.

    The *diagonal* part of a field are the terms of :math:`x_i'` that contain :math:`x_i`; the rest
    is *off-diagonal*. What is ``"auto"`` is chosen by :func:`liouville.plan` from the structure of
    the field and trial runs, always in the same way for the same field, start, step and interval.

    Parameters
    ----------
    diagonal : {"auto", "shears", "exponentials", "pairs", "regular", "n+d"}
        Pieces of the diagonal part: d ``"shears"`` :math:`x' = a\, g(x)` with
        :math:`a \cdot \nabla g = 0` for degree d; ``"exponentials"``, one for each monomial, which
        keep every hyperplane :math:`x_i = 0` but may blow up for a long step; ``"pairs"``, the same
        for two variables at a time, more pieces by products and divisions alone; ``"regular"``,
        exponentials without that danger (degree 2); or ``"n+d"`` shears for the whole field.
    off_diagonal : {"auto", "natural", "triangular"}
        Pieces of the off-diagonal part: ``"natural"`` shears, which change one variable each, or
        all those of one colour; or strictly ``"triangular"`` pieces, by a Runge-Kutta method and
        its adjoint.
    composition : str
        Name of the composition: order 2 ``S2``; order 4 ``Y4``, ``SU4``, ``M4s4``, ``M4s5``,
        ``OMF4``, ``BM4``; order 6 ``Y6``, ``KL6``, ``SS6s11``, ``SS6s13``, ``BM6``; order 8
        ``Y8D``, ``SU8``, ``KL8``, ``SS8s21``; order 10 ``SS10s35``.
    linear : {"auto", "split", "exact"}
        Whether constant and linear terms are split too, or integrated exactly as one piece.
    runge_kutta : {"euler", "midpoint", "heun", "kutta3", "rk4"}
        The method of triangular pieces; any keeps volume.
    turn : {"exact", "boris"}
        Of charged particles: the exact kick, or Boris's turn, with schemes of symmetric steps.
    compensated : bool, default False
        Carry the rounding errors of sums along: less noise in runs of many steps, for some cost.

    Raises
    ------
    TypeError, ValueError
        A parameter is none of these.

    References
    ----------
    :cite:t:`mclachlan2008`; see :doc:`/theory/volume`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import euler_top
    >>> method = lv.VolumeSplitting(composition="BM4")
    >>> run = lv.integrate(euler_top.system, method, t=(0, 10), h=0.1, **euler_top.start)
    >>> bool(run.invariant_drift("energy").max() < 1e-8), method.order
    (True, 4)
    """

    form: ClassVar[str] = "field"
    diagonal: str = field(default="auto", metadata={"help": "one of " + ", ".join(DIAGONAL)})
    off_diagonal: str = field(
        default="auto", metadata={"help": "one of " + ", ".join(OFF_DIAGONAL)}
    )
    composition: str = field(
        default="auto", metadata={"help": "auto or one of " + ", ".join(SCHEMES)}
    )
    linear: str = field(default="auto", metadata={"help": "one of " + ", ".join(LINEAR)})
    runge_kutta: str = field(
        default="euler", metadata={"help": "of triangular pieces: " + ", ".join(RUNGE_KUTTA)}
    )
    turn: str = field(
        default="exact", metadata={"help": "of charged particles: " + ", ".join(TURN)}
    )
    compensated: bool = field(default=False, metadata={"help": "carry rounding errors along"})

    def __post_init__(self) -> None:
        """Refuse words that make no method."""
        _one_of("diagonal", self.diagonal, DIAGONAL)
        _one_of("off_diagonal", self.off_diagonal, OFF_DIAGONAL)
        _one_of("linear", self.linear, LINEAR)
        _one_of("runge_kutta", self.runge_kutta, RUNGE_KUTTA)
        _one_of("turn", self.turn, TURN)
        if self.composition != "auto":
            scheme_name(self.composition, tuple(SCHEMES))
        if not isinstance(self.compensated, bool):
            raise TypeError(f"compensated must be True or False, not {self.compensated!r}")
        if self.diagonal == "n+d" and self.off_diagonal == "triangular":
            raise ValueError(
                "the n + d shears are the whole field: with diagonal='n+d' there is no "
                "off_diagonal='triangular'"
            )

    @property
    def is_open(self) -> bool:
        """Whether something is left to choose."""
        return "auto" in (self.diagonal, self.off_diagonal, self.composition, self.linear)

    @property
    def order(self) -> int | None:
        """Order of the composition, None while that is to be chosen."""
        return None if self.composition == "auto" else int(SCHEMES[self.composition]["order"])


def _one_of(name: str, value: Any, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, not {value!r}")
