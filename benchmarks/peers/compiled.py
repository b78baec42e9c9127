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


class Diffrax:
    """A problem, solved by Dormand and Prince's method of order 8."""

    def __init__(self, equation, span, scales):
        self.equation, self.span = equation, span
        n = equation.state.numel()
        scale = np.repeat(scales, [n // 2 + n % 2, n // 2])
        start = jnp.array(equation.start)

        def rate(t, x, _):
            return jnp.array(translate(equation, t, x, jnp))

        def solve(tol):
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

        self.solve = jax.jit(solve)
        self.solve(1e-3)[0].block_until_ready()

    def run(self, tol):
        """Integrate with a relative tolerance."""
        begin = time.perf_counter()
        x, is_done = self.solve(tol)
        x.block_until_ready()
        seconds = time.perf_counter() - begin
        if not is_done:
            raise RuntimeError("diffrax took too many steps")
        q, v, _ = self.equation.split(self.span[1], np.array(x))
        return seconds, q, v
