"""Gradients of many members at once in JAX, by `lv.jax.solver` and by diffrax under ``vmap``.

Each has ``run(setting) -> (seconds, gradients)``, a row for each member.
"""

import time

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

import liouville as lv

jax.config.update("jax_enable_x64", True)


class Ours:
    """`lv.jax.solver` under ``jit(vmap(grad))`` of the first coordinate at the end, by all inputs.

    A setting is a number of steps, of which each has a solver of its own. `first` has the seconds
    of the first call with the first setting, the solver made.
    """

    def __init__(self, system, rows, span, stages, settings):
        self.rows = [jnp.asarray(x) for x in rows]
        self.made = {}
        wrt = [*system.states, *(f"params.{name}" for name in system.params)]
        for steps in settings:
            begin = time.perf_counter()
            run = {"t": span, "steps": steps, "every": steps}
            solve = lv.jax.solver(system, lv.Spark(stages), wrt=wrt, returns="q", **run)

            def end(*x, solve=solve):
                return solve(*x)[-1, 0]

            self.made[steps] = jax.jit(jax.vmap(jax.grad(end, tuple(range(len(wrt))))))
            self.run(steps)
            self.first = getattr(self, "first", time.perf_counter() - begin)

    def run(self, steps):
        """Integrate all members with so many steps, and go back."""
        begin = time.perf_counter()
        found = [np.asarray(x) for x in self.made[steps](*self.rows)]
        return time.perf_counter() - begin, np.column_stack(found)


class Diffrax:
    """Dopri8 under ``jit(vmap(grad))`` likewise; a setting is a tolerance, relative and absolute.

    The rate is that of the members, ``rate(t, (q, v), params)``.
    """

    def __init__(self, rate, rows, span):
        self.rows = [jnp.asarray(x) for x in rows]

        def end(tolerance, q, v, *params):
            found = diffrax.diffeqsolve(
                diffrax.ODETerm(rate), diffrax.Dopri8(), *span, None, jnp.concatenate([q, v]),
                args=params, saveat=diffrax.SaveAt(t1=True), max_steps=4096,
                stepsize_controller=diffrax.PIDController(
                    rtol=tolerance, atol=tolerance, pcoeff=0.3, icoeff=0.4
                ),
                adjoint=diffrax.RecursiveCheckpointAdjoint(),
            )  # fmt: skip
            return found.ys[0, 0]

        by = tuple(range(1, 1 + len(rows)))
        axes = (None, *(0 for _ in rows))
        begin = time.perf_counter()
        self.gradient = jax.jit(jax.vmap(jax.grad(end, by), axes))
        self.run(1e-3)
        self.first = time.perf_counter() - begin

    def run(self, tolerance):
        """Integrate all members to this tolerance, and go back."""
        begin = time.perf_counter()
        found = [np.asarray(x) for x in self.gradient(tolerance, *self.rows)]
        return time.perf_counter() - begin, np.column_stack(found)
