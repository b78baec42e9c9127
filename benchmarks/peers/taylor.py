"""heyoka's Taylor integrator on the index-reduced equations, one integrator for each tolerance.

Its order follows the tolerance, so each has code of its own, compiled when the integrator is made:
unrolled, which runs up to three times as fast as its compact mode and takes up to ten times as long
to compile.
"""

import time

import heyoka

from .reduced import translate


class Heyoka:
    """A problem's integrators by tolerance, what building them took, and how constraints drift."""

    def __init__(self, equation, span, tolerances, compact):
        self.equation, self.span = equation, span
        state = heyoka.make_vars(*(f"x{i}" for i in range(len(equation.start))))
        rates = translate(equation, heyoka.time, state, heyoka)
        system = list(zip(state, rates, strict=True))
        self.made, self.building, self.drift = {}, {}, {}
        for tol in tolerances:
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
