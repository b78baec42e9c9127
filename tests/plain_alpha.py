"""The alpha methods written down as they are defined, every unknown of a step in one Newton.

Nothing is eliminated or scaled: slow, and as near to the formulas of ``docs/theory/hht.md`` as
a program can be.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np


def hht(alpha):
    """Return am, af, gamma, beta of Hilber, Hughes and Taylor."""
    return 0.0, -alpha, 0.5 - alpha, (1 - alpha) ** 2 / 4


def generalized(rho):
    """Return am, af, gamma, beta of Chung and Hulbert."""
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    return am, af, 0.5 - am + af, (1 - am + af) ** 2 / 4


@dataclass(frozen=True)
class State:
    """What a step starts from: time, positions, velocities, a, phi, and the step before."""

    t: float
    y: np.ndarray
    z: np.ndarray
    a: np.ndarray
    phi: np.ndarray
    h: float | None = None
    psi: tuple[np.ndarray, ...] = ()


class Plain:
    """M(t, y) z' = F(t, y, z) + r(t, y, psi), y' = z, g(t, y) = 0.

    The functions take CasADi symbols; without a reaction of its own r is -g_y^T psi.
    """

    def __init__(self, n, mass, force, constraint=None, reaction=None):
        t, y, z, a = ca.SX.sym("t"), *(ca.SX.sym(name, n) for name in "yza")
        g = ca.vertcat(ca.SX(0, 1), *(as_list(constraint(t, y)) if constraint else []))
        psi = ca.SX.sym("psi", g.numel())
        w = ca.jtimes(g, ca.vertcat(t, y), ca.vertcat(1, z))
        r = reaction(t, y, psi) if reaction else -ca.jacobian(g, y).T @ psi
        M, F = mass(t, y), force(t, y, z)
        self.n, self.m = n, g.numel()
        self.M = ca.Function("M", [t, y], [M])
        self.F = ca.Function("F", [t, y, z], [F])
        self.r = ca.Function("r", [t, y, psi], [r])
        self.g = ca.Function("g", [t, y], [g])
        self.G = ca.Function("G", [t, y], [ca.densify(ca.jacobian(g, y))])
        self.w = ca.Function("w", [t, y, z], [w])
        slope = ca.jtimes(w, ca.vertcat(t, y, z), ca.vertcat(1, z, a))
        unknown, rest = ca.vertcat(a, psi), ca.vertcat(M @ a - F - r, slope)
        jacobian = ca.densify(ca.jacobian(rest, unknown))
        self._level = ca.Function("level", [unknown, t, y, z], [rest, jacobian])
        self._steps = {}

    @classmethod
    def lagrangian(cls, n, lagrangian, constraint=None, force=None):
        """Make it of L(t, q, v), with d/dt L_v = L_q + Q - g_q^T psi."""
        t, q, v = ca.SX.sym("t"), ca.SX.sym("q", n), ca.SX.sym("v", n)
        mass, free = momentum_form(lagrangian, force, t, q, v)
        mass, free = ca.Function("M", [t, q], [mass]), ca.Function("F", [t, q, v], [free])
        return cls(n, mass, free, constraint)

    def phi(self, t, y, z):
        """Return M^-1 F."""
        return np.linalg.solve(self.M(t, y).full(), self.F(t, y, z).full().ravel())

    def acceleration(self, t, y, z):
        """Return z' and psi, which the second derivative of the constraint determines."""
        x = np.zeros(self.n + self.m)
        for _ in range(5):
            rest, jacobian = self._level(x, t, y, z)
            x = x - np.linalg.solve(jacobian.full(), rest.full().ravel())
        return x[: self.n], x[self.n :]

    def start(self, t, y, z, a=None, kind="extended"):
        """Begin with a = phi unless it is given; with Arnold and Bruels phi has the reaction in."""
        y, z = np.array(y, dtype=float), np.array(z, dtype=float)
        phi = self.acceleration(t, y, z)[0] if kind == "position" else self.phi(t, y, z)
        return State(t, y, z, phi if a is None else np.array(a, dtype=float), phi)

    def step(self, state, h, coefficients, b=1 / 3, kind="extended", correct=True):
        """Take a step; with `correct`, a is first moved to the new step size."""
        a0 = state.a
        if correct and state.h is not None:
            a0 = state.phi + h / state.h * (a0 - state.phi)
        n, m = self.n, self.m
        if kind not in self._steps:
            self._steps[kind] = self._equations(kind)
        psi = [self.acceleration(state.t, state.y, state.z)[1]] * (1 if kind == "position" else 2)
        y, z = state.y + h * state.z + h**2 / 2 * a0, state.z + h * a0
        reactions = [] if kind == "position" else [np.zeros(n), np.zeros(n)]
        x = np.concatenate([y, z, state.a, state.phi, *reactions, *psi])
        known = state.t, h, state.y, state.z, a0, state.phi, ca.DM([*coefficients, b])
        last = np.inf
        for _ in range(50):
            rest, jacobian = self._steps[kind](x, *known)
            change = np.linalg.solve(jacobian.full(), rest.full().ravel())
            x = x - change
            size = np.abs(change[: 2 * n]).max()
            if size < 1e-15 or (size >= last and size < 1e-10):
                break
            last = size
        else:
            raise ArithmeticError(f"no convergence: {size}")
        y, z, a, phi = x[: 4 * n].reshape(4, n)
        psi = tuple(x[len(x) - len(psi) * m :].reshape(len(psi), m))
        return State(state.t + h, y, z, a, phi, h, psi)

    def correction(self, state, h, coefficients, y, z, a, b=1 / 3):
        """Return what one more correction by Newton's matrix moves the end of a step by."""
        _, _, gamma, beta = coefficients
        if "extended" not in self._steps:
            self._steps["extended"] = self._equations("extended")
        y0, z0, a0 = state.y, state.z, state.a
        of_y = 2 / h**2 * (y - y0 - h * z0 - h**2 * ((0.5 - beta) * a0 + beta * a))
        of_z = 2 / h * (z - z0 - h * ((1 - gamma) * a0 + gamma * a))
        first = (of_y - b * of_z) / (1 - 2 * b)
        phi, reactions, psi = self.phi(state.t + h, y, z), [first, of_z - first], []
        for t, at, reaction in zip([state.t, state.t + h], [y0, y], reactions, strict=True):
            pull = -self.G(t, at).full().T
            psi.append(np.linalg.lstsq(pull, self.M(t, at).full() @ reaction)[0])
        x = np.concatenate([y, z, a, phi, *reactions, *psi])
        known = state.t, h, y0, z0, a0, state.phi, ca.DM([*coefficients, b])
        rest, jacobian = self._steps["extended"](x, *known)
        return np.linalg.solve(jacobian.full(), rest.full().ravel())[: self.n]

    def _equations(self, kind):
        n, m = self.n, self.m
        t0, h = ca.SX.sym("t0"), ca.SX.sym("h")
        y0, z0, a0, phi0, y1, z1, a1, phi1, A0, A1 = (ca.SX.sym(f"x{k}", n) for k in range(10))
        numbers = ca.SX.sym("numbers", 5)
        am, af, gamma, beta, b = (numbers[k] for k in range(5))
        psi0, psi1 = ca.SX.sym("psi0", m), ca.SX.sym("psi1", m)
        t1, M, F, r = t0 + h, self.M, self.F, self.r
        y = y0 + h * z0 + h**2 * ((0.5 - beta) * a0 + beta * a1)
        z = z0 + h * ((1 - gamma) * a0 + gamma * a1)
        mean = (1 - am) * a1 + am * a0 - (1 - af) * phi1 - af * phi0
        if kind == "position":
            unknown = ca.vertcat(y1, z1, a1, phi1, psi1)
            motion = M(t1, y1) @ phi1 - F(t1, y1, z1) - r(t1, y1, psi1)
            rest = [y - y1, z - z1, mean, motion, self.g(t1, y1)]
        else:
            at = y1 if kind == "extended" else y0 + h * z0
            unknown = ca.vertcat(y1, z1, a1, phi1, A0, A1, psi0, psi1)
            rest = [
                y + h**2 / 2 * ((1 - b) * A0 + b * A1) - y1,
                z + h / 2 * (A0 + A1) - z1,
                mean,
                M(t1, y1) @ phi1 - F(t1, y1, z1),
                M(t0, y0) @ A0 - r(t0, y0, psi0),
                M(t1, at) @ A1 - r(t1, at, psi1),
                self.g(t1, y1),
                self.w(t1, y1, z1),
            ]
        rest = ca.vertcat(*rest)
        known = [t0, h, y0, z0, a0, phi0, numbers]
        jacobian = ca.densify(ca.jacobian(rest, unknown))
        return ca.Function("equations", [unknown, *known], [rest, jacobian])

    def run(self, state, steps, coefficients, **how):
        """Take steps of the sizes given; returns all states, the first included."""
        states = [state]
        for h in steps:
            states.append(self.step(states[-1], h, coefficients, **how))
        return states


def momentum_form(lagrangian, force, t, q, v):
    """Return M = L_vv and F = L_q + Q - (L_v)_t - (L_v)_q v, so that M v' = F + r."""
    L = lagrangian(t, q, v)
    p = ca.gradient(L, v)
    moving = ca.jtimes(p, ca.vertcat(t, q), ca.vertcat(1, v))
    Q = force(t, q, v) if force else 0
    return ca.jacobian(p, v), ca.gradient(L, q) + Q - moving


def as_list(value):
    return value if isinstance(value, list) else [value]
