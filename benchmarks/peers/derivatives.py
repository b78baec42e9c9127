"""Gradients by other codes, each with ``run(setting) -> (seconds, gradient)``; one has ours too.

The gradient is that of the sum of all coordinates at the end, by the parameters that the
constraints do not depend on, so that the start stays on them. diffrax has the index-reduced
equations of `reduced`, differentiated through its steps from checkpoints; IDAS, through CasADi, has
those of index 1 and their adjoint equations, in compiled C. Compiling is not part of the time.

Of a Schrödinger equation it is that of a probability at the end by the samples of a pulse which is
constant between two of them: JAX has the exponentials of Padé, one after another.
"""

import contextlib
import tempfile
import time

import casadi as ca
import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.experimental import sparse

import liouville as lv

from .implicit import accelerations, equations
from .reduced import reduced, translate
from .sundials import MOST_STEPS

jax.config.update("jax_enable_x64", True)

MOST = 1 << 16


def free(system):
    """Return the names of parameters that the constraints do not depend on."""
    s, g = system.symbols, system.model.g
    names = [
        name for name in system.params if not ca.depends_on(g, getattr(s.params.namespace, name))
    ]
    return [name for name in names if np.ndim(system.params[name]) == 0]


def places(system):
    """Return where these are among all values of parameters."""
    starts = np.cumsum([0, *(np.size(x) for x in system.params.values())])
    where = dict(zip(system.params, starts.tolist(), strict=False))
    return [where[name] for name in free(system)]


class Ours:
    """`lv.vjp` by Spark; a setting is a number of steps."""

    def __init__(self, system, start, span, stages):
        self.system, self.start, self.span, self.method = system, start, span, lv.Spark(stages)
        self.names = [f"params.{name}" for name in free(system)]

    def run(self, steps):
        """Integrate with so many steps, and go back."""
        begin = time.perf_counter()
        run = {"t": self.span, "steps": steps, "every": steps}
        solution, pullback = lv.vjp(self.system, self.method, wrt=self.names, **run, **self.start)
        cotangent = np.zeros_like(solution.q)
        cotangent[-1] = 1.0
        found = pullback(q=cotangent)
        seconds = time.perf_counter() - begin
        return seconds, np.array([found[name] for name in self.names])


class Diffrax:
    """Dopri8 through ``RecursiveCheckpointAdjoint``; a setting is a relative tolerance."""

    def __init__(self, system, start, span, scales):
        self.values, self.places = jnp.asarray(system.values(None)), places(system)
        n, symbols = len(system.coordinates), system.symbols.params.vector
        equation = reduced(system, start, symbols)

        def rate(t, x, params):
            return jnp.stack(translate(equation, t, x, jnp, params))

        scale = jnp.repeat(jnp.asarray(scales), n)

        def end(params, tolerance):
            found = diffrax.diffeqsolve(
                diffrax.ODETerm(rate), diffrax.Dopri8(), *span, None, jnp.asarray(equation.start),
                args=params, saveat=diffrax.SaveAt(t1=True), max_steps=MOST,
                stepsize_controller=diffrax.PIDController(
                    rtol=tolerance, atol=tolerance * scale, pcoeff=0.3, icoeff=0.4
                ),
                adjoint=diffrax.RecursiveCheckpointAdjoint(),
            )  # fmt: skip
            return found.ys[0][:n].sum()

        self.gradient = jax.jit(jax.grad(end))
        self.gradient(self.values, 1e-3).block_until_ready()

    def run(self, tolerance):
        """Integrate to this tolerance, and go back."""
        begin = time.perf_counter()
        found = np.asarray(self.gradient(self.values, tolerance))
        return time.perf_counter() - begin, found[self.places]


