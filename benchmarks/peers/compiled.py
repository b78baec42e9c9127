"""diffrax on the index-reduced equations: compiled once by XLA, the tolerance an argument of it.

Double precision on the processor, without gradients; the error control is that of its manual,
proportional and integral, with absolute tolerances in units of the scales.
"""

import time

import diffrax
import jax
import numpy as np
from jax import numpy as jnp

from .reduced import translate

jax.config.update("jax_enable_x64", True)
MOST_STEPS = 100_000


def solver(equation, span, scale):
    """Return a function (x, tol) to the end of Dormand and Prince's method of order 8."""

    def rate(t, x, _):
        return jnp.array(translate(equation, t, x, jnp))

    def solve(start, tol):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            diffrax.Dopri8(),
            *span,
            None,
            start,
            stepsize_controller=diffrax.PIDController(
                rtol=tol, atol=tol * scale, pcoeff=0.3, icoeff=0.4
            ),
            saveat=diffrax.SaveAt(t1=True),
            adjoint=diffrax.ForwardMode(),
            max_steps=MOST_STEPS,
            throw=False,
        )
        return found.ys[0], found.result == diffrax.RESULTS.successful

    return solve


class Diffrax:
    """A problem, compiled."""

    def __init__(self, equation, span, scales):
        self.equation, self.span, n = equation, span, equation.state.numel()
        scale = np.repeat(scales, [n - n // 2, n // 2])
        self.start = jnp.array(equation.start)
        self.solve = jax.jit(solver(equation, span, scale))
        self.solve(self.start, 1e-3)[0].block_until_ready()

    def run(self, tol):
        """Integrate with a relative tolerance."""
        begin = time.perf_counter()
        x, is_done = self.solve(self.start, tol)
        x.block_until_ready()
        seconds = time.perf_counter() - begin
        if not is_done:
            raise RuntimeError("diffrax took too many steps")
        q, v, _ = self.equation.split(self.span[1], np.array(x))
        return seconds, q, v


class DiffraxBatch:
    """All members at once, in steps that each chooses but all wait for."""

    name = "diffrax, vmap"

    def __init__(self, equation, span, tolerances):
        self.solve = jax.jit(jax.vmap(solver(equation, span, 1.0), in_axes=(0, None)))
        self.compiled = set()

    def run(self, states, tol):
        """Integrate all states, (P, n); return seconds and the ends."""
        if states.shape not in self.compiled:
            self.compiled.add(states.shape)
            self.solve(states, 1e-1)[0].block_until_ready()
        begin = time.perf_counter()
        ends, is_done = self.solve(states, tol)
        ends.block_until_ready()
        seconds = time.perf_counter() - begin
        if not is_done.all():
            raise RuntimeError("diffrax took too many steps")
        return seconds, ends
