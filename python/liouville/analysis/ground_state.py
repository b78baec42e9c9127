"""The state of least energy, by Lanczos' method, and how far its energy may be off."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._arguments import check_memory, number
from liouville._scipy import scipy
from liouville.errors import hinted
from liouville.systems import Schrodinger
from liouville.systems.schrodinger.foreign import check_sampled

Array = NDArray[np.float64]

#: The seed of the random start.
SEED = 1

#: Up to this size in the core all eigenvalues are found.
DENSE = 128

#: Vectors that Lanczos' method keeps, and how often it may begin again from the best of them.
KEPT, RESTARTS = 20, 1000

#: Roundoff of an energy, relative to the largest one.
ROUNDOFF = 2e-15

#: States that overlap by more than this are the same one.
SAME = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class GroundState:
    r"""The state of least energy.

    Attributes
    ----------
    energy : float
        :math:`\theta = \langle \psi | H | \psi \rangle`.
    psi : ndarray, shape (N,)
        The state, of norm 1; real if H is.
    bound : float
        :math:`r = \|H \psi - \theta \psi\|`: an energy is within r of :math:`\theta`.
    estimate : float
        How far the least energy is below :math:`\theta`: at most :math:`r^2` over the gap
        :cite:p:`kato1949`, which holds if the gap does. Never more than `bound`.
    gap : float
        The distance to the next energy, an estimate from above; infinite if there is no other
        state.
    products : float
        Products :math:`H \psi` that it took, two real ones each.
    """

    energy: float
    psi: NDArray[Any]
    bound: float
    estimate: float
    gap: float
    products: float

    @property
    def start(self) -> dict[str, NDArray[Any]]:
        """The state by its name, for ``integrate(..., **ground.start)``."""
        return {"psi": self.psi}

    def __repr__(self) -> str:
        """Give the energy, and how far it may be off."""
        return f"<GroundState of energy {self.energy:.12g}, off by about {self.estimate:.1e}>"


def ground_state(
    system: Schrodinger,
    *,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    tol: float = 1e-10,
) -> GroundState:
    r"""Find the state of least energy by Lanczos' method with restarts, from a random start.

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

    Returns
    -------
    GroundState
        Where several states have the least energy, one of them.

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind.
    RuntimeError
        The tolerance was not reached; the gap to the next energy is tiny then.
    MemoryError
        There is not enough memory for its vectors.
    ImportError
        SciPy is not installed.

    Notes
    -----
    A ground state of a sector is found by a system in this sector. In exact arithmetic an
    eigenvalue is within `bound` of the energy; that it is the least one is as good as certain from
    a random start, and not proven.

    References
    ----------
    :cite:t:`kato1949`, :cite:t:`lehoucq1998`.

    Examples
    --------
    >>> import liouville as lv
    >>> ring = lv.SpinSystem(8, ["xx", "yy", "zz"], periodic=True, up=4)
    >>> ground = lv.ground_state(lv.Schrodinger(ring))
    >>> round(ground.energy, 9)
    -3.651093409
    """
    system = wave(system).with_params(params)
    at, wanted = number("t is a number", t), number("tol is a number", tol)
    check_sampled(system.drives, at, at)
    if not 1e-14 <= wanted < 1:
        raise ValueError(f"tol = {wanted:g}: it is a number from 1e-14 to below 1")
    size = system.hamiltonian.size
    low, high = system.bounds_at(at) if system.is_driven else system.bounds
    counted = Counted(system.product_at(at))
    if size <= DENSE:
        values, vectors = np.linalg.eigh(np.stack([counted(row) for row in np.eye(size)], axis=1))
        values, vectors = values[:3], vectors[:, :3]
    else:
        hint = "find it in a sector"
        check_memory(f"the ground state of {system!r}", 8.0 * (KEPT + 8) * size, hint)
        # energies are below the bound: an eigenvalue's size is then that of the width
        values, vectors = _lowest(lambda x: counted(x) - high * x, size, wanted)
        values = values + high
    states = [_outward(system, vector) for vector in vectors.T]
    y = vectors[:, 0] / np.linalg.norm(vectors[:, 0])
    product = counted(y)
    theta = float(y @ product)
    roundoff = ROUNDOFF * max(abs(low), abs(high))
    residual = float(np.linalg.norm(product - theta * y)) + roundoff
    others = (
        float(value) - theta
        for value, state in zip(values[1:], states[1:], strict=True)
        if system.is_real or abs(np.vdot(states[0], state)) < SAME
    )
    gap = max(next(others, np.inf), 0.0)
    estimate = residual if gap <= residual else min(residual, residual**2 / gap + roundoff)
    scale = system.hbar
    return GroundState(
        scale * theta, states[0], scale * residual, scale * estimate, scale * gap,
        counted.count / 2,
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
        raise TypeError(hinted(f"the system is a Schrodinger equation, not {system!r}", hint))
    return system


def _lowest(product: Callable[[Array], Array], size: int, tol: float) -> tuple[Array, Array]:
    """Return the three least eigenvalues and their vectors, of a negative matrix."""
    linalg = scipy("sparse.linalg", "a ground state")
    operator = linalg.LinearOperator((size, size), matvec=product, dtype=float)
    start = np.random.default_rng(SEED).normal(size=size)
    try:
        values, vectors = linalg.eigsh(
            operator, k=3, which="SA", v0=start, tol=tol, ncv=KEPT, maxiter=RESTARTS
        )
    except linalg.ArpackNoConvergence:
        sentence = f"Lanczos' method did not reach tol = {tol:g} after {RESTARTS} restarts"
        raise RuntimeError(hinted(sentence, "give a larger tol=, or a sector")) from None
    order = np.argsort(values)
    return values[order], vectors[:, order]


def _outward(system: Schrodinger, vector: Array) -> NDArray[Any]:
    """Return a vector of the core as the user's state, of norm 1, real where it can be."""
    n = system.size
    inside = vector[:n] + 1j * vector[n:] if vector.size > n else vector + 0j
    state: NDArray[Any] = system.outward(inside)
    state = state / np.linalg.norm(state)
    return state if state.imag.any() else state.real.copy()
