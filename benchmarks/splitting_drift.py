"""Which splittings let integrals drift: the same fields in long runs, split in four ways.

All keep volume. The orbits of Euler's top are closed, those of the Volterra lattice lie on tori of
less than half its dimension, and symmetries that reverse them are kept by some of the splittings;
Hill's vortex winds round tori of two frequencies. Printed is the largest error of an integral in
the first tenth of a run and in all of it: ten times as large is a drift.

Run as ``python benchmarks/splitting_drift.py``; takes ten seconds.
"""

import numpy as np
from report import show

import liouville as lv
from liouville import problems

RECORDS = 1000
#: Problem, integral, length of the run and step.
RUNS = (
    ("euler_top", "momentum", 1e4, 0.1),
    ("volterra_lattice", "energy", 1e4, 0.05),
    ("hill_vortex", "stream", 1e4, 0.05),
)
SPLITTINGS = {
    "exponentials, natural": {"diagonal": "exponentials", "off_diagonal": "natural"},
    "exponentials, triangular": {"diagonal": "exponentials", "off_diagonal": "triangular"},
    "shears, natural": {"diagonal": "shears", "off_diagonal": "natural"},
    "n + d shears": {"diagonal": "n+d"},
}


def row(name, integral, span, h, splitting):
    """Run a problem from its own start with BM4."""
    problem = problems.load(name)
    steps = round(span / h)
    found = lv.integrate(
        problem.system,
        lv.VolumeSplitting(composition="BM4", **SPLITTINGS[splitting]),
        t=(0.0, span),
        steps=steps,
        every=steps // RECORDS,
        states=False,
        **problem.start,
    )
    values = found.invariants[integral]
    errors = np.abs(values / values[0] - 1)
    first, all_of_it = float(errors[: RECORDS // 10 + 1].max()), float(errors.max())
    return {
        "problem": name,
        "integral": integral,
        "splitting": splitting,
        "to T/10": first,
        "to T": all_of_it,
    }


def main():
    show([row(*run, splitting) for run in RUNS for splitting in SPLITTINGS])


if __name__ == "__main__":
    main()
