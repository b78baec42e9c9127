"""Drift of the energy in long runs: its slope a step beside the random walk of its increments.

Run as ``python benchmarks/long_runs.py``; takes a quarter of a minute.
"""

import numpy as np
from report import publish

import liouville as lv
from liouville import problems

RUNS = (("spherical_pendulum", 5, 0.05, 1_000_000), ("heavy_top", 4, 1e-3, 100_000))


def drift(name, stages, h, steps):
    """Return the row of one run; drift and walk are relative to the energy's size."""
    problem = problems.load(name)
    found = lv.integrate(
        problem.system,
        lv.Spark(stages),
        t=(0.0, steps * h),
        steps=steps,
        every=steps // 1000,
        states=False,
        **problem.start,
    )
    energy = found.invariants["energy"]
    errors = (energy - energy[0]) / np.abs(energy[0])
    slope = np.polyfit(np.arange(len(errors)), errors, 1)[0] * len(errors)
    return {
        "problem": name,
        "s": stages,
        "h": h,
        "steps": steps,
        "largest": float(np.abs(errors).max()),
        "linear part": float(abs(slope)),
        "random walk": float(np.diff(errors).std() * np.sqrt(len(errors))),
    }


def main():
    publish("long_runs", [drift(*run) for run in RUNS])


if __name__ == "__main__":
    main()
