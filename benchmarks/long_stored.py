"""Long runs whose records go to disk: the memory they take, and the seconds that storing adds.

The planar pendulum and the heavy top are integrated with ``store=`` and a checkpoint every five
seconds, every hundredth step stored unless said otherwise, and a hundredth of the way also without
storing anything but the ends. Memory is the peak of the process; it must not grow with the number
of steps. Run as ``python benchmarks/long_stored.py [STEPS [EVERY]]``, by default with 1e6 steps;
1e8 take twenty minutes on two cores.
"""

import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from report import show

import liouville as lv
from liouville import problems

RUNS = (("pendulum", lv.Spark(2), 0.01), ("heavy_top", lv.Spark(3), 1e-3))


def run(name, method, h, steps, every, store):
    """Integrate in this process; returns seconds, and MiB of memory and on disk."""
    problem = problems.load(name)
    where = {"t": (0.0, steps * h), "steps": steps, **problem.start}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.zarr"
        begin = time.perf_counter()
        if store:
            lv.integrate(problem.system, method, every=every, store=lv.Store(path, "5s"), **where)
        else:
            lv.integrate(problem.system, method, every=steps, **where)
        took = time.perf_counter() - begin
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return took, peak / 1024, size / 2**20


def alone(*asked):
    """Run in a process of its own, whose memory is that of the run."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(run, *asked).result()


def row(name, method, h, steps, every):
    """Return what a run takes, a hundredth of it and all."""
    bare, *_ = alone(name, method, h, steps // 100, every, False)
    stored, least, _ = alone(name, method, h, steps // 100, every, True)
    took, most, size = alone(name, method, h, steps, every, True)
    return {
        "problem": name,
        "steps": steps,
        "records": steps // every + 1,
        "MiB on disk": size,
        "MiB of memory, a hundredth": least,
        "MiB of memory, all": most,
        "s": took,
        "stored / not stored": stored / bare,
    }


def main():
    given = [int(float(x)) for x in sys.argv[1:]]
    steps, every = (*given, *(1_000_000, 100)[len(given) :])
    with ThreadPoolExecutor(2) as pool:
        show(list(pool.map(lambda run: row(*run, steps, every), RUNS)))


if __name__ == "__main__":
    main()
