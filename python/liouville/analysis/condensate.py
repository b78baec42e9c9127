"""Ground states of a Schrödinger equation with a potential that depends on the density."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import Suggesting, hinted
from liouville._systems import Schrodinger

Array = NDArray[np.float64]

#: Most steps, and after how many products of T are made anew.
STEPS, RENEWED = 5000, 20

#: An energy may rise by so much of its parts: by roundoff.
ROUNDOFF = 1e-11

#: The longest step, an angle.
LONGEST = 1.0

#: A state with a larger share of its norm in the upper third of the wave numbers is not resolved.
SHARE = 1e-6

#: A start that no symmetry holds back, by so much.
NOISE = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class Condensate(Suggesting):
    r"""A state of norm 1 in which the energy is least, with a potential of the density.

    .. math::

        (H + W(\rho)) \psi = \mu \psi, \qquad
        \mathcal E = \langle \psi | H | \psi \rangle + \int \int_0^\rho W(r)\, dr\, dx

    Attributes
    ----------
    energy : float
        :math:`\mathcal E`.
    chemical_potential : float or ndarray
        :math:`\mu = \langle \psi | H + W | \psi \rangle`; of components with populations one for
        each, over its population.
    psi : ndarray, shape (N,)
        The state, of norm 1, real but for phases of components with a complex coupling.
    residual : float
        :math:`\|(H + W) \psi - \mu \psi\|`.
    products : float
        Products with H that it took.
    """

    energy: float
    chemical_potential: float | Array
    psi: NDArray[Any]
    residual: float
    products: float

    @property
    def start(self) -> dict[str, Any]:
        """The state by its name, for ``integrate(..., **ground.start)``."""
        return {"psi": self.psi}

    def __repr__(self) -> str:
        """Give the energy and the chemical potential."""
        mu = ", ".join(f"{each:.12g}" for each in np.atleast_1d(self.chemical_potential))
        energies = f"energy {self.energy:.12g}, chemical potential {mu}"
        return f"<Condensate: {energies}, residual {self.residual:.1e}>"


class _Energy:
    """The energy of a real state on a grid, and its derivatives; in units of hbar.

    States have an axis of components first. Their norm is 1, or that of each is its population.
    """

    def __init__(self, system: Schrodinger, t: float, populations: Array | None) -> None:
        assert system.grid is not None, "a nonlinearity is one on a grid"
        assert system.nonlinearity is not None, "a condensate has a nonlinearity"
        grid, self.hbar = system.grid, system.hbar
        self.shape = (system.components, *grid.shape)
        self._axes = tuple(range(1, len(self.shape)))
        self._nonlinearity, self._t = system.nonlinearity, t
        self.cell = grid.cell
        of_axes = grid.kinetic(self.hbar)
        self.kinetic = reduce(np.add, np.meshgrid(*of_axes, indexing="ij", sparse=True))
        self.potential = self.hbar * system.potential_at(t).reshape(self.shape)
        self.coupling = system.between
        self.populations = populations
        self._sizes = 1.0 if populations is None else populations.reshape(-1, *self._axes_of_one)
        lower = [np.abs(k) <= 2 / 3 * np.abs(k).max() for k in grid.k]
        self._is_upper = ~reduce(np.multiply, np.meshgrid(*lower, indexing="ij", sparse=True))

    @property
    def _axes_of_one(self) -> tuple[int, ...]:
        return (1,) * len(self._axes)

    def transformed(self, factor: Array, x: Array) -> Array:
        """Multiply by a function of the wave numbers."""
        found: Array = np.fft.ifftn(factor * np.fft.fftn(x, axes=self._axes), axes=self._axes).real
        return found

    def _of_density(self, x: Array, which: str) -> Array:
        function = getattr(self._nonlinearity, which)
        found: Array = function(self._t, (x**2 / self.cell).reshape(len(x), -1).T)
        return found

    def forces(self, x: Array) -> Array:
        """Return V + W at each point of each component."""
        found = self._of_density(x, "at").reshape(x[0].size, -1).T
        return self.potential + found.reshape(self.shape)

    def share(self, x: Array) -> float:
        """Return how much of a state is in the upper third of the wave numbers."""
        found = np.abs(np.fft.fftn(x, axes=self._axes)) ** 2
        return float(found[:, self._is_upper].sum() / found.sum())

    def mixed(self, x: Array) -> Array | float:
        """Return the product with the coupling."""
        return 0.0 if self.coupling is None else np.tensordot(self.coupling, x, 1)

    def mean(self, x: Array, y: Array) -> Array:
        """Return the inner product of all, or those of components of given populations."""
        each: Array = (x * y).sum(axis=self._axes, keepdims=True)
        return each.sum(axis=0, keepdims=True) if self.populations is None else each

    def length(self, x: Array) -> Array:
        """Return the norms of what has one, over the wanted ones."""
        return np.asarray(np.sqrt(self.mean(x, x) / self._sizes))

    def curvature(self, x: Array, u: Array) -> float:
        """Return the second derivative of the energy of the density along u."""
        y = (x * u).reshape(len(x), -1)
        slopes = self._of_density(x, "slope")
        return 4 * float(np.einsum("an,nab,bn", y, slopes, y)) / self.cell

    def __call__(self, x: Array, kinetic: Array) -> float:
        inner = float(np.vdot(x, kinetic + self.potential * x + self.mixed(x)))
        return inner + self.cell * float(self._of_density(x, "energy").sum())


def condensate(
    system: Schrodinger, t: float, tol: float, populations: Array | None = None
) -> Condensate:
    r"""Find the state of least energy by preconditioned conjugate gradients on the unit sphere.

    They go where imaginary time would, in fewer steps; `tol` is that of the residual, as a part of
    :math:`|\mu - \min V| + \langle T \rangle`. With populations each component has a sphere.

    Raises
    ------
    RuntimeError
        The tolerance was not reached, or the grid does not resolve the state.

    References
    ----------
    :cite:t:`antoine2017`.
    """
    energy = _Energy(system, t, populations)
    x = _first(energy)
    low = float(energy.potential.min())
    kinetic = energy.transformed(energy.kinetic, x)
    direction, before = np.zeros_like(x), (np.zeros_like(x), 1.0)
    for step in range(STEPS):
        w = energy.forces(x)
        product = kinetic + w * x + energy.mixed(x)
        mu = energy.mean(x, product) / energy.mean(x, x)
        residual = product - mu * x
        motion = float(np.vdot(x, kinetic))
        size = float(np.linalg.norm(residual))
        scale = max(float(np.abs(mu - low).max()), motion) + motion
        if size <= tol * scale:
            break
        z = _preconditioned(energy, x, residual, w - low, scale)
        ratio = max(0.0, float(np.vdot(residual - before[0], z)) / before[1]) if step else 0.0
        direction = ratio * direction - z
        direction -= energy.mean(x, direction) / energy.mean(x, x) * x
        if np.vdot(direction, residual) >= 0:
            direction = -z
        before = residual, float(np.vdot(residual, z))
        x, kinetic = _stepped(energy, (x, kinetic), (product, w - mu), direction)
        if not (step + 1) % RENEWED:
            kinetic = energy.transformed(energy.kinetic, x)
    else:
        sentence = f"the ground state is known to {size / scale:.1e} after {STEPS} steps"
        if energy.share(x) <= SHARE:
            raise RuntimeError(hinted(sentence, "give a larger tol="))
    if (share := energy.share(x)) > SHARE:
        sentence = (
            f"the grid does not resolve the ground state: {share:.1e} of it is in the upper third "
            "of the wave numbers"
        )
        hint = "an attractive nonlinearity may collapse; else take more points"
        raise RuntimeError(hinted(sentence, hint))
    signs = np.where(energy.mean(x, np.ones_like(x)) >= 0, 1.0, -1.0)
    psi = system.outward((signs * x).ravel())
    potentials = mu.ravel() if populations is not None else float(mu.item())
    return Condensate(energy(x, kinetic), potentials, psi, size, float(2 * step + 1))


def _first(energy: _Energy) -> Array:
    """Return a state where the potential is low."""
    flat = energy.potential.reshape(len(energy.potential), -1)
    above = flat - flat.min(axis=1, keepdims=True)
    tenth = np.sort(above)[:, above.shape[1] // 10, None]
    noise = np.random.default_rng(0).normal(size=above.shape)
    found = np.exp(-above / (2 * np.maximum(tenth, 1e-300))) * (1 + NOISE * noise)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    if energy.coupling is not None and energy.populations is None:
        weights = np.linalg.eigh(energy.coupling)[1][:, :1]
        found *= weights + NOISE * np.where(weights < 0, -1, 1)
    x: Array = found.reshape(energy.shape)
    return x / energy.length(x)


def _preconditioned(energy: _Energy, x: Array, residual: Array, w: Array, scale: float) -> Array:
    """Divide a residual by about T + w on both sides, within the tangents at x."""
    root = 1 / np.sqrt(1 + np.maximum(w, 0) / scale)
    factor = 1 / (scale + energy.kinetic)

    def divided(y: Array) -> Array:
        found: Array = root * energy.transformed(factor, root * y)
        return found

    z, normal = divided(residual), divided(x)
    found: Array = z - energy.mean(x, z) / energy.mean(x, normal) * normal
    return found


def _stepped(
    energy: _Energy, state: tuple[Array, Array], linear: tuple[Array, Array], direction: Array
) -> tuple[Array, Array]:
    """Return a state on the circle through x along a direction, and its product with T."""
    (x, kinetic), (product, above) = state, linear
    u = direction / np.linalg.norm(direction)
    moved = energy.transformed(energy.kinetic, u)
    slope = 2 * float(np.vdot(product, u))
    curvature = 2 * float(np.vdot(u, moved + above * u + energy.mixed(u)))
    curvature += energy.curvature(x, u)
    angle = min(-slope / curvature, LONGEST) if curvature > 0 else 0.1 * LONGEST
    motion = float(np.vdot(x, kinetic))
    now = energy(x, kinetic)
    while True:
        c, s = np.cos(angle), np.sin(angle)
        y = c * x + s * u
        size = energy.length(y)
        y, product = y / size, (c * kinetic + s * moved) / size
        if energy(y, product) <= now + ROUNDOFF * (abs(now) + motion) or angle < ROUNDOFF:
            return y, product
        angle /= 2
