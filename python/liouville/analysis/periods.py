"""The propagator of a Schrödinger equation, and the modes of a period of its drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import number, times_of
from liouville._basics.errors import Suggesting, hinted, misshapen
from liouville._basics.scipy import scipy
from liouville._methods import WaveMethod
from liouville._runs.ensemble import ensemble
from liouville._systems import Schrodinger

Array = NDArray[np.complex128]

#: Most components: U has their square.
MOST = 4096

#: Times of a period at which a drive is compared with that of the next one, and how alike it is.
LOOKS, ALIKE = 9, 1e-6


def propagator(
    system: Schrodinger,
    method: WaveMethod | str = "auto",
    *,
    t: tuple[float, float],
    params: Mapping[str, ArrayLike] | None = None,
    h: float | None = None,
    steps: int | None = None,
    threads: int | None = None,
) -> Array:
    r"""Return the matrix U with :math:`\psi(t_1) = U\, \psi(t_0)` for every state.

    Parameters
    ----------
    system : Schrodinger
        A linear equation of at most 4096 components.
    method : Method or "auto"
        As :func:`liouville.integrate` has it. Each column of U is within its tolerance.
    t : tuple of float
        Start and end; back in time U is the inverse.
    params : mapping of str to array_like, optional
        Changed values of parameters.
    h, steps, threads
        As :func:`liouville.ensemble` has them; steps are for methods that take them.

    Returns
    -------
    ndarray, shape (N, N), complex

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind, or the equation is not linear or too large.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> qubit = lv.Schrodinger(np.array([[0.0, 1.0], [1.0, 0.0]]))
    >>> np.round(lv.analysis.propagator(qubit, t=(0, np.pi)), 6) + 0  # exp(-i pi X)
    array([[-1.+0.j,  0.+0.j],
           [ 0.+0.j, -1.+0.j]])
    """
    options = {"h": h, "steps": steps, "threads": threads}
    return _columns(_linear(system).with_params(params), method, t, options)


@dataclass(frozen=True, eq=False, repr=False)
class Floquet(Suggesting):
    r"""The modes of a period T: states that are themselves a period later, up to a phase.

    .. math::

        U \psi_j = e^{-i \epsilon_j T / \hbar} \psi_j, \qquad
        -\pi \hbar / T < \epsilon_j \le \pi \hbar / T

    Attributes
    ----------
    quasienergies : ndarray, shape (N,)
        :math:`\epsilon_j`, in rising order.
    modes : ndarray, shape (N, N)
        The states :math:`\psi_j` at the start of the period, orthonormal, as rows.
    period : float
        T.
    hbar : float
        Planck's constant in the units of the equation.
    error : float
        :math:`\|U^\dagger U - 1\|` before U was made unitary. With the tolerance of U it bounds the
        error of a phase :math:`\epsilon_j T / \hbar`, and n periods have n times that.
    """

    quasienergies: NDArray[np.float64]
    modes: Array
    period: float
    hbar: float
    error: float

    def after(self, psi: ArrayLike, periods: ArrayLike) -> Array:
        r"""Return a state after whole numbers of periods.

        The sum :math:`\sum_j e^{-i \epsilon_j n T / \hbar} \langle j | \psi \rangle | j \rangle` of
        modes j with their quasienergies.

        Parameters
        ----------
        psi : array_like, shape (N,)
            The state at the beginning of a period.
        periods : array_like of int, shape () or (k,)
            How many periods later, negative ones too.

        Returns
        -------
        ndarray of complex, shape (N,) or (k, N)
            The states.

        Raises
        ------
        TypeError
            Periods are not whole numbers.
        ValueError
            psi has another shape.
        """
        state, count = np.asarray(psi, complex), np.asarray(periods)
        if state.shape != (len(self.modes),):
            raise misshapen("psi", state.shape, f"({len(self.modes)},)")
        if count.dtype.kind not in "iu":
            raise TypeError(f"periods must be whole numbers, not {periods!r}")
        angles = np.multiply.outer(count, self.quasienergies * self.period / self.hbar)
        found: Array = (np.exp(-1j * angles) * (self.modes.conj() @ state)) @ self.modes
        return found

    def __repr__(self) -> str:
        """Give the number of modes and the period."""
        return f"<Floquet: {len(self.modes)} modes of a period of {self.period:g}>"


def floquet(
    system: Schrodinger,
    period: float,
    method: WaveMethod | str = "auto",
    *,
    t0: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    h: float | None = None,
    steps: int | None = None,
    threads: int | None = None,
) -> Floquet:
    r"""Find the quasi-energies and modes of an equation whose H is periodic in time.

    Parameters
    ----------
    system : Schrodinger
        A linear equation of at most 4096 components.
    period : float
        T, positive.
    method : Method or "auto"
        As :func:`liouville.integrate` has it; for the states after n periods set its tolerance to
        one over n of that which is wanted.
    t0 : float, default 0.0
        When the period begins.
    params, h, steps, threads
        As :func:`propagator` has them.

    Returns
    -------
    Floquet

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind, the equation is not linear or too large, or a function of
        time is not the same a period later.
    ImportError
        SciPy is not installed.

    Notes
    -----
    U over a period is replaced by the nearest unitary matrix, whose Schur form is diagonal, so that
    modes are orthonormal, also where quasi-energies are equal.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import liouville as lv
    >>> drive = [(lambda t, params: 0.5 * ca.cos(t), [[0, 1], [1, 0]])]
    >>> qubit = lv.Schrodinger([[0, 0], [0, 1]], drive=drive)
    >>> modes = lv.analysis.floquet(qubit, 2 * np.pi)
    >>> far = modes.after([1, 0], 1000)
    >>> bool(abs(np.linalg.norm(far) - 1) < 1e-12)
    True
    """
    length = number("period must be a number", period)
    if not 0 < length < np.inf:
        raise ValueError(f"period must be positive, not {length:g}")
    begin = number("t0 must be a number", t0)
    system = _linear(system).with_params(params)
    _check_periodic(system, begin, length)
    options = {"h": h, "steps": steps, "threads": threads}
    u = _columns(system, method, (begin, begin + length), options)
    error = float(np.linalg.norm(u.conj().T @ u - np.eye(len(u)), 2))
    left, _, right = np.linalg.svd(u)
    form, vectors = scipy("linalg", "floquet").schur(left @ right, output="complex")
    angles = -np.angle(np.diag(form))
    angles[angles <= -np.pi] += 2 * np.pi
    order = np.argsort(angles)
    modes = np.ascontiguousarray(vectors.T[order])
    return Floquet(system.hbar * angles[order] / length, modes, length, system.hbar, error)


def _linear(system: Any) -> Schrodinger:
    """Return an equation that has a propagator of a size that is taken."""
    if not isinstance(system, Schrodinger):
        hint = "write lv.Schrodinger(...) of it"
        raise TypeError(hinted(f"the system must be a Schrodinger equation, not {system!r}", hint))
    system.check_plain("a propagator", "run the states that are wanted")
    if system.size > MOST:
        sentence = f"a propagator has at most {MOST} components, not {system.size}"
        raise ValueError(hinted(sentence, "run the states that are wanted by lv.ensemble"))
    return system


def _columns(
    system: Schrodinger,
    method: WaveMethod | str,
    t: tuple[float, float],
    options: Mapping[str, Any],
) -> Array:
    """Return the states at the end of a run from each unit vector, as columns."""
    times = times_of(t)
    if len(times) != 2:
        raise ValueError(f"t must be a pair (start, end), not {len(times)} times")
    run = ensemble(system, method, t=times, psi=np.eye(system.size), **options)
    found: Array = np.ascontiguousarray(run.psi[-1].T)
    return found


def _check_periodic(system: Schrodinger, t0: float, period: float) -> None:
    """Refuse an H that is another one a period later, as far as some times show it."""
    times = t0 + period * np.linspace(0, 1, LOOKS, endpoint=False)
    vector = np.random.default_rng(0).normal(size=system.hamiltonian.size)
    for t in times.tolist() if system.is_driven else []:
        now, later = (system.product_at(each)(vector) for each in (t, t + period))
        if np.linalg.norm(later - now) > ALIKE * np.linalg.norm(now):
            sentence = f"H is not periodic: at t = {t + period:g} it is not what it is at {t:g}"
            raise ValueError(hinted(sentence, "look at the period, and at the drives' parameters"))
