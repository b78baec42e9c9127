"""Methods for the Schrödinger equation that use products with the Hamiltonian."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from liouville._basics.arguments import count, number
from liouville._basics.errors import hinted
from liouville._methods.brief import Brief
from liouville._methods.composition import SCHEMES, scheme_name

MODES = ("auto", "fast", "stable")

#: Orders of the splittings of Runge-Kutta-Nyström type.
NYSTROM = {"RKN4s6": 4, "RKN6s11": 6}

#: Exponentials of a step of the Magnus methods of each order, the default first.
MAGNUS = {2: (1,), 4: (3, 2), 6: (5,), 8: (8,)}

#: No tolerance is smaller: it would be that of a few roundings.
LEAST_TOLERANCE = 1e-14


def _check_tolerance(tol: object) -> None:
    value = number("tol must be a number", tol)
    if not LEAST_TOLERANCE <= value < 1:
        hint = "it is the error of psi at the end, relative to its norm"
        raise ValueError(
            hinted(f"tol must be from {LEAST_TOLERANCE:g} to below 1, not {value:g}", hint)
        )


@dataclass(frozen=True, repr=False)
class SchrodingerSplitting(Brief):
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
        a stable one beyond 50 steps, and a :class:`Chebyshev` series where no splitting reaches the
        tolerance, where a series is likely to be faster, for a Hamiltonian that no gauge makes
        real, and for one that depends on time.

    Raises
    ------
    TypeError, ValueError
        A parameter is none of these.

    References
    ----------
    :cite:t:`blanes2015`; see :doc:`/theory/schrodinger`.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> chain = lv.Schrodinger(lv.Lattice(100))
    >>> psi = np.eye(100)[50]
    >>> run = lv.integrate(chain, lv.SchrodingerSplitting(1e-6), t=(0, 10), psi=psi)
    >>> f"{abs(run.psi[-1, 50]):.6f}"  # the Bessel function |J0(20)|
    '0.167025'
    """

    form: ClassVar[str] = "wave"
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})
    mode: str = field(default="auto", metadata={"help": "one of " + ", ".join(MODES)})

    def __post_init__(self) -> None:
        """Validate the arguments."""
        _check_tolerance(self.tol)
        if self.mode not in MODES:
            raise ValueError(f"mode must be one of {', '.join(MODES)}, not {self.mode!r}")


@dataclass(frozen=True, repr=False)
class Chebyshev(Brief):
    r"""The Chebyshev series of the propagator, truncated where its tail is below the tolerance.

    .. math::

        \psi(t + h) = e^{-i \sigma h} \sum_{k=0}^{M} (2 - \delta_{k0}) (-i)^k J_k(\beta h)\,
            T_k\!\left(\frac{H - \sigma}{\beta}\right) \psi(t)

    The terms are evaluated at all times within a window, which has M products, half of that from a
    real state. Windows are as long as memory allows, so that any number of states takes at most
    1.2 times the products of one series over all of the time. Not unitary: the norm is kept to the
    tolerance only.

    An H(t) has a series in powers of the time, or in Bessel functions, in windows chosen by bounds
    of its terms; they too are evaluated at all times within a window.

    Parameters
    ----------
    tol : float, default 1e-8
        The error of :math:`\psi` at every state kept, relative to its norm.

    Raises
    ------
    TypeError, ValueError
        A parameter is out of range.

    References
    ----------
    :cite:t:`talezer1984`.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> chain = lv.Schrodinger(lv.Lattice(100))
    >>> psi = np.eye(100)[50]
    >>> run = lv.integrate(chain, lv.Chebyshev(1e-6), t=(0, 10), psi=psi)
    >>> run.stats["bound"], f"{abs(run.psi[-1, 50]):.6f}"  # the Bessel function |J0(20)|
    (1e-06, '0.167025')
    """

    form: ClassVar[str] = "wave"
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})

    def __post_init__(self) -> None:
        """Validate the arguments."""
        _check_tolerance(self.tol)


@dataclass(frozen=True, repr=False)
class Lanczos(Brief):
    r"""Short iterative Lanczos: the propagator in Krylov spaces of the state.

    Steps are as long as the estimated error allows. The best where a state is made of few
    eigenvectors and the tolerance is loose; it takes `dimension` complex vectors of memory and
    inner products. An H that absorbs has spaces by Arnoldi's recurrence, in which `tol` is a bound:
    :doc:`/theory/condensates`.

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
    :cite:t:`parklight1986`.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> chain = lv.Schrodinger(lv.Lattice(100))
    >>> psi = np.eye(100)[50]
    >>> run = lv.integrate(chain, lv.Lanczos(1e-6), t=(0, 10), psi=psi)
    >>> f"{abs(run.psi[-1, 50]):.6f}"  # the Bessel function |J0(20)|
    '0.167025'
    """

    form: ClassVar[str] = "wave"
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})
    dimension: int = field(default=20, metadata={"help": "dimension of a Krylov space"})

    def __post_init__(self) -> None:
        """Validate the arguments."""
        _check_tolerance(self.tol)
        if not 2 <= count("dimension", self.dimension) <= 200:
            raise ValueError(f"dimension must be from 2 to 200, not {self.dimension}")


