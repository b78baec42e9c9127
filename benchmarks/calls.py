"""What a call costs beside its steps: imports, a call of one step, the first steps of a chain.

Imports are those of fresh processes, in seconds of the processor, NumPy's own beside. A call is
``lv.integrate`` of one step, in microseconds, the minimum of repeats; the core's share of it is the
start of the run, its step and its records, without Python. A chain of 1000 makes its first six
steps in a call of their own: of a new system, and of one that has run before, in times of six
steady steps. Run as ``python benchmarks/calls.py``; takes a minute.
"""

import subprocess
import sys
import time

from report import publish, show

import liouville as lv
from liouville import _core
from liouville._runs.choice import runner_of
from liouville._runs.runner import Request
from liouville.problems import chain, load

IMPORTS = {"numpy": 9, "liouville": 9, "liouville, casadi": 3}
CALLS = {
    "pendulum, Spark(4)": ("pendulum", lv.Spark(4)),
    "pendulum, HHT": ("pendulum", lv.HHT()),
    "car axis, Spark(3)": ("car_axis", lv.Spark(3)),
    "Andrews, Spark(3)": ("andrews", lv.Spark(3)),
}
REPEATS = 1000
LINKS, FIRST, MORE = 1000, 6, 60


def imported(names):
    """Return seconds of the processor that a process takes for an import."""
    code = f"import {names}, resource; x = resource.getrusage(resource.RUSAGE_SELF)"
    code += "; print(x.ru_utime + x.ru_stime)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(found.stdout)


def least(function, repeats):
    """Return the microseconds of the fastest of some calls."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - begin)
    return 1e6 * best


def call(problem, method):
    """Return the microseconds of a call of one step, and of what the core does in it."""
    t0, h = problem.interval[0], problem.h
    more = {"t": (t0, t0 + h), "steps": 1, **problem.start}

    def whole():
        lv.integrate(problem.system, method, **more)

    start = {name: more[name] for name in problem.start}
    runner = runner_of(problem.system, method, Request(t=more["t"], steps=1, start=start))
    job = runner._job()

    def core():
        run = _core.run(runner._problem, method, job)
        run.advance(1.0)
        run.take()

    return least(whole, REPEATS), least(core, REPEATS)


def first_steps(method):
    """Return the seconds of the first steps of a chain, new and not, and of as many steady ones."""
    system, start, h = chain.build(LINKS), chain.start_for(LINKS), 0.2 / LINKS
    system.observer(None)  # is traced with the model

    def run(steps):
        begin = time.process_time()
        lv.integrate(system, method, t=(0, steps * h), steps=steps, every=steps, **start)
        return time.process_time() - begin

    new = run(FIRST)
    again = min(run(FIRST) for _ in range(5))
    steady = (min(run(MORE) for _ in range(3)) - again) / (MORE - FIRST) * FIRST
    return new, again, steady


def main():
    rows = [
        {"import": names, "s": round(min(imported(names) for _ in range(repeats)), 3)}
        for names, repeats in IMPORTS.items()
    ]
    show(rows)
    rows = []
    for name, (problem, method) in CALLS.items():
        whole, core = call(load(problem), method)
        rows.append({"call of one step": name, "µs": round(whole), "of the core": round(core)})
    publish("calls", rows)
    rows = []
    for method in (lv.Spark(2), lv.Spark(4)):
        new, again, steady = (round(1e3 * seconds, 1) for seconds in first_steps(method))
        row = {"chain of 1000": f"Spark({method.stages})", "new, ms": new, "again, ms": again}
        rows.append(row | {"steady steps, ms": steady})
    show(rows)


if __name__ == "__main__":
    main()
