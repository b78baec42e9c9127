"""Long runs of volume-preserving splittings: what is bounded, what drifts, and what is roundoff.

The first table: the largest error of each conserved quantity in the first tenth of a run and in all
of it, for the splitting and for RK4 with three steps to one of BM4, which evaluates the field as
often as BM4 goes through the pieces; and how far the determinants of 1000 steps are from 1. The
second: invariants where the method's own error is below roundoff, with and without compensated
sums; the power says how the error grows with time, 1/2 is a random walk and 1 a drift.

Run as ``python benchmarks/long_runs_volume.py``, after ``pip install --group bench``; takes some
minutes.
"""

import numpy as np
from peers import polynomial
from report import publish, show

import liouville as lv
from liouville import problems

RECORDS = 10_000
#: Problem, composition, step, number of steps.
RUNS = (
    ("hill_vortex", "BM4", 0.05, 1_000_000),
    ("lorenz96", "BM4", 0.05, 1_000_000),
    ("volterra_lattice", "BM4", 0.05, 1_000_000),
    ("euler_top", "BM4", 0.1, 1_000_000),
)
ROUNDOFF = (
    ("hill_vortex", "SS10s35", 0.05, 1_000_000),
    ("lorenz96", "SS10s35", 0.05, 1_000_000),
    ("volterra_lattice", "SS10s35", 0.05, 1_000_000),
    ("euler_top", "SS10s35", 0.1, 1_000_000),
)
STEPS = 1000  # whose determinants are looked at
CONTROL = 3  # steps of RK4 to one of BM4


def run(problem, composition, h, steps, **how):
    """Integrate a problem of the library from its own start; returns the plan too."""
    method = lv.VolumeSplitting(composition=composition, **how)
    plan = lv.plan(problem.system, method, h=h, **problem.start)
    return plan, lv.integrate(
        problem.system,
        plan,
        t=(0.0, steps * h),
        steps=steps,
        every=steps // RECORDS,
        **problem.start,
    )


def errors(values):
    """Return the error at each record, relative to the start where that is not zero."""
    return np.abs(values - values[0]) / (np.abs(values[0]) or 1.0)


def drift(name, composition, h, steps):
    """Yield a row for each conserved quantity, of the splitting and of RK4 at the same cost."""
    problem = problems.load(name)
    plan, found = run(problem, composition, h, steps)
    start, every = found.x[0], steps // RECORDS
    control = polynomial.trajectory(problem.system, start, h / CONTROL, RECORDS, CONTROL * every)
    # an ensemble knows the invariants where it starts
    at_start = lv.ensemble(problem.system, plan, t=(0.0, h), steps=1, x=control)
    volume = lv.analysis.determinant(
        problem.system, plan, t=(0.0, STEPS * h), steps=STEPS, every=STEPS, **problem.start
    )
    for invariant in problem.conserved:
        own = errors(found.invariants[invariant])
        rk4 = errors(at_start.invariants[invariant][0])
        yield {
            "problem": name,
            "invariant": invariant,
            "composition": composition,
            "h": h,
            "steps": steps,
            "to T/10": float(own[: RECORDS // 10 + 1].max()),
            "to T": float(own.max()),
            "RK4 to T/10": float(rk4[: RECORDS // 10 + 1].max()),
            "RK4 to T": float(rk4.max()),
            "det - 1": float(volume.observed["defect"][-1]),
        }


def growth(values):
    """Fit the power of time that the error grows with: root mean squares of halves of halves."""
    windows = [(RECORDS >> k, RECORDS >> (k - 1)) for k in range(1, 8)]
    middles = [low + high for low, high in windows]
    sizes = [np.sqrt((errors(values)[low:high] ** 2).mean()) for low, high in windows]
    return float(np.polyfit(np.log(middles), np.log(np.maximum(sizes, 1e-17)), 1)[0])


def roundoff(name, composition, h, steps):
    """Yield a row for each conserved quantity, with plain and with compensated sums."""
    problem = problems.load(name)
    plain, compensated = (
        run(problem, composition, h, steps, compensated=how)[1] for how in (False, True)
    )
    for invariant in problem.conserved:
        row = {"problem": name, "invariant": invariant, "h": h, "steps": steps}
        for how, found in (("plain", plain), ("compensated", compensated)):
            values = found.invariants[invariant]
            row[how] = float(errors(values).max())
            row[f"{how}, power of t"] = round(growth(values), 2)
        row["ratio"] = row["plain"] / row["compensated"]
        row["seconds"], row["compensated, seconds"] = (
            round(found.stats["seconds"], 2) for found in (plain, compensated)
        )
        yield row


def main():
    rows = [row for case in RUNS for row in drift(*case)]
    publish("long_runs_volume", rows, ("numba",))
    print("\nRoundoff alone:\n")
    show([row for case in ROUNDOFF for row in roundoff(*case)])


if __name__ == "__main__":
    main()
