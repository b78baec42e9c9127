"""Energy errors of long runs beside the random walk that many short runs predict.

Brouwer's law: roundoff that favours no sign moves the energy like a random walk, by sigma sqrt(N)
in N steps. Here sigma is the spread of the energy over short runs that start along the motion.

Run as ``python benchmarks/long_runs.py [STEPS]``, with 1e6 steps unless said otherwise: two
minutes on two cores, and longer in proportion.
"""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from report import publish

import liouville as lv
from liouville import problems

RUNS = (
    ("spherical_pendulum", lv.Spark(4), 0.05),
    ("spherical_pendulum", lv.LobattoPair(5), 0.05),
    ("heavy_top", lv.Spark(4), 1e-3),
    ("heavy_top", lv.Spark(4, "newton"), 1e-3),
)
MEMBERS, SHORT = 24, 50_000


def energy(name, method, h, steps, every, **start):
    problem = problems.load(name)
    found = lv.integrate(
        problem.system, method, t=(0.0, steps * h), steps=steps, every=every, states=False,
        **(start or problem.start),
    )  # fmt: skip
    values = found.invariants["energy"]
    return values - values[0]


def spread(name, method, h):
    """Return the spread of the energy after one step, from that of many short runs."""
    problem = problems.load(name)
    gap = 997
    along = lv.integrate(
        problem.system, method, t=(0.0, MEMBERS * gap * h), steps=MEMBERS * gap, every=gap,
        **problem.start,
    )  # fmt: skip
    ends = [
        energy(name, method, h, SHORT, SHORT, q=q, v=v)[-1]
        for q, v in zip(along.q, along.v, strict=True)
    ]
    return np.std(ends) / np.sqrt(SHORT)


def row(name, method, h, steps):
    problem = problems.load(name)
    start = lv.integrate(problem.system, method, t=(0.0, h), steps=1, **problem.start)
    size = max(abs(start.invariants["energy"][0]), np.abs(start.p[0] * start.v[0]).sum())
    errors, sigma = energy(name, method, h, steps, steps // 1000), spread(name, method, h)
    return {
        "problem": name,
        "method": repr(method),
        "h": h,
        "steps": steps,
        "largest error": float(np.abs(errors).max() / size),
        "error at the end": float(errors[-1] / size),
        "sigma of the walk": float(sigma * np.sqrt(steps) / size),
        "in sigma": float(abs(errors[-1]) / (sigma * np.sqrt(steps))),
    }


def main():
    steps = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    with ThreadPoolExecutor(2) as pool:
        rows = pool.map(lambda run: row(*run, steps), RUNS)
    publish("long_runs", list(rows))


if __name__ == "__main__":
    main()
