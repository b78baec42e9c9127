"""Methods for the Schrödinger equation that know the Hamiltonian by its products."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from liouville._arguments import count, number
from liouville.errors import hinted

MODES = ("auto", "fast", "stable")

#: No tolerance is smaller: it would be that of a few roundings.
LEAST_TOLERANCE = 1e-14


def _check_tolerance(tol: object) -> None:
    value = number("tol is a number", tol)
    if not LEAST_TOLERANCE <= value < 1:
        hint = "it is the error of psi at the end, relative to its norm"
        raise ValueError(hinted(f"tol is from {LEAST_TOLERANCE:g} to below 1, not {value:g}", hint))


@dataclass(frozen=True)
class SchrodingerSplitting:
    r"""Symplectic splitting of :math:`i \psi' = H \psi` into shears, optimised for accuracy.

    With :math:`\psi = q + i p` and real symmetric H a step is a list of shears

    .. math::

        q \leftarrow q + c_1 h (H - \sigma) p, \quad p \leftarrow p - c_2 h (H - \sigma) q, \quad
        q \leftarrow q + c_3 h (H - \sigma) p, \ \dots

    whose error for every eigenvalue within :math:`|\lambda - \sigma| h \le \theta` is below a bound
    known beforehand. From a ladder of such methods the one is taken, with the number of its steps,
    that needs the fewest products for the tolerance. No inner products, two real vectors of
    memory, each step exactly symplectic and reversible.

    Parameters
    ----------
    tol : float, default 1e-8
        The error of :math:`\psi` at the end, relative to its norm. It is kept to a priori: the
        bound holds for every state.
    mode : {"auto", "fast", "stable"}
        ``"stable"`` methods keep a quadratic form close to the norm exactly, so that the norm does
        not drift over any number of steps; ``"fast"`` are all of the ladder. ``"auto"`` takes any,
        a stable one beyond 50 steps, and a Chebyshev series where no splitting reaches the
        tolerance, where a series is shorter, and for a Hamiltonian that no gauge makes real.

    Raises
    ------
    TypeError, ValueError
        A parameter is none of these.

    References
    ----------
    :cite:t:`blanes2015`; see :doc:`/theory/schrodinger`.
    """

    form: ClassVar[str] = "wave"
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})
    mode: str = field(default="auto", metadata={"help": "one of " + ", ".join(MODES)})

    def __post_init__(self) -> None:
        """Refuse what makes no method."""
        _check_tolerance(self.tol)
        if self.mode not in MODES:
            raise ValueError(f"mode is one of {', '.join(MODES)}, not {self.mode!r}")


@dataclass(frozen=True)
class Chebyshev:
    r"""The Chebyshev series of the propagator, truncated where its tail is below the tolerance.

    .. math::

        \psi(t + h) = e^{-i \sigma h} \sum_{k=0}^{M} (2 - \delta_{k0}) (-i)^k J_k(\beta h)\,
            T_k\!\left(\frac{H - \sigma}{\beta}\right) \psi(t)

    M products an interval between two states that are kept, half of that from a real state. Not
    unitary: the norm is kept to the tolerance only.

    Parameters
    ----------
    tol : float, default 1e-8
        The error of :math:`\psi` at the end, relative to its norm; an interval has its share.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`talezer1984`.
    """

    form: ClassVar[str] = "wave"
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})

    def __post_init__(self) -> None:
        """Refuse what makes no method."""
        _check_tolerance(self.tol)


@dataclass(frozen=True)
class Lanczos:
    r"""Short iterative Lanczos: the propagator in Krylov spaces of the state.

    Steps are as long as the estimated error allows. The best where a state is made of few
    eigenvectors and the tolerance is loose; it takes `dimension` complex vectors of memory and
    inner products.

    Parameters
    ----------
    tol : float, default 1e-8
        The error of :math:`\psi` at the end, relative to its norm, as far as estimates hold.
    dimension : int, default 20
        Dimension of a Krylov space, from 2 to 200.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`park1986`.
    """

    form: ClassVar[str] = "wave"
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})
    dimension: int = field(default=20, metadata={"help": "dimension of a Krylov space"})

    def __post_init__(self) -> None:
        """Refuse what makes no method."""
        _check_tolerance(self.tol)
        if not 2 <= count("dimension", self.dimension) <= 200:
            raise ValueError(f"dimension is from 2 to 200, not {self.dimension}")
