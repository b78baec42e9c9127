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
    chemical_potential : float
        :math:`\mu = \langle \psi | H + W | \psi \rangle`.
    psi : ndarray, shape (N,)
        The state, real and of norm 1.
    residual : float
        :math:`\|(H + W) \psi - \mu \psi\|`.
    products : float
        Products with H that it took.
    """

    energy: float
    chemical_potential: float
    psi: Array
    residual: float
    products: float

    @property
    def start(self) -> dict[str, Any]:
        """The state by its name, for ``integrate(..., **ground.start)``."""
        return {"psi": self.psi}

    def __repr__(self) -> str:
        """Give the energy and the chemical potential."""
        mu = f"chemical potential {self.chemical_potential:.12g}"
        return f"<Condensate: energy {self.energy:.12g}, {mu}, residual {self.residual:.1e}>"


class _Energy:
    """The energy of a real state on a grid, and its derivatives; in units of hbar."""

    def __init__(self, system: Schrodinger, t: float) -> None:
        assert system.grid is not None, "a nonlinearity is one on a grid"
        assert system.nonlinearity is not None, "a condensate has a nonlinearity"
        grid, self.shape, self.hbar = system.grid, system.grid.shape, system.hbar
        self._nonlinearity, self._t = system.nonlinearity, t
        self.cell = grid.cell
        of_axes = grid.kinetic(self.hbar)
        self.kinetic = reduce(np.add, np.meshgrid(*of_axes, indexing="ij", sparse=True))
        self.potential = self.hbar * system.potential_at(t).reshape(self.shape)
        lower = [np.abs(k) <= 2 / 3 * np.abs(k).max() for k in grid.k]
        self._is_upper = ~reduce(np.multiply, np.meshgrid(*lower, indexing="ij", sparse=True))

    def transformed(self, factor: Array, x: Array) -> Array:
        """Multiply by a function of the wave numbers."""
        found: Array = np.fft.ifftn(factor * np.fft.fftn(x)).real
        return found

    def of_density(self, x: Array, which: str) -> Array:
        """Return W, its energy or its slope at each point."""
        function = getattr(self._nonlinearity, which)
        found: Array = function(self._t, (x**2 / self.cell).reshape(-1, 1)).reshape(self.shape)
        return found

    def share(self, x: Array) -> float:
        """Return how much of a state of norm 1 is in the upper third of the wave numbers."""
        found = np.abs(np.fft.fftn(x)) ** 2
        return float(found[self._is_upper].sum() / found.sum())

    def __call__(self, x: Array, kinetic: Array) -> float:
        inner = float(np.vdot(x, kinetic + self.potential * x))
        return inner + self.cell * float(self.of_density(x, "energy").sum())


def condensate(system: Schrodinger, t: float, tol: float) -> Condensate:
    r"""Find the state of least energy by preconditioned conjugate gradients on the unit sphere.

    They go where imaginary time would, in fewer steps; `tol` is that of the residual, as a part of
    :math:`|\mu - \min V| + \langle T \rangle`.

    Raises
    ------
    RuntimeError
        The tolerance was not reached, or the grid does not resolve the state.

    References
    ----------
    :cite:t:`antoine2017`.
    """
    energy = _Energy(system, t)
    x = _first(energy)
    low = float(energy.potential.min())
    kinetic = energy.transformed(energy.kinetic, x)
    direction, before = np.zeros_like(x), (np.zeros_like(x), 1.0)
    for step in range(STEPS):
        w = energy.potential + energy.of_density(x, "at")
        product = kinetic + w * x
        mu = float(np.vdot(x, product))
        residual = product - mu * x
        motion = float(np.vdot(x, kinetic))
        size = float(np.linalg.norm(residual))
        scale = max(abs(mu - low), motion) + motion
        if size <= tol * scale:
            break
        z = _preconditioned(energy, x, residual, w - low, scale)
        ratio = max(0.0, float(np.vdot(residual - before[0], z)) / before[1]) if step else 0.0
        direction = ratio * direction - z
        direction -= np.vdot(x, direction) * x
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
    psi = x.ravel() * (1.0 if x.sum() >= 0 else -1.0)
    return Condensate(energy(x, kinetic), mu, psi, size, float(2 * step + 1))


def _first(energy: _Energy) -> Array:
    """Return a state where the potential is low."""
    above = energy.potential - energy.potential.min()
    tenth = np.sort(above.ravel())[above.size // 10]
    noise = np.random.default_rng(0).normal(size=energy.shape)
    found: Array = np.exp(-above / (2 * max(tenth, 1e-300))) * (1 + NOISE * noise)
    return found / np.linalg.norm(found)


def _preconditioned(energy: _Energy, x: Array, residual: Array, w: Array, scale: float) -> Array:
    """Divide a residual by about T + w on both sides, within the tangents at x."""
    root = 1 / np.sqrt(1 + np.maximum(w, 0) / scale)
    factor = 1 / (scale + energy.kinetic)

    def divided(y: Array) -> Array:
        found: Array = root * energy.transformed(factor, root * y)
        return found

    z, normal = divided(residual), divided(x)
    found: Array = z - np.vdot(x, z) / np.vdot(x, normal) * normal
    return found


def _stepped(
    energy: _Energy, state: tuple[Array, Array], linear: tuple[Array, Array], direction: Array
) -> tuple[Array, Array]:
    """Return a state on the circle through x along a direction, and its product with T."""
    (x, kinetic), (product, above) = state, linear
    u = direction / np.linalg.norm(direction)
    moved = energy.transformed(energy.kinetic, u)
    slope = 2 * float(np.vdot(product, u))
    curvature = 2 * float(np.vdot(u, moved + above * u))
    curvature += 4 * float(np.vdot((x * u) ** 2, energy.of_density(x, "slope"))) / energy.cell
    angle = min(-slope / curvature, LONGEST) if curvature > 0 else 0.1 * LONGEST
    motion = float(np.vdot(x, kinetic))
    now = energy(x, kinetic)
    while True:
        c, s = np.cos(angle), np.sin(angle)
        y = c * x + s * u
        size = np.linalg.norm(y)
        y, product = y / size, (c * kinetic + s * moved) / size
        if energy(y, product) <= now + ROUNDOFF * (abs(now) + motion) or angle < ROUNDOFF:
            return y, product
        angle /= 2
