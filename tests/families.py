"""Problems of the registry beside holonomic mechanics, and what is asked of any problem.

Nonholonomic constraints that see what a blade on a plane hides: `pace` is quadratic in the velocity
and depends on time, with a mass that depends on position; the disk has two; `bowl` has a holonomic
and a nonholonomic one, both of which depend on time, and a force that follows the velocity. A rod
on a pivot that swings, which the fast path of RATTLE takes. A system of index 2 that is nonlinear
in z and whose constraint moves. Fields with diagonal terms, and without. Wave functions on a
lattice, on a lattice that is driven, and on a grid whose potential moves.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from index2_systems import nonlinear, nonlinear_at
from ordinary import propagated

import liouville as lv
from liouville._systems import Mechanics
from liouville.problems import load

#: The method of order 16 that gives exact motions of mechanics.
GAUSS_16 = lv.Spark(8)

#: Methods that choose their own steps.
TOLERANT = (lv.SchrodingerSplitting, lv.Chebyshev, lv.Lanczos)


@dataclass(frozen=True)
class Problem:
    """A system, a start, and steps for orders 2, 4, ... that are fine enough, and above roundoff.

    What cannot be kept on it, because the motion itself does not, is `lost`. `plain` is the same
    system written down again, where it is one of second order. Methods with steps of their own
    take `finer` times as many. Errors below `floor` are roundoff, and `step` is one in which a
    motion shows. The motion is known by `exact(t)`, or by a method of high order.
    """

    system: Any
    start: dict[str, Any]
    t: tuple[float, float]
    steps: tuple[tuple[int, ...], ...] = ()
    lost: tuple[str, ...] = ()
    plain: Any = None
    finer: float = 1
    floor: float = 2e-14
    step: float = 0.15
    exact: Any = None
    best: Any = GAUSS_16
    best_steps: int = 64

    @property
    def of(self):
        """The states that have an order: with multipliers, in mechanics."""
        states = self.system.states
        return (*states, "lam") if isinstance(self.system, Mechanics) else states

    def run(self, method, steps, t=None, start=None, **more):
        """Integrate with so many steps, or with those that the method chooses."""
        count = {} if isinstance(method, TOLERANT) else {"steps": steps}
        start = self.start if start is None else start
        return lv.integrate(self.system, method, t=t or self.t, **count, **start, **more)

    def end(self):
        """Return the states at the end of the exact motion."""
        if self.exact is not None:
            return self.exact(self.t[1])
        found = self.run(self.best, self.best_steps)
        return {state: found.states[state][-1] for state in self.of}


# --- mechanics -----------------------------------------------------------------------------------


def knife_edge():
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 + q[0],
        nonholonomic=lambda t, q, v, params: ca.sin(q[2]) * v[0] - ca.cos(q[2]) * v[1],
        q=("x", "y", "th"),
    )


def rolling_disk():
    return lv.Lagrangian(
        lambda t, q, v, params: (
            ca.sumsqr(v[:2]) / 2 + v[2] ** 2 / 4 + v[3] ** 2 / 8 - q[0] / 2 - ca.cos(q[3]) / 3
        ),
        nonholonomic=lambda t, q, v, params: {
            "rolls along x": v[0] - ca.cos(q[3]) * v[2],
            "rolls along y": v[1] - ca.sin(q[3]) * v[2],
        },
        q=("x", "y", "th", "ph"),
    )


def pace():
    return lv.Lagrangian(
        lambda t, q, v, params: (
            (1 + q[0] ** 2 / 4) * ca.dot(v, v) / 2 - q[2] - ca.sin(q[1]) * v[0] / 3
        ),
        nonholonomic=lambda t, q, v, params: {
            "speed": (ca.dot(v, v) - (1 + ca.sin(t) / 5) ** 2) / 2
        },
        q=("x", "y", "z"),
    )


def bowl():
    def blade(t, q, v, params):
        angle = q[3] + t / 3
        return {"blade": ca.sin(angle) * v[0] - ca.cos(angle) * v[1] + ca.sin(t) / 5}

    return lv.Lagrangian(
        lambda t, q, v, params: (
            ca.sumsqr(v[:3]) / 2 + (1 + q[0] ** 2 / 3) * v[3] ** 2 / 2 - q[2] - ca.cos(q[3]) / 2
        ),
        lambda t, q, params: {"bowl": q[2] - (1 + ca.sin(t) / 5) * ca.sumsqr(q[:2]) / 2},
        nonholonomic=blade,
        force=lambda t, q, v, params: -v / 10 + ca.vertcat(0, 0, 0, q[0]),
        q=("x", "y", "z", "th"),
    )


def rolling(system, q, v, finer):
    """Return a nonholonomic problem; the motion itself keeps no symplectic form."""
    counts = (64, 128, 256), (16, 32, 64), (10, 16, 26), (8, 10, 12)
    steps = tuple(tuple(int(k * finer) for k in each) for each in counts)
    start = system.consistent(q=q, v=v)
    return Problem(system, start, (0.0, 2.0), steps, lost=("symplectic form",))


def swinging_rod():
    """Return a rod that breathes on a pivot that swings, its mass full and its force in time."""
    mass = ca.DM([[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 1.5]])

    def constraint(t, q, params):
        arm = q - ca.vertcat(ca.sin(2 * t) / 5, 0, 0)
        return (ca.sumsqr(arm) - (1 + ca.cos(3 * t) / 10) ** 2) / 2

    system = lv.Lagrangian(
        lambda t, q, v, params: ca.bilin(mass, v, v) / 2 - q[2] - q[1] ** 4 / 4 + ca.sin(t) * q[0],
        constraint,
        q=3,
    )
    start = system.consistent(q=[0.6, 0.2, -0.9], v=[0.1, 0.4, 0.0])
    counts = (100, 200, 400), (48, 72, 108), (32, 40, 50), (20, 24, 29)
    return Problem(system, start, (0.0, 2.0), counts)


def index2():
    """Return the system that is nonlinear in z, with its closed form."""

    def exact(t):
        return dict(zip("yz", nonlinear_at(t), strict=True))

    steps = (80, 160, 320), (32, 64, 128), (12, 16, 24, 32), (10, 12, 16, 20)
    return Problem(nonlinear(), {"y": [1.0, 1.0], "z": [1.0]}, (0.0, 2.0), steps, exact=exact)


# --- fields --------------------------------------------------------------------------------------


def polynomial(name, t):
    """Return a field of the library over a span in which its errors are far above roundoff."""
    problem = load(name)
    best = lv.VolumeSplitting(composition="SS10s35", compensated=True)
    return Problem(
        problem.system, dict(problem.start), (0.0, t), floor=3e-13, best=best, best_steps=400
    )


def gridded():
    """Return waves on a grid in space, whose planes have equations that are not explicit."""
    nodes, rng = np.linspace(0, 2 * np.pi, 16, endpoint=False), np.random.default_rng(1)
    points, potential = (
        np.array(np.meshgrid(nodes, nodes, nodes, indexing="ij")),
        np.zeros((3, 16, 16, 16)),
    )
    for _ in range(12):
        k, phase = rng.integers(-2, 3, 3), rng.uniform(0, 2 * np.pi, 3)
        for j in range(3):
            potential[j] += rng.normal() * np.cos(np.tensordot(k, points, 1) + phase[j]) / 8
    field = lv.GriddedField(
        nodes, nodes, nodes, potential=tuple(potential), periodic=("x", "y", "z"), degree=5
    )
    best = lv.VolumeSplitting(composition="BM6", compensated=True)
    start = {"x": [0.1, 0.2, 0.3]}
    return Problem(field, start, (0.0, 1.0), floor=1e-11, best=best, best_steps=400)


def potential():
    """Return a field by a potential that is no sum of waves, with time."""

    def function(t, x, params):
        x, y, z = ca.vertsplit(x)
        return [
            ca.sin(y + z) / (2 + ca.cos(x) * ca.sin(z)),
            ca.tanh(ca.sin(x - z)) / (1.5 + ca.cos(y)),
            ca.log(2 + 0.9 * ca.cos(x) * ca.sin(y)) * (1 + 0.3 * ca.cos(t)),
        ]

    field = lv.PotentialField(function, x=("x", "y", "z"))
    best = lv.VolumeSplitting(composition="SS10s35", compensated=True)
    return Problem(
        field, {"x": [0.3, 0.2, -0.4]}, (0.0, 1.0), floor=3e-13, best=best, best_steps=400
    )


# --- wave functions ------------------------------------------------------------------------------

CHAIN = lv.Lattice(8, potential=np.cos(np.arange(8.0)))
DRIVE = (lambda a: a + a.T)(np.random.default_rng(5).normal(size=(8, 8)))


def random_state(n, seed=0):
    rng = np.random.default_rng(seed)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    return psi / np.linalg.norm(psi)


def chain():
    energies, vectors = np.linalg.eigh(CHAIN.entries().dense())
    psi = random_state(8)

    def exact(t):
        return {"psi": vectors @ (np.exp(-1j * energies * t) * (vectors.T @ psi))}

    return Problem(lv.Schrodinger(CHAIN), {"psi": psi}, (0.0, 3.0), exact=exact)


def driven():
    t0, psi = 0.3, random_state(8)
    system = lv.Schrodinger(CHAIN, drive=[(lambda t, params: 0.4 * t * (2 - t), DRIVE)])

    def exact(t):
        still = CHAIN.entries().dense()

        def product(t, y):
            return still @ y + 0.4 * t * (2 - t) * (DRIVE @ y)

        return {"psi": propagated(product, (t0, t), psi)[-1]}

    return Problem(system, {"psi": psi}, (t0, 2.3), exact=exact)


def flux():
    """Return a ring that a flux goes through: complex, and real by no gauge."""
    still = CHAIN.entries().dense().astype(complex)
    still[0, -1] = np.exp(0.9j)
    still[-1, 0] = np.exp(-0.9j)
    energies, vectors = np.linalg.eigh(still)
    psi = random_state(8)

    def exact(t):
        return {"psi": vectors @ (np.exp(-1j * energies * t) * (vectors.conj().T @ psi))}

    system = lv.Schrodinger(still)
    return Problem(system, {"psi": psi}, (0.0, 3.0), exact=exact)


def moving_grid():
    grid = lv.Grid(
        -8.0, 8.0, 64, lambda t, x, params: x**2 / 2 + 2 * ca.sin(2 * t) * x + x**4 / 100
    )
    system, t0 = lv.Schrodinger(grid), 0.4
    x = system.grid.points[:, 0]
    psi = np.exp(-((x - 1.5) ** 2) / 2 + 1j * x)

    def exact(t):
        kinetic = system.grid.kinetic(1.0)[0]
        still = np.fft.ifft(kinetic[:, None] * np.fft.fft(np.eye(64), axis=0), axis=0)
        still += np.diag(x**2 / 2 + x**4 / 100)

        def product(t, y):
            return still @ y + (2 * np.sin(2 * t) * x) * y

        return {"psi": propagated(product, (t0, t), psi / np.linalg.norm(psi))[-1]}

    return Problem(system, {"psi": psi / np.linalg.norm(psi)}, (t0, 8.4), exact=exact)


FAMILIES = {
    "knife edge": rolling(knife_edge(), [0, 0, 0], [0, 0, 1.5], 1),
    "rolling disk": rolling(rolling_disk(), [0, 0, 0, 0], [1, 0, 1, 0.5], 1.5),
    "pace": rolling(pace(), [0.1, 0.2, 0], [0.6, 0.8, 0], 1),
    "bowl": rolling(bowl(), [0.5, 0.2, 0.1, 0.3], [1, 0.1, 0, 0.7], 2),
    "swinging rod": swinging_rod(),
    "index 2": index2(),
    "five variables": polynomial("maxwell_bloch", 16.0),
    "cubic charge": polynomial("cubic_charge", 8.0),
    "waves on a grid": gridded(),
    "vector potential": potential(),
    "chain": chain(),
    "driven chain": driven(),
    "flux": flux(),
    "moving grid": moving_grid(),
}
