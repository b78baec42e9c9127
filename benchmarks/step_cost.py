"""Microseconds a step of SPARK on problems of all sizes, with the iterations it took.

The minimum of repeats; nothing is kept but the start and the end, corrections are in brackets. Run
as ``python benchmarks/step_cost.py``.
"""

from report import publish

import liouville as lv
from liouville import problems

STAGES = (2, 3, 4)
STEPS = 500
REPEATS = 100


def cost(problem, stages):
    """Return microseconds a step of the problem's own size, and its corrections."""
    t0 = problem.interval[0]
    runs = [
        lv.integrate(
            problem.system,
            lv.Spark(stages),
            t=(t0, t0 + STEPS * problem.h),
            steps=STEPS,
            every=STEPS,
            states=False,
            **problem.start,
        )
        for _ in range(REPEATS)
    ]
    stats = min((run.stats for run in runs), key=lambda stats: stats["seconds"])
    return f"{1e6 * stats['seconds'] / STEPS:.3g} ({stats['iterations'] / STEPS:.3g})"


def row(name):
    """Return the row of a problem."""
    problem = problems.load(name)
    return {
        "problem": name,
        "n": len(problem.system.coordinates),
        "m": len(problem.system.constraints),
        "h": problem.h,
        **{f"s = {stages}": cost(problem, stages) for stages in STAGES},
    }


def main():
    names = ("pendulum", "spherical_pendulum", "car_axis", "heavy_top", "andrews", "chain")
    publish("step_cost", [row(name) for name in names])


if __name__ == "__main__":
    main()
