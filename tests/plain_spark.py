"""SPARK steps written down as they are defined, every unknown of a step in one Newton.

Nothing is eliminated, scaled or started cleverly: slow, and as near to the formulas of
``docs/theory`` as a program can be. Coefficients come from Legendre series of NumPy's.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.polynomial import legendre


def integrals(nodes, ends):
    """Return the integrals from 0 to each of `ends` of the Lagrange polynomials of `nodes`."""
    basis = np.linalg.inv(legendre.legvander(2 * nodes - 1, len(nodes) - 1))
    primitives = legendre.legint(basis, lbnd=-1, axis=0) / 2
    return legendre.legval(2 * np.asarray(ends) - 1, primitives).T


def lobatto_nodes(points):
    """Return 0, the zeros of the derivative of a Legendre polynomial, and 1."""
    inner = legendre.legroots(legendre.legder(np.eye(points)[-1]))
    return np.concatenate([[0.0], (inner + 1) / 2, [1.0]])


@dataclass(frozen=True)
class Tableau:
    """Coefficients of v, f and rn at stages `c`, of g and r at nodes `c_hat`."""

    c: np.ndarray
    b: np.ndarray
    a_v: np.ndarray
    a_f: np.ndarray
    a_rn: np.ndarray
    c_hat: np.ndarray
    b_hat: np.ndarray
    a_bar: np.ndarray
    a_hat: np.ndarray


def gauss(s):
    """Return Gauss's coefficients, with Lobatto's nodes for constraints."""
    c = (legendre.leggauss(s)[0] + 1) / 2
    b = integrals(c, [1.0])[0]
    a = integrals(c, c)
    c_hat = lobatto_nodes(s + 1)
    b_hat, a_bar = integrals(c_hat, [1.0])[0], integrals(c, c_hat)
    a_hat = b_hat * (1 - a_bar.T / b[:, None])
    return Tableau(c, b, a, a, a, c_hat, b_hat, a_bar, a_hat)


def lobatto(points, force="B"):
    """Return Lobatto IIIA for positions, IIIB for reactions and a choice for forces."""
    c = lobatto_nodes(points)
    b = integrals(c, [1.0])[0]
    a = {"A": integrals(c, c)}
    a["B"] = b * (1 - a["A"].T / b[:, None])
    # IIIC: b_1 in the first column, exact for polynomials of degree points - 2
    a["C"] = np.empty((points, points))
    a["C"][:, 0] = b[0]
    powers = np.arange(points - 1)
    moments = c[:, None] ** (powers + 1) / (powers + 1) - b[0] * c[0] ** powers
    a["C"][:, 1:] = moments @ np.linalg.inv(c[1:, None] ** powers)
    a["C*"] = b * (1 - a["C"].T / b[:, None])
    a["D"] = (a["C"] + a["C*"]) / 2
    return Tableau(c, b, a["A"], a[force], a["B"], c, b, a["A"], a["B"])


class Plain:
    """y' = v, d/dt p = f + r(t, y, psi) + rn(t, y, z, nu), 0 = g(t, y), 0 = k(t, y, z).

    The functions take CasADi symbols t, y, z; without reactions of their own r is -g_y^T psi and
    rn is -k_z^T nu, which is the ideal one where v = z.
    """

    def __init__(self, n, p, f, g=None, k=None, *, v=None, r=None, rn=None):
        t, y, z = ca.SX.sym("t"), ca.SX.sym("y", n), ca.SX.sym("z", n)
        velocity = z if v is None else v(t, y, z)
        g_, k_ = column(g, t, y), column(k, t, y, z)
        self.n, self.m, self.l = n, g_.numel(), k_.numel()
        psi, nu = ca.SX.sym("psi", self.m), ca.SX.sym("nu", self.l)
        ideal = -ca.jacobian(g_, y).T @ psi, -ca.jacobian(k_, z).T @ nu
        held = ca.jtimes(g_, ca.vertcat(t, y), ca.vertcat(1, velocity))
        at = [t, y, z]
        self.v, self.p = ca.Function("v", at, [velocity]), ca.Function("p", at, [p(*at)])
        self.f, self.k = ca.Function("f", at, [f(*at)]), ca.Function("k", at, [k_])
        self.g, self.w = ca.Function("g", [t, y], [g_]), ca.Function("w", at, [held])
        self.r = ca.Function("r", [t, y, psi], [r(t, y, psi) if r else ideal[0]])
        self.rn = ca.Function("rn", [*at, nu], [rn(*at, nu) if rn else ideal[1]])
        self._steps = {}

    @classmethod
    def lagrangian(cls, n, lagrangian, g=None, k=None, force=None):
        """Make it of L(t, q, v), with d/dt L_v = L_q + Q - g_q^T psi - k_v^T nu."""

        def momentum(t, q, v):
            return ca.gradient(lagrangian(t, q, v), v)

        def all_forces(t, q, v):
            own = force(t, q, v) if force else 0
            return ca.gradient(lagrangian(t, q, v), q) + own

        return cls(n, momentum, all_forces, g, k)

    def _start(self, key, tableau, t, y, z):
        """Return the equations of a step, and the parts of a start of their unknowns."""
        if key not in self._steps:
            self._steps[key] = self._equations(tableau)
        equations, shapes = self._steps[key]
        stages = len(tableau.c)
        v = self.v(t, y, z).full().ravel()
        return equations, [np.tile(v, stages), np.tile(z, stages), *map(np.zeros, shapes), z]

    def branch(self, tableau, y, z, ends, parts=10):
        """Yield y1 of steps of rising sizes `ends`, followed from h = 0 in parts of each."""
        equations, guess = self._start(len(tableau.c), tableau, 0, y, z)
        x, last = np.concatenate(guess), 0.0
        for end in ends:
            for h in np.linspace(last, end, parts + 1)[1:]:
                size = np.inf
                for _ in range(12):
                    rest, slope, y1 = equations(x, 0, y, z, h)
                    change = np.linalg.solve(slope, rest)
                    x, before, size = x - change, size, np.abs(change).max()
                    if before <= 1e-8 * np.abs(x).max():  # the last one was roundoff
                        break
            yield y1.copy()
            last = end

    def correction(self, tableau, y, z, h, y1, z1):
        """Return what Newton's method still corrects in the end of a step, whose stages are sought.

        They are what comes nearest to all equations and that end, by the method of Gauss and
        Newton from velocities that change evenly.
        """
        equations, guess = self._start(len(tableau.c), tableau, 0, y, z)
        n, s = self.n, len(tableau.c)
        even = [z + c * (z1 - z) for c in tableau.c]
        rates = [self.v(0, y, x).full().ravel() for x in even]
        x = np.concatenate([*rates, *even, *guess[2:-1], z1])
        ends = np.zeros((2 * n, x.size))
        ends[:n, : s * n] = np.kron(h * tableau.b, np.eye(n))
        ends[n:, -n:] = h * np.eye(n)
        for _ in range(40):
            rest, slope, end = equations(x, 0, y, z, h)
            off = np.concatenate([end - y1, h * (x[-n:] - z1)])
            slopes, rests = np.vstack([slope, ends]), np.append(rest, off)
            change = np.linalg.lstsq(slopes, rests)[0]
            x = x - change
            if np.abs(change).max() <= 1e-10 * np.abs(x).max():
                break
        rest, slope, end = equations(x, 0, y, z, h)
        change = np.linalg.solve(slope, rest)
        return end - ends[:n] @ change - y1

    def step(self, key, tableau, t, y, z, h):
        """Return y1 and z1, and the multipliers psi at nodes and nu at stages."""
        equations, guess = self._start(key, tableau, t, y, z)
        x = np.concatenate(guess)
        for _ in range(12):
            rest, slope, _ = equations(x, t, y, z, h)
            x = x - np.linalg.solve(slope, rest)
        *_, psi, nu, z1 = np.split(x, np.cumsum([len(part) for part in guess])[:-1])
        y1 = equations(x, t, y, z, h)[2].copy()
        return y1, z1, psi.reshape(-1, max(self.m, 1)), nu.reshape(-1, max(self.l, 1))

    def _equations(self, tab):
        """Return the residual of a step's equations, their Jacobian and y1."""
        n, s, last = self.n, len(tab.c), len(tab.c_hat) - 1
        t, h, y, z = ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("y", n), ca.SX.sym("z", n)
        V, Z, z1 = ca.SX.sym("V", n, s), ca.SX.sym("Z", n, s), ca.SX.sym("z1", n)
        psi, nu = ca.SX.sym("psi", self.m, last + 1), ca.SX.sym("nu", self.l, s)

        def sum_of(row, values):
            return sum((float(a) * x for a, x in zip(row, values, strict=True)), ca.SX(n, 1))

        rates, times = ca.horzsplit(V), [t + c * h for c in tab.c_hat]
        Y = [y + h * sum_of(row, rates) for row in tab.a_v]
        nodes = [y + h * sum_of(row, rates) for row in tab.a_bar]
        at = list(zip([t + c * h for c in tab.c], Y, ca.horzsplit(Z), strict=True))
        F = [self.f(*x) for x in at]
        N = [self.rn(*x, nu[:, i]) for i, x in enumerate(at)]
        R = [self.r(*x, psi[:, j]) for j, x in enumerate(zip(times, nodes, strict=True))]
        K = [self.k(*x) for x in at]
        p0, y1 = self.p(t, y, z), y + h * sum_of(tab.b, rates)
        end = t + h, y1, z1
        rest = [rate - self.v(*x) for rate, x in zip(rates, at, strict=True)]
        rest += [
            self.p(*x) - p0 - h * (sum_of(f, F) + sum_of(rn, N) + sum_of(r, R))
            for x, f, rn, r in zip(at, tab.a_f, tab.a_rn, tab.a_hat, strict=True)
        ]
        rest += [self.g(*x) for x in list(zip(times, nodes, strict=True))[1:]]
        rest += [
            sum(float(b * legendre.legval(2 * c - 1, np.eye(s)[i])) * k
                for b, c, k in zip(tab.b, tab.c, K, strict=True))
            for i in range(s - 1)
        ]  # fmt: skip
        rest += [
            self.p(*end) - p0 - h * (sum_of(tab.b, F) + sum_of(tab.b, N) + sum_of(tab.b_hat, R)),
            self.w(*end),
            self.k(*end),
        ]
        unknown = ca.vertcat(ca.vec(V), ca.vec(Z), ca.vec(psi), ca.vec(nu), z1)
        residual = ca.vertcat(*rest)
        found = map(ca.densify, [residual, ca.jacobian(residual, unknown), y1])
        function = ca.Function("step", [unknown, t, y, z, h], [*found])
        return OnArrays(function), (self.m * (last + 1), self.l * s)


class OnArrays:
    """A function of CasADi's on arrays, which its results share with those of the next call."""

    def __init__(self, function):
        self._buffer, self._evaluate = function.buffer()
        self._args = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        for i, x in enumerate(self._args):
            self._buffer.set_arg(i, memoryview(x))
        for i, x in enumerate(results):
            self._buffer.set_res(i, memoryview(x))
        rows = [function.size1_out(i) for i in range(function.n_out())]
        shaped = [x.reshape(-1, max(n, 1)).T for n, x in zip(rows, results, strict=True)]
        self._results = [x[:, 0] if x.shape[1] == 1 else x for x in shaped]

    def __call__(self, *args):
        for x, value in zip(self._args, args, strict=True):
            x[:] = value
        self._evaluate()
        return self._results


def column(function, *args):
    """Return the values of a function as a column, empty without a function."""
    if function is None:
        return ca.SX(0, 1)
    values = function(*args)
    return ca.vertcat(*values) if isinstance(values, list) else values
