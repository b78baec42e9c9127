"""Microseconds a step of SPARK on problems of all sizes, with the iterations it took.

The minimum of repeats; nothing is kept but the start and the end. Run as
``python benchmarks/step_cost.py``.
"""

from report import publish

import liouville as lv
from liouville import problems

STAGES = {"pendulum": (1, 2, 3, 4, 5, 6)}
STEPS = 500
REPEATS = 100


def cost(problem, stages):
    """Return the row of one problem and number of stages, with the problem's own step size."""
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
    return {
        "problem": problem.__name__.rpartition(".")[2],
        "n": len(problem.system.coordinates),
        "m": len(problem.system.constraints),
        "s": stages,
        "h": problem.h,
        "us a step": round(1e6 * stats["seconds"] / STEPS, 3),
        "iterations": round(stats["iterations"] / STEPS, 2),
        "solver": stats["solver"],
    }


def main():
    names = ("pendulum", "spherical_pendulum", "car_axis", "heavy_top", "andrews", "chain")
    rows = [
        cost(problems.load(name), stages)
        for name in names
        for stages in STAGES.get(name, (2, 3, 4))
    ]
    publish("step_cost", rows)


if __name__ == "__main__":
    main()
