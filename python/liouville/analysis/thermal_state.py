"""Thermal averages by random states in imaginary time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import check_memory, count, number
from liouville._basics.errors import Suggesting, hinted
from liouville._basics.scipy import scipy
from liouville._systems import Schrodinger
from liouville.analysis.ground_state import Array, Counted, lowest, wave

#: The sum of the terms that are left out, as a part of the norm of the random state.
TAIL = 1e-14

#: A term that is larger than its state by this factor shows an energy outside the bounds.
GROWN = 1.0 + 1e-6

#: Widths of the bounds, in units of 2 T, beyond which the lower one is to be the lowest energy.
COLD = 10.0

#: Gaps, in units of 2 T, beyond which states are ground states to roundoff.
FROZEN = 200.0


@dataclass(frozen=True, eq=False, repr=False)
class ThermalState(Suggesting):
    r"""Random states, whose weighted means are thermal averages.

    Attributes
    ----------
    temperature : float
        In units of energy.
    psi : ndarray, shape (R, N)
        States :math:`e^{-H/2T} r`, each of norm 1, for ``ensemble(..., **thermal.start)``.
    weights : ndarray, shape (R,)
        Their weights, of sum 1.
    energy, energy_error : float
        The mean energy, and the standard error of the mean over the states, an estimate.
    log_partition : float
        An estimate of :math:`\ln \operatorname{tr} e^{-H/T}`.
    bound : float
        An error that no state exceeds, in the norm, beside roundoff.
    products : float
        Products :math:`H \psi` that it took, two real ones each.
    """

    temperature: float
    psi: NDArray[Any]
    weights: Array
    energy: float
    energy_error: float
    log_partition: float
    bound: float
    products: float

    @property
    def start(self) -> dict[str, Any]:
        """The states by their name, for ``ensemble(..., **thermal.start)``."""
        return {"psi": self.psi}

    def mean(self, values: ArrayLike) -> NDArray[Any]:
        """Return the thermal average of values.

        Parameters
        ----------
        values : array_like, shape (..., P)
            An expectation of each of the P states, such as ``run.observed["m"]``.

        Returns
        -------
        ndarray, shape (...)
            The weighted means, real for real values.

        Raises
        ------
        ValueError
            The last axis is not one of P states.
        """
        found: NDArray[Any] = np.asarray(values) @ self.weights
        return found

    def error(self, values: ArrayLike) -> Array:
        """Return the standard error of :meth:`mean`, from the spread of the states.

        Parameters
        ----------
        values : array_like, shape (..., P)
            As for :meth:`mean`.

        Returns
        -------
        ndarray, shape (...)
            The errors, in the unit of the values.

        Raises
        ------
        ValueError
            The last axis is not one of P states.
        """
        return _standard_error(np.asarray(values), self.weights)

    def __repr__(self) -> str:
        """Give the temperature and the energy."""
        error = f"{self.energy:.6g} +- {self.energy_error:.1g}"
        return f"<ThermalState at T = {self.temperature:g}: {len(self.psi)} states, energy {error}>"


def thermal_state(
    system: Schrodinger,
    temperature: float,
    *,
    states: int = 10,
    seed: int = 0,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
) -> ThermalState:
    r"""Make random states in imaginary time, whose means are thermal averages.

    .. math::

        \frac{\operatorname{tr} A e^{-H/T}}{\operatorname{tr} e^{-H/T}} \approx
        \frac{\sum_r \langle \psi_r | A | \psi_r \rangle}{\sum_r \langle \psi_r | \psi_r \rangle},
        \qquad \psi_r = e^{-H / 2 T} r

    Parameters
    ----------
    system : Schrodinger
        The equation; of one that depends on time H at the time `t`.
    temperature : float
        T in units of energy, positive; infinite for states that are random alone.
    states : int, default 10
        How many random states R there are, of independent Gaussian numbers.
    seed : int, default 0
        Of the random numbers.
    t, params
        As :func:`ground_state` has them.

    Returns
    -------
    ThermalState

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind.
    RuntimeError
        An energy is outside the bounds of the system.
    MemoryError
        There is not enough memory for the states.
    ImportError
        SciPy is not installed.

    Notes
    -----
    The exponential is a Chebyshev series with modified Bessel functions, whose terms left out are
    known beforehand. Of a cold state the lowest energy is found first, as :func:`ground_state`
    does. The statistical error falls as one over the root of R times the number of
    states that are thermally occupied, so that few states do for a large system that is not cold.

    References
    ----------
    :cite:t:`jaklic1994`, :cite:t:`sugiura2013`.

    Examples
    --------
    >>> import liouville as lv
    >>> chain = lv.Schrodinger(lv.SpinSystem(10, ["xx", "yy", "zz"]))
    >>> hot = lv.analysis.thermal_state(chain, 1e6, states=20)
    >>> abs(hot.energy) < 4 * hot.energy_error
    True
    """
    system = wave(system).with_params(params)
    warmth = number("temperature must be a number", temperature)
    if not warmth > 0:
        raise ValueError(f"temperature must be positive, not {warmth:g}")
    system.check_plain("a thermal state", "leave it out")
    rows, at = count("states", states), number("t must be a number", t)
    size = system.hamiltonian.size
    what = f"{rows} thermal states of {system!r}"
    check_memory(what, 16.0 * rows * system.size + 48.0 * size, "take fewer states, or a sector")
    low, high = system.bounds_at(at) if system.is_driven else system.bounds
    tau = system.hbar / (2 * warmth)
    products, inverse = 0.0, tau
    if tau * (high - low) > COLD:
        # e^{-tau (E0 - low)} is to be no small number: the lowest energy is found, not bounded
        ground = lowest(system, at)
        low, products = (ground.energy - 2 * ground.bound) / system.hbar, ground.products
        gap = ground.gap / system.hbar
        # longer ones change the states by less than roundoff
        tau = min(tau, FROZEN / gap) if gap > 0 else tau
    half = max((high - low) / 2, 1e-300)
    factors, tail = coefficients(tau * half)
    counted = Counted(system.product_at(at))
    rng = np.random.default_rng(seed)
    psi = np.empty((rows, system.size), complex)
    weights, energies, off = np.empty(rows), np.empty(rows), np.empty(rows)
    for k in range(rows):
        start = rng.normal(size=size)
        found = cooled(counted, start, factors, (low + high) / 2, half)
        weights[k] = found @ found
        off[k] = tail * float(np.linalg.norm(start) / np.sqrt(weights[k]))
        found /= np.sqrt(weights[k])
        energies[k] = system.hbar * float(found @ counted(found))
        psi[k] = found if size == system.size else found[: system.size] + 1j * found[system.size :]
    psi = system.outward(psi)
    psi = psi if psi.imag.any() else psi.real.copy()
    mean = float(weights.mean()) * (system.size / size)
    weights = weights / weights.sum()
    return ThermalState(
        warmth, psi, weights, float(energies @ weights),
        float(_standard_error(energies, weights)),
        float(np.log(mean)) - 2 * inverse * low, float(off.max()), products + counted.count / 2,
    )  # fmt: skip


def coefficients(x: float) -> tuple[Array, float]:
    r"""Return coefficients of :math:`e^{-x (X + 1)}` in Chebyshev polynomials, and their rest.

    .. math::

        e^{-x (X + 1)} = \sum_k (2 - \delta_{k0}) (-1)^k e^{-x} I_k(x)\, T_k(X)
    """
    special = scipy("special", "a thermal state")
    most = int(20 + 12 * np.sqrt(x) + min(2 * x, 60.0))
    k = np.arange(most + 1)
    terms = 2.0 * special.ive(k, x)
    left = np.append(np.cumsum(terms[::-1])[::-1][1:], 0.0)
    last = int(np.argmax(left <= TAIL))
    factors = terms[: last + 1] * (-1.0) ** k[: last + 1]
    factors[0] /= 2
    return factors, float(max(left[last], TAIL))


def cooled(counted: Counted, v: Array, factors: Array, middle: float, half: float) -> Array:
    """Return the series of a vector by these coefficients."""
    size = float(np.linalg.norm(v))
    before, now = v, (counted(v) - middle * v) / half
    found: Array = factors[0] * before
    if factors.size > 1:
        found += factors[1] * now
    for factor in factors[2:].tolist():
        before, now = now, 2 / half * (counted(now) - middle * now) - before
        found += factor * now
    if not float(np.linalg.norm(now)) <= GROWN * size:
        sentence = "an energy lies outside the bounds of the system"
        raise RuntimeError(hinted(sentence, "give the system bounds='gershgorin', or wider ones"))
    return found


def _standard_error(values: NDArray[Any], weights: Array) -> Array:
    """Return the standard error of a ratio of means."""
    rows = weights.size
    if rows == 1:
        return np.full(values.shape[:-1], np.inf)
    apart = np.abs(values - (values @ weights)[..., None]) * weights
    found: Array = np.sqrt((apart**2).sum(axis=-1) * rows / (rows - 1))
    return found
