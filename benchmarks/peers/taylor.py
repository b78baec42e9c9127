"""heyoka's Taylor integrator on the index-reduced equations, one integrator for each tolerance.

Its order follows the tolerance, so each has code of its own, compiled when the integrator is made:
unrolled, which runs up to three times as fast as its compact mode and takes up to ten times as long
to compile. What it has compiled before it would find in its caches; they are left out here.
"""

import time

import heyoka
import numpy as np

from .reduced import translate

if hasattr(heyoka.llvm_state, "set_diskcache_enabled"):
    heyoka.llvm_state.set_diskcache_enabled(False)


class Heyoka:
    """A problem's integrators by tolerance, what building them took, and how constraints drift."""

    def __init__(self, equation, span, tolerances, compact):
        self.equation, self.span = equation, span
        state = heyoka.make_vars(*(f"x{i}" for i in range(len(equation.start))))
        rates = translate(equation, heyoka.time, state, heyoka)
        system = list(zip(state, rates, strict=True))
        self.made, self.building, self.drift = {}, {}, {}
        for tol in tolerances:
            heyoka.llvm_state.clear_memcache()
            begin = time.perf_counter()
            self.made[tol] = heyoka.taylor_adaptive(
                system, list(equation.start), time=span[0], tol=tol, compact_mode=compact
            )
            self.building[tol] = time.perf_counter() - begin

    def run(self, tol):
        """Integrate with one of the tolerances."""
        machine = self.made[tol]
        machine.time = self.span[0]
        machine.state[:] = self.equation.start
        begin = time.perf_counter()
        machine.propagate_until(self.span[1])
        seconds = time.perf_counter() - begin
        q, v, self.drift[tol] = self.equation.split(self.span[1], machine.state)
        return seconds, q, v


class HeyokaBatch:
    """As many members at a time as a register holds, each with steps of its own."""

    def __init__(self, equation, span, tolerances):
        self.span, self.width = span, heyoka.recommended_simd_size()
        self.name = f"heyoka, batches of {self.width}"
        state = heyoka.make_vars(*(f"x{i}" for i in range(len(equation.start))))
        system = list(zip(state, translate(equation, heyoka.time, state, heyoka), strict=True))
        start = np.tile(equation.start[:, None], self.width)
        self.made = {
            tol: heyoka.taylor_adaptive_batch(system, start.copy(), tol=tol) for tol in tolerances
        }

    def run(self, states, tol):
        """Integrate all states, (P, n); return seconds and the ends."""
        machine, ends = self.made[tol], np.empty_like(states)
        begin = time.perf_counter()
        for first in range(0, len(states), self.width):
            part = states[first : first + self.width]
            machine.set_time(self.span[0])
            machine.state[:, : len(part)] = part.T
            machine.propagate_until(self.span[1])
            ends[first : first + self.width] = machine.state.T[: len(part)]
        return time.perf_counter() - begin, ends