@dataclass(frozen=True, repr=False)
class SplitOperator(Brief):
    r"""Split operator on a grid: flows of kinetic and potential energy in turn, each exact.

    .. math::

        \psi \leftarrow e^{-i b_s h V} e^{-i a_{s-1} h T} \cdots
            e^{-i a_1 h T} e^{-i b_1 h V} \psi, \qquad H = T + V(t, x)

    One pair of FFTs for each flow of T. Unitary; a potential that depends on time is taken at the
    time that the flows of T before it have reached. The best for smooth states of low energy, and
    the one method for a nonlinearity, whose flow is as exact: :doc:`/theory/condensates`.

    With ``tol`` a run chooses its steps: each is made as one and as two halves, which are kept, and
    whose error is :math:`|\psi_{h/2} - \psi_h| / (2^p - 1)` for short steps of a scheme of order p.

    Parameters
    ----------
    scheme : str, default "RKN6s11"
        Order 2 ``S2``; order 4 ``BM4``, ``RKN4s6``; order 6 ``BM6``, ``RKN6s11``; or another name
        of a composition (see :class:`VolumeSplitting`). Those called RKN use that V and its
        commutators with T have special forms, which a ``coupling=`` of components has not:
        ``RKN6s11`` is of order 4 then.
    tol : float, optional
        The error of :math:`\psi` at the end, relative to its norm at the start, as far as estimates
        hold; for runs without ``h=`` and ``steps=``. Errors of a nonlinear equation may grow beyond
        it.

    Raises
    ------
    TypeError, ValueError
        There is no such scheme, or ``tol`` is out of range.

    References
    ----------
    :cite:t:`blanes2002`.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> grid = lv.Grid(-10, 10, 128, potential=lambda t, x, params: x**2 / 2)
    >>> psi = np.exp(-((grid.points[:, 0] - 1) ** 2) / 2)
    >>> period = {"t": (0, 2 * np.pi), "steps": 40}
    >>> run = lv.integrate(lv.Schrodinger(grid), lv.SplitOperator(), psi=psi, **period)
    >>> bool(abs(run.psi[-1] + psi).max() < 1e-10)  # back, with the opposite sign
    True
    >>> method = lv.SplitOperator(tol=1e-6)
    >>> run = lv.integrate(lv.Schrodinger(grid), method, psi=psi, t=(0, 2 * np.pi))
    >>> bool(abs(run.psi[-1] + psi).max() < 1e-6)
    True
    """

    form: ClassVar[str] = "wave"
    scheme: str = field(default="RKN6s11", metadata={"help": "as RKN6s11, BM4, S2"})
    tol: float | None = field(
        default=None, metadata={"help": "error at the end, relative to the norm"}
    )

    def __post_init__(self) -> None:
        """Refuse what is no scheme, and a tolerance out of range."""
        scheme_name(self.scheme, (*SCHEMES, *NYSTROM))
        if self.tol is not None:
            _check_tolerance(self.tol)

    @property
    def order(self) -> int:
        """Order of the method."""
        return NYSTROM.get(self.scheme) or int(SCHEMES[self.scheme]["order"])


@dataclass(frozen=True, repr=False)
class Magnus(Brief):
    r"""Commutator-free Magnus method for :math:`H(t)`.

    A step is a product of exponentials of sums of H at Gauss points c,

    .. math::

        \psi \leftarrow \prod_j e^{-i h \hat H_j}\, \psi, \qquad
        \hat H_j = \sum_k a_{jk} H(t + c_k h),

    the first one with j = 1. Each is a Chebyshev series of the degree that its own phase takes, or
    by a stable splitting of :class:`SchrodingerSplitting` where a run has more than 10,000 of them.

    Without ``h=`` and ``steps=`` a run chooses its steps by an estimate of their errors: some steps
    are made as one and again as two halves. With them steps are of equal size.

    Parameters
    ----------
    order : {4, 2, 6, 8}
        Order in h. The higher ones are for tighter tolerances, 6 from about 1e-5 on and 8 from
        1e-8 on.
    tol : float, default 1e-8
        The error of :math:`\psi` at the end, relative to its norm, as far as estimates hold. With
        steps of a given size it is that of all exponentials together; that of the Magnus method
        comes on top, and falls with h.
    exponentials : int, optional
        Exponentials of a step: 1 of order 2, 3 or 2 of order 4, 5 of order 6, 8 of order 8. The
        first of these is the default.

    Attributes
    ----------
    scheme : tuple of int
        The order and the number of exponentials.

    Raises
    ------
    TypeError, ValueError
        A parameter is none of these.

    References
    ----------
    :cite:t:`alvermann2011`; order 8 from :cite:t:`hofstatter2019`.

    Examples
    --------
    >>> import casadi as ca
    >>> import liouville as lv
    >>> drive = [(lambda t, params: 0.5 * ca.cos(t), [[0, 1], [1, 0]])]
    >>> qubit = lv.Schrodinger([[0, 0], [0, 1]], drive=drive)
    >>> run = lv.integrate(qubit, lv.Magnus(6), t=(0, 10), psi=[1, 0])
    >>> f"{abs(run.psi[-1, 1]) ** 2:.6f}"
    '0.275872'
    """

    form: ClassVar[str] = "wave"
    order: int = field(default=4, metadata={"help": "order in h, 2, 4, 6 or 8"})
    tol: float = field(default=1e-8, metadata={"help": "error at the end, relative to the norm"})
    exponentials: int | None = field(
        default=None, metadata={"help": "of a step; 2 or 3 of order 4"}
    )

    def __post_init__(self) -> None:
        """Validate the arguments."""
        if count("order", self.order) not in MAGNUS:
            raise ValueError(f"order must be 2, 4, 6 or 8, not {self.order}")
        known = MAGNUS[self.order]
        if self.exponentials is not None and count("exponentials", self.exponentials) not in known:
            raise ValueError(
                f"exponentials must be {' or '.join(map(str, known))} for order {self.order}, "
                f"not {self.exponentials}"
            )
        _check_tolerance(self.tol)

    @property
    def scheme(self) -> tuple[int, int]:
        """The order and the number of exponentials."""
        return self.order, self.exponentials or MAGNUS[self.order][0]
