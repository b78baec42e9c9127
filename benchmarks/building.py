"""Time and peak memory of building a large mechanism, against its number of links.

A chain of point masses in the plane, a polymer in space and a chain of rigid rods with quaternions.
What is built is all of it: the forms that all mechanical methods step, and what runs record; then
a start is moved onto the constraints, and the methods for large systems make their first steps.
Times are the processor's, not the wall clock's. Each size runs in a process of its own; memory is
that process's peak less what the imports took. Run as ``python benchmarks/building.py``, with names
of models to take only those; takes two minutes.
"""

import json
import resource
import subprocess
import sys
import time

import numpy as np
from report import show

import liouville as lv
from liouville import problems

SIZES = {
    "chain": (100, 300, 1_000, 3_000, 10_000),
    "polymer": (100, 300, 1_000, 3_000, 10_000),
    "rigid_chain": (30, 100, 300, 1_000),
}
POWERS_FROM = 300
FIRST = {"RATTLE s": lv.LobattoPair(2), "HHT s": lv.HHT()}
STEP = 1e-3  # times the length of a link, for the first steps


def peak():
    """Peak memory of this process so far, in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def one(model, links):
    """Return the row of one size; runs in its own process."""
    imports = peak()
    row = {"model": model, "links": links}

    def timed(name, function, *args, **more):
        begin = time.process_time()
        found = function(*args, **more)
        row[name] = time.process_time() - begin
        return found

    problem = problems.load(model)
    system = timed("general s", problem.build, links)
    start = problem.start_for(links)
    timed("second order s", getattr, system, "second_order")
    timed("separable s", getattr, system, "separable")
    timed("observer s", system.observer, None, True)
    start = timed("start s", system.consistent, **start)
    h = STEP / links
    for name, method in FIRST.items():
        if name != "RATTLE s" or system.separable is not None:
            timed(name, lv.integrate, system, method, t=(0, h), h=h, **start)
        else:
            row[name] = float("nan")
    row["all s"] = sum(x for key, x in row.items() if key.endswith(" s") and not np.isnan(x))
    row["MiB"] = peak() - imports
    return row


def power(rows, key):
    """Fit the power of the number of links that a quantity grows with, of large systems."""
    large = [row for row in rows if row["links"] >= min(POWERS_FROM, rows[-2]["links"])]
    logs = (np.log([row[key] for row in large]) for key in ("links", key))
    return float(np.polyfit(*logs, 1)[0])


def main():
    if len(sys.argv) == 3 and sys.argv[2].isdigit():
        print(json.dumps(one(sys.argv[1], int(sys.argv[2]))))
        return
    rows, powers = [], []
    for model in sys.argv[1:] or SIZES:
        own = []
        for links in SIZES[model]:
            command = [sys.executable, __file__, model, str(links)]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            own.append(json.loads(done.stdout))
        rows += own
        powers.append({"model": model, **{key: power(own, key) for key in ("all s", "MiB")}})
    show(rows)
    print("\nPowers of the number of links, from", POWERS_FROM, "on:")
    for row in powers:
        print(f"  {row['model']}: all s {row['all s']:.2f}, MiB {row['MiB']:.2f}")


if __name__ == "__main__":
    main()
