"""A wave function in imaginary time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import number
from liouville._basics.errors import Suggesting
from liouville._systems import Schrodinger
from liouville.analysis.ground_state import Array, Counted, lowest, wave
from liouville.analysis.thermal_state import COLD, coefficients, cooled

#: A part of the time is halved where it leaves less of a state: roundoff grows as one over it.
LEAST = 1e-4

#: A state that H changes by no more, in widths of the energies, is an eigenstate to roundoff.
STILL = 1e-13

#: No part is longer, in units of one over half the width of the energies.
LONGEST = 1e8


@dataclass(frozen=True, eq=False, repr=False)
class Cooled(Suggesting):
    r"""A state after a time :math:`\tau` in imaginary time.

    Attributes
    ----------
    psi : ndarray, shape (N,)
        :math:`e^{-\tau H / \hbar} \psi`, of norm 1; real if H and the start are.
    log_norm : float
        The logarithm of what the norm of that is, over the norm of the start.
    energy : float
        :math:`\langle \psi | H | \psi \rangle`.
    bound : float
        An error that `psi` does not exceed, beside roundoff.
    products : float
        Products :math:`H \psi` that it took, two real ones each.
    """

    psi: NDArray[Any]
    log_norm: float
    energy: float
    bound: float
    products: float

    @property
    def start(self) -> dict[str, Any]:
        """The state by its name, for ``integrate(..., **cooled.start)``."""
        return {"psi": self.psi}

    def __repr__(self) -> str:
        """Give the energy."""
        return f"<Cooled: energy {self.energy:.12g}>"


def imaginary_time(
    system: Schrodinger,
    tau: float,
    *,
    psi: ArrayLike,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
) -> Cooled:
    r"""Move a state in imaginary time, :math:`\hbar\, \partial_\tau \psi = -H \psi`.

    Parameters
    ----------
    system : Schrodinger
        A linear equation; of one that depends on time H at the time `t`.
    tau : float
        How long, not negative.
    psi : array_like
        The start, as :func:`liouville.integrate` has it.
    t, params
        As :func:`ground_state` has them.

    Returns
    -------
    Cooled

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind, or the equation is not linear.
    RuntimeError
        An energy is outside the bounds of the system.
    ImportError
        SciPy is not installed.

    Notes
    -----
    The exponential is a Chebyshev series with modified Bessel functions, whose terms left out are
    known beforehand. Of a long time the least energy is found first, as :func:`ground_state` does.
    The time is cut into parts that leave 1e-4 of the state or more, which is normalised between
    them, so that `psi` has ten digits however small the exponential is.
    A lower state that a symmetry keeps out of the start comes in by roundoff, and outgrows it.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> qubit = lv.Schrodinger(np.diag([0.0, 1.0]))
    >>> cool = lv.analysis.imaginary_time(qubit, 2.0, psi=[1, 1])
    >>> round(float(cool.psi[1] / cool.psi[0]), 9)  # exp(-2)
    0.135335283
    """
    system = wave(system).with_params(params)
    system.check_plain("imaginary time", "leave it out, or take ground_state of a condensate")
    left, at = number("tau must be a number", tau), number("t must be a number", t)
    if not 0 <= left < np.inf:
        raise ValueError(f"tau must be finite and not negative, not {left:g}")
    state = system.inward(psi)
    size = float(np.linalg.norm(state))
    low, high = system.bounds_at(at) if system.is_driven else system.bounds
    products, log_norm, bound, gap = 0.0, 0.0, 0.0, 0.0
    if left * (high - low) > COLD:
        # exp(-tau (H - low)) is to be no small number of the state of least energy
        ground = lowest(system, at)
        low, products = (ground.energy - 2 * ground.bound) / system.hbar, ground.products
        gap = ground.gap / system.hbar
    half = max((high - low) / 2, 1e-300)
    counted = Counted(system.product_at(at))
    y = _parts_of(system, state / size)
    part = min(left, LONGEST / half)
    while left > 0:
        part = min(part, left)
        factors, tail = coefficients(part * half)
        found = np.array([cooled(counted, x, factors, (low + high) / 2, half) for x in y])
        now = float(np.linalg.norm(found))
        if now < LEAST:
            part /= 2
            continue
        log_norm += math.log(now) - part * low
        bound += tail / now
        y, left = found / now, left - part
        part = min(2 * part, LONGEST / half)
        level, residual = _level(counted, y)
        if left > 0 and residual <= STILL * 2 * half:
            # an eigenstate to roundoff stays what it is, the lowest one whatever the time
            log_norm -= left * level
            is_lowest = gap > 0 and level < low + gap / 2
            bound += residual / gap if is_lowest else min(2.0, residual * left)
            break
    energy = system.hbar * _level(counted, y)[0]
    found = system.outward(_state_of(system, y))
    kept = found if found.imag.any() else found.real.copy()
    return Cooled(kept, log_norm, energy, bound, products + counted.count / 2)


def _parts_of(system: Schrodinger, state: NDArray[Any]) -> Array:
    """Return the real vectors that the core's products move, as rows."""
    q, p = state.real, state.imag
    if system.hamiltonian.size > system.size:
        return np.concatenate([q, p])[None]
    return np.array([q, p]) if p.any() else q[None].copy()


def _state_of(system: Schrodinger, y: Array) -> NDArray[Any]:
    """Return the state of these vectors."""
    if system.hamiltonian.size > system.size:
        y = y[0].reshape(2, -1)
    found: NDArray[Any] = y[0] + 1j * y[1] if len(y) == 2 else y[0] + 0j
    return found


def _level(counted: Counted, y: Array) -> tuple[float, float]:
    r"""Return the energy of a state and the norm of :math:`(H - E) y`."""
    product = np.array([counted(x) for x in y])
    level = float(np.vdot(y, product))
    return level, float(np.linalg.norm(product - level * y))
