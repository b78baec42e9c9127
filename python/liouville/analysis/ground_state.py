"""The states of least energy, by Lanczos' method, and how far their energy may be off."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import number
from liouville._basics.errors import Suggesting, hinted, misshapen
from liouville._systems import Schrodinger
from liouville._systems.tracing.trace import numbers
from liouville._systems.waves.foreign import check_sampled
from liouville._systems.waves.nonlinearity import Nonlinearity
from liouville.analysis.condensate import Condensate, condensate
from liouville.analysis.lowest_level import RESTARTS, Scale, lowest_level

Array = NDArray[np.float64]

#: Roundoff of an energy, relative to the largest one.
ROUNDOFF = 2e-15


@dataclass(frozen=True, eq=False, repr=False)
class GroundState(Suggesting):
    r"""The states of least energy.

    Attributes
    ----------
    energy : float
        :math:`\theta = \langle \psi | H | \psi \rangle`.
    psi : ndarray, shape (N,)
        A state, of norm 1; real if H is.
    states : ndarray, shape (multiplicity, N)
        All states with this energy, orthonormal, `psi` first.
    bound : float
        :math:`r = \|H \psi - \theta \psi\|`: an energy is within r of :math:`\theta`.
    estimate : float
        How far the least energy is below :math:`\theta`: at most :math:`r^2` over the gap
        :cite:p:`kato1949`, which holds if the gap does. Never more than `bound`.
    gap : float
        The distance to the next level, an estimate from above. Infinite if there is none; 0 if
        none was told apart, so that `states` may not be all.
    products : float
        Products :math:`H \psi` that it took; one of a real vector is a half.
    """

    energy: float
    psi: NDArray[Any]
    states: NDArray[Any]
    bound: float
    estimate: float
    gap: float
    products: float

    @property
    def multiplicity(self) -> int:
        """How many states have this energy; where `gap` is 0, at least so many."""
        return len(self.states)

    @property
    def start(self) -> dict[str, Any]:
        """The state by its name, for ``integrate(..., **ground.start)``."""
        return {"psi": self.psi}

    def __repr__(self) -> str:
        """Give the energy, and how far it may be off."""
        many = f"{self.multiplicity}{'' if self.gap else ' or more'} states, "
        many = "" if self.multiplicity == 1 and self.gap else many
        return f"<GroundState: {many}energy {self.energy:.12g}, off by about {self.estimate:.1e}>"


@overload
def ground_state(
    system: Schrodinger[None],
    *,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    tol: float = 1e-10,
) -> GroundState: ...
@overload
def ground_state(
    system: Schrodinger[Nonlinearity],
    *,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    tol: float = 1e-10,
    populations: ArrayLike | None = None,
) -> Condensate: ...
def ground_state(
    system: Schrodinger,
    *,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    tol: float = 1e-10,
    populations: ArrayLike | None = None,
) -> GroundState | Condensate:
    r"""Find the states of least energy by block Lanczos with restarts, from random starts.

    With a nonlinearity conjugate gradients find one state of norm 1, which solves
    :math:`(H + W(\rho)) \psi = \mu \psi`, and `tol` is that of its residual as a part of
    :math:`|\mu - \min V| + \langle T \rangle`.

    Parameters
    ----------
    system : Schrodinger
        The equation; of one that depends on time H at the time `t`.
    t : float, default 0.0
        The time.
    params : mapping of str to array_like, optional
        Changed values of parameters.
    tol : float, default 1e-10
        How small :math:`\|H \psi - \theta \psi\|` is to become, as a part of the width of the
        spectrum; the error of the energy is about its square.
    populations : array_like, optional
        The squared norm of each component with a nonlinearity that no coupling changes, 1 in all.

    Returns
    -------
    GroundState or Condensate
        The energy, all states that have it, and the gap to the next level; or with a nonlinearity
        the energy, the chemical potential and the state.

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind.
    RuntimeError
        The tolerance was not reached; the gap to the next energy is tiny then. A condensate
        collapses, or has structures finer than the grid.
    MemoryError
        There is not enough memory for its vectors.

    Notes
    -----
    A ground state of a sector is found by a system in this sector. In exact arithmetic an
    eigenvalue is within `bound` of the energy; that it is the least one is as good as certain from
    a random start, and not proven.

    A Krylov space of one vector has one state of each level. Blocks of vectors double while the
    states found of the lowest level are not fewer than a block has, up to 96. Energies are one
    level where they are apart by less than 1e-9 of the width of the spectrum.

    References
    ----------
    :cite:t:`kato1949`; :cite:t:`golub1977` for blocks, :cite:t:`wu2000` for restarts.

    Examples
    --------
    >>> import liouville as lv
    >>> ring = lv.SpinSystem(8, ["xx", "yy", "zz"], periodic=True, up=4)
    >>> ground = lv.analysis.ground_state(lv.Schrodinger(ring))
    >>> round(ground.energy, 9), ground.multiplicity
    (-3.651093409, 1)
    """
    system = wave(system).with_params(params)
    at, wanted = number("t must be a number", t), number("tol must be a number", tol)
    check_sampled(system.drives, at, at)
    if not 1e-14 <= wanted < 1:
        raise ValueError(f"tol must be from 1e-14 to below 1, not {wanted:g}")
    if system.absorber is not None:
        system.check_plain("a ground state", "leave it out")
    if system.nonlinearity is not None:
        if system.drives:
            hint = "give the drive as a potential of t and x"
            raise TypeError(hinted("a condensate takes no drive by matrices", hint))
        return condensate(system, at, wanted, _populations(system, populations))
    if populations is not None:
        raise TypeError("populations= are those of components with a nonlinearity")
    return lowest(system, at, wanted)


def _populations(system: Schrodinger, given: ArrayLike | None) -> NDArray[np.float64] | None:
    """Read the populations of components, which are kept where nothing couples these."""
    if system.components == 1 or system.mixes:
        if given is not None and system.components == 1:
            raise TypeError("populations= are those of components=, and there is one")
        if given is not None:
            hint = "they are found with the state, as their coupling changes them"
            raise TypeError(hinted("populations= are those of components without coupling", hint))
        return None
    count = system.components
    if given is None:
        hint = f"give populations={[round(1 / count, 3)] * count}, or a coupling"
        raise TypeError(hinted("populations are missing: nothing couples the components", hint))
    found = numbers(given)
    if found is None:
        raise TypeError(f"populations must be real numbers, not {given!r}")
    if found.shape != (count,):
        raise misshapen("populations", np.shape(given), (count,))
    if not ((found > 0).all() and abs(found.sum() - 1) < 1e-9):
        raise ValueError(f"populations must be positive and 1 in all, not {found.tolist()}")
    return found


def lowest(system: Schrodinger, at: float, wanted: float = 1e-10) -> GroundState:
    """Find the states of least energy of a linear equation at a time, to a tolerance."""
    low, high = system.bounds_at(at) if system.is_driven else system.bounds
    counted = Counted(system.product_at(at))
    is_real = system.hamiltonian.size == system.size

    def shifted(x: NDArray[Any]) -> NDArray[Any]:
        """Make a product, in the core's form; below the bound energies have the width's size."""
        if is_real:
            return counted(x) - high * x
        return counted(np.concatenate([x.real, x.imag])).reshape(2, -1).T @ [1, 1j] - high * x

    scale = Scale.of(low, high, ROUNDOFF)
    level = lowest_level(shifted, system.size, scale, wanted, is_real=is_real)
    if level is None:
        sentence = f"Lanczos' method did not reach tol = {wanted:g} after {RESTARTS} restarts"
        raise RuntimeError(hinted(sentence, "give a larger tol=, or a sector"))
    y = level.vectors[:, 0] / np.linalg.norm(level.vectors[:, 0])
    product = shifted(y)
    theta = float(np.vdot(y, product).real)
    residual = float(np.linalg.norm(product - theta * y)) + scale.roundoff
    estimate = residual
    if level.gap > residual:
        estimate = min(residual, residual**2 / level.gap + scale.roundoff)
    found = [_outward(system, vector) for vector in level.vectors.T]
    return GroundState(
        system.hbar * (theta + high), found[0], np.array(found), system.hbar * residual,
        system.hbar * estimate, system.hbar * level.gap, counted.count / (2 if is_real else 1),
    )  # fmt: skip


class Counted:
    """A product that counts its calls."""

    def __init__(self, product: Callable[[Array], Array]) -> None:
        self.product, self.count = product, 0

    def __call__(self, x: Array) -> Array:
        """Make a product."""
        self.count += 1
        return self.product(np.ascontiguousarray(x.ravel()))


def wave(system: Any) -> Schrodinger:
    """Return a Schrödinger equation; TypeError if it is none."""
    if not isinstance(system, Schrodinger):
        hint = "write lv.Schrodinger(...) of it"
        raise TypeError(hinted(f"the system must be a Schrodinger equation, not {system!r}", hint))
    return system


def _outward(system: Schrodinger, vector: NDArray[Any]) -> NDArray[Any]:
    """Return a vector of the core as the user's state, of norm 1, real where it can be."""
    state: NDArray[Any] = system.outward(vector + 0j)
    state = state / np.linalg.norm(state)
    return state if state.imag.any() else state.real.copy()
