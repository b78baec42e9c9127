"""What a step costs and how often it corrects itself: HHT beside SUNDIALS' IDA in C.

IDA integrates the index-1 form with analytic Jacobians to a tolerance of 1e-6, HHT takes equal
steps. A correction of HHT evaluates its equations once and solves with kept factors; IDA's
residual evaluations count the same. Needs what work_precision_alpha.py needs. Run as
``python benchmarks/alpha_profile.py``; under ``perf record`` it says which functions take the time.
"""

import numpy as np
from peers import implicit, sundials
from report import show

import liouville as lv
from liouville import problems

STEPS = {"slider_crank": 1000, "andrews": 1000, "chain": 200}
TOLERANCE = 1e-6
REPEATS = 50


def compare(name, steps):
    """Return the two rows of a problem."""
    problem = problems.load(name)
    end = problem.reference[problem.interval[1]]
    q, v = (np.array(end[state]) for state in "qv")
    equation = implicit.implicit(problem.system, "index1", problem.start, problem.interval[0])
    scales = np.abs(q).max(), np.abs(v).max()
    ida = sundials.InC(equation, problem.interval, scales)
    runs = [ida.run(TOLERANCE) for _ in range(REPEATS)]
    counts, seconds = ida.counts(), min(run[0] for run in runs)
    yield {
        "problem": name,
        "code": "IDA in C",
        "error": float(np.abs(runs[-1][1] - q).max() / scales[0]),
        "steps": counts["steps"],
        "us a step": 1e6 * seconds / counts["steps"],
        "evaluations a step": counts["residuals"] / counts["steps"],
        "factorizations a step": counts["factorizations"] / counts["steps"],
    }
    found = [
        lv.integrate(
            problem.system,
            lv.HHT(-0.1),
            t=problem.interval,
            steps=steps,
            every=steps,
            **problem.start,
        )
        for _ in range(REPEATS)
    ]
    run = min(found, key=lambda run: run.stats["seconds"])
    yield {
        "problem": name,
        "code": "HHT",
        "error": float(np.abs(run.q[-1] - q).max() / scales[0]),
        "steps": steps,
        "us a step": 1e6 * run.stats["seconds"] / steps,
        "evaluations a step": run.stats["iterations"] / steps,
        "factorizations a step": run.stats["factorizations"] / steps,
    }


def main():
    sundials.libraries()
    rows = [row for name, steps in STEPS.items() for row in compare(name, steps)]
    show(rows)


if __name__ == "__main__":
    main()
