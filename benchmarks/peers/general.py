"""CasADi's IDAS and scipy_dae, general codes for differential-algebraic equations.

IDAS takes x' = f(t, x, z), 0 = g(t, x, z): here x = (q, v) and z = (v', lam) or, with the
constraints of positions too, (v', lam, mu). Its functions are compiled and its Jacobian is
CasADi's own. scipy_dae is written in NumPy; residual and Jacobians are the compiled ones, called
through numba. z has no part in the error test of either.
"""

import contextlib
import tempfile
import time
from ctypes import c_double, c_void_p

import casadi as ca
import numba
import numpy as np
from scipy_dae.integrate import solve_dae

from .implicit import accelerations, equations
from .sundials import IGNORED, MOST_STEPS

FORMS = ("index1", "ggl")


def semi_explicit(system, form):
    """Return the system as CasADi's integrators take it, in one of `FORMS`."""
    t, q, v, lam, mass, force, reaction, g, hidden = equations(system)
    a, mu = ca.SX.sym("a", q.numel()), ca.SX.sym("mu", lam.numel())
    x, motion = ca.vertcat(q, v), ca.mtimes(mass, a) - force - reaction
    if form == "index1":
        last = ca.jtimes(hidden, ca.vertcat(t, x), ca.vertcat(1, v, a))
        found = ca.vertcat(a, lam), ca.vertcat(v, a), ca.vertcat(motion, last)
    else:
        projected = v - ca.mtimes(ca.jacobian(g, q).T, mu)
        found = ca.vertcat(a, lam, mu), ca.vertcat(projected, a), ca.vertcat(motion, hidden, g)
    return dict(zip(("z", "ode", "alg"), found, strict=True), t=t, x=x)


class Idas:
    """CasADi's interface to SUNDIALS IDAS, one integrator for each tolerance."""

    def __init__(self, system, form, start, span, scales, tolerances):
        self.equations, self.span, self.scales = semi_explicit(system, form), span, scales
        q, v = (np.array(start[name], dtype=float) for name in "qv")
        a, lam = accelerations(system)(span[0], q, v)
        self.n, size = len(q), self.equations["z"].numel()
        rest = np.zeros(size - len(a) - len(lam))
        self.x0, self.z0 = np.concatenate([q, v]), np.concatenate([a, lam, rest])
        self.rates = [*v, *a]
        self.made = {tol: self.integrator(tol) for tol in tolerances}

    def integrator(self, tol):
        """Compile an integrator of this tolerance."""
        atol = [tol * scale for scale in self.scales for _ in range(self.n)]
        options = {
            "reltol": tol,
            "abstol": 1.0,
            "abstolv": atol + [IGNORED] * len(self.z0),
            "suppress_algebraic": True,
            "calc_ic": False,
            "init_xdot": self.rates,
            "max_num_steps": MOST_STEPS,
            "disable_internal_warnings": True,
            "jit": True,
            "compiler": "shell",
            "jit_options": {"flags": ["-O2", "-march=native"], "verbose": False},
        }
        with contextlib.chdir(tempfile.mkdtemp(prefix="peer-")):  # its C would lie about here
            return ca.integrator("solve", "idas", self.equations, *self.span, options)

    def run(self, tol):
        """Integrate with one of the tolerances."""
        begin = time.perf_counter()
        found = self.made[tol](x0=self.x0, z0=self.z0)
        seconds = time.perf_counter() - begin
        x = np.array(found["xf"])[:, 0]
        return seconds, x[: self.n], x[self.n :]


class ScipyDae:
    """scipy_dae's Radau IIA, of any odd number of stages, or BDF."""

    def __init__(self, equation, span, scales, method, stages=None):
        self.equation, self.span, self.scales, self.method = equation, span, scales, method
        self.options = {"stages": stages} if stages else {}
        self.residual, self.jacobians = functions(equation)

    def run(self, tol):
        """Integrate with a relative tolerance, absolute in units of the scales."""
        n, size = self.equation.n, len(self.equation.start[0])
        scale = np.concatenate([np.repeat(self.scales, n) * tol, np.full(size - 2 * n, 1.0)])
        if self.method == "BDF":  # Radau stops with multipliers that weigh nothing
            scale[2 * n :] = IGNORED
        begin = time.perf_counter()
        found = solve_dae(
            self.residual,
            self.span,
            *self.equation.start,
            method=self.method,
            rtol=tol,
            atol=scale,
            jac=self.jacobians,
            **self.options,
        )
        seconds = time.perf_counter() - begin
        if not found.success:
            raise RuntimeError(found.message)
        return seconds, *self.equation.split(found.y[:, -1])


def functions(equation):
    """Return residual and Jacobians as scipy_dae calls them."""
    code = equation.library
    code.residual.argtypes = [c_double, c_void_p, c_void_p, c_void_p]
    code.parts.argtypes = [c_double, c_void_p, c_void_p, c_void_p, c_void_p]
    code.residual.restype = code.parts.restype = None
    c_residual, c_parts = code.residual, code.parts
    size = len(equation.start[0])
    places = [
        tuple(np.array(index) for index in part.sparsity().get_triplet())
        for part in equation.jacobians()
    ]
    (by_x_row, by_x_col), (by_xp_row, by_xp_col) = places

    @numba.njit
    def residual(t, x, xp):
        x, xp, out = np.ascontiguousarray(x), np.ascontiguousarray(xp), np.empty(size)
        c_residual(t, x.ctypes, xp.ctypes, out.ctypes)
        return out

    @numba.njit
    def jacobians(t, x, xp):
        x, xp = np.ascontiguousarray(x), np.ascontiguousarray(xp)
        by_x, by_xp = np.empty(by_x_row.size), np.empty(by_xp_row.size)
        c_parts(t, x.ctypes, xp.ctypes, by_x.ctypes, by_xp.ctypes)
        first, second = np.zeros((size, size)), np.zeros((size, size))
        for k in range(by_x.size):
            first[by_x_row[k], by_x_col[k]] = by_x[k]
        for k in range(by_xp.size):
            second[by_xp_row[k], by_xp_col[k]] = by_xp[k]
        return first, second

    return residual, jacobians
