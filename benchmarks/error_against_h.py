"""Error against step size for s = 1..6 on the car axis and on Andrews' squeezing mechanism.

The errors are relative, against the quadruple-precision end states; the slope is fitted over the
finest four step sizes above roundoff. The first table is that of positions of the car axis.
"""

from report import publish, show

import liouville as lv
from liouville import problems
from liouville.analysis import convergence

STEPS = {
    "car_axis": (80, 100, 125, 160, 300, 600, 1200, 4800),
    "andrews": (45, 50, 60, 75, 90, 110, 150, 300, 600, 1200),
}


def table(name, steps, state):
    """Return the rows of the table of one problem and state."""
    problem = problems.load(name)
    span = problem.interval[1] - problem.interval[0]
    reference = problem.reference[problem.interval[1]]
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
        errors = (f"{error:.1e}" for error in study.errors[state])
        row = {"steps": f"s = {stages}"} | dict(zip(map(str, steps), errors, strict=True))
        yield row | {"slope": f"{study.order[state]:.2f}"}


def main():
    for name, steps in STEPS.items():
        for state in ("q", "v"):
            print(f"\n{name}, {state}\n")
            rows = list(table(name, steps, state))
            if (name, state) == ("car_axis", "q"):
                publish("error_against_h", rows)
            else:
                show(rows)


if __name__ == "__main__":
    main()
