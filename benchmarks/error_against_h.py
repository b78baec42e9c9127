"""Error against step size for s = 1..6 on the car axis and on Andrews' squeezing mechanism.

The errors are relative, against the quadruple-precision end states; the slope is fitted over the
finest four step sizes above roundoff. Prints one Markdown table for each problem and state.
"""

import liouville as lv
from liouville import problems
from liouville.analysis import convergence

STEPS = {
    "car_axis": (80, 100, 125, 160, 200, 300, 600, 1200, 2400, 4800),
    "andrews": (45, 50, 60, 75, 90, 110, 150, 300, 600, 1200),
}


def table(name, steps, state):
    """Return the rows of the table of one problem and state."""
    problem = problems.load(name)
    span = problem.interval[1] - problem.interval[0]
    reference = problem.reference[problem.interval[1]]
    yield f"| steps | {' | '.join(map(str, steps))} | slope |"
    yield f"|---|{'---|' * (len(steps) + 1)}"
    for stages in range(1, 7):
        study = convergence.study(
            problem.system,
            lv.Spark(stages),
            problem.interval,
            [span / count for count in steps],
            problem.start,
            reference,
            of=(state,),
        )
        errors = " | ".join(f"{error:.1e}" for error in study.errors[state])
        yield f"| s = {stages} | {errors} | {study.order[state]:.2f} |"


def main():
    for name, steps in STEPS.items():
        for state in ("q", "v"):
            print(f"\n{name}, {state}\n", *table(name, steps, state), sep="\n")


if __name__ == "__main__":
    main()