class Idas:
    """CasADi's interface to SUNDIALS IDAS and its adjoint; one integrator for each tolerance."""

    def __init__(self, system, start, span, scales, tolerances):
        q0, v0 = (np.array(start[name], dtype=float) for name in "qv")
        a0, lam0 = accelerations(system)(span[0], q0, v0)
        self.values, self.places = system.values(None), places(system)
        s = system.symbols
        t, q, v, lam, mass, force, reaction, _, hidden = equations(system, s.params.vector)
        a, n = ca.SX.sym("a", q.numel()), q.numel()
        x, motion = ca.vertcat(q, v), ca.mtimes(mass, a) - force - reaction
        last = ca.jtimes(hidden, ca.vertcat(t, x), ca.vertcat(1, v, a))
        dae = {"t": t, "x": x, "z": ca.vertcat(a, lam), "p": s.params.vector}
        dae |= {"ode": ca.vertcat(v, a), "alg": ca.vertcat(motion, last)}
        self.made = {}
        for tolerance in tolerances:
            options = {
                "reltol": tolerance, "abstol": tolerance * scales[0],
                "max_num_steps": MOST_STEPS, "disable_internal_warnings": True,
                "calc_ic": True, "steps_per_checkpoint": 1000, "jit": True, "compiler": "shell",
                "jit_options": {"flags": ["-O2", "-march=native"], "verbose": False},
            }  # fmt: skip
            with contextlib.chdir(tempfile.mkdtemp(prefix="peer-")):  # its C would lie about here
                solve = ca.integrator("solve", "idas", dae, *span, options)
                p = ca.MX.sym("p", len(self.values))
                found = solve(x0=ca.DM([*q0, *v0]), z0=ca.DM([*a0, *lam0]), p=p)
                value = ca.sum1(found["xf"][:n])
                self.made[tolerance] = ca.Function("slope", [p], [ca.gradient(value, p)])

    def run(self, tolerance):
        """Integrate with one of the tolerances, and go back."""
        begin = time.perf_counter()
        found = np.array(self.made[tolerance](self.values))[:, 0]
        return time.perf_counter() - begin, found[self.places]


class OurPulse:
    """`lv.vjp` of the exponential midpoint rule by the samples in the middle of its steps."""

    def __init__(self, parts, psi, target, pulse, span):
        self.psi, self.target, self.pulse = psi, target, pulse
        self.span, self.steps = span, pulse.size
        times = span / self.steps * (np.arange(self.steps + 1) + 0.5)
        static, driven = parts
        drive = [(np.zeros(times.size), driven)]
        self.system = lv.Schrodinger(static, drive=drive, times=times)

    def run(self, tolerance):
        """Go through the pulse with exponentials to this tolerance, and back."""
        begin = time.perf_counter()
        samples = np.append(self.pulse, 0.0)  # the spline's last point, beyond the end
        system = self.system.with_samples({"drive[0]": samples})
        solution, pullback = lv.vjp(
            system, lv.Magnus(2, tol=tolerance), wrt=["drive[0]"], t=(0, self.span),
            steps=self.steps, every=self.steps, psi=self.psi,
        )  # fmt: skip
        cotangent = np.zeros_like(solution.psi)
        cotangent[-1] = 2 * self.target * np.vdot(self.target, solution.psi[-1])
        found = pullback(psi=cotangent)["drive[0]"][:-1]
        return time.perf_counter() - begin, found


def matrix(part):
    """Return a matrix of JAX's, sparse if it is."""
    if sp.issparse(part):
        return sparse.BCOO.from_scipy_sparse(part.astype(complex).tocoo())
    return jnp.asarray(part, dtype=complex)


class JaxPulse:
    """The same in JAX: each exponential as a matrix by Padé, or as a Taylor series of the state.

    The setting is the number of terms of a series, for parts of a step in which H moves the state
    by no more than one; Padé's exponential has none.
    """

    def __init__(self, parts, psi, target, pulse, span, *, by_matrix):
        static, driven = map(matrix, parts)
        self.pulse, h = jnp.asarray(pulse), span / pulse.size
        static_norm, driven_norm = (float(abs(x).sum(axis=1).max()) for x in parts)
        halves = int(np.ceil(h * (static_norm + np.abs(pulse).max() * driven_norm)))

        def by_expm(state, u):
            return jax.scipy.linalg.expm(-1j * h * (static + u * driven)) @ state

        def by_terms(state, u, count):
            def part(state, _):
                total = term = state
                for k in range(1, count + 1):
                    term = -1j * h / halves / k * (static @ term + u * (driven @ term))
                    total = total + term
                return total, None

            return jax.lax.scan(part, state, None, length=halves)[0]

        def probability(pulse, count):
            def step(state, u):
                return (by_expm(state, u) if by_matrix else by_terms(state, u, count)), None

            end, _ = jax.lax.scan(step, jnp.asarray(psi, dtype=complex), pulse)
            return jnp.abs(jnp.vdot(jnp.asarray(target), end)) ** 2

        self.gradient = jax.jit(jax.grad(probability), static_argnums=1)
        self.compiled = set()

    def run(self, count):
        """Go through the pulse, and back."""
        if count not in self.compiled:
            self.compiled.add(count)
            self.gradient(self.pulse, count).block_until_ready()
        begin = time.perf_counter()
        found = np.asarray(self.gradient(self.pulse, count))
        return time.perf_counter() - begin, found
