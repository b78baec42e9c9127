"""One large sparse field: inviscid Lorenz-96 with up to ten million sites.

First what a step costs: nanoseconds a site, beside RK4 in Numba and beside the memory: a STREAM
triad over as many bytes as the state has, in turn and with the same threads. Costs are the least
over slices of a twentieth of a second; what starts a run is not in them. A flow of one colour reads
the state and writes its share of it, 8 + 8/3 bytes a site; that many times the flows of a step is
what the step moves, colour by colour, and its speed over the triad's is the part of the bandwidth
that is reached. Then the time for T = 1 at equal error, for one random state of each size: the root
mean square over the sites, against RK4 with very small steps; times are steps times their cost.

Run as ``python benchmarks/lattice.py``, after ``pip install --group bench``; takes ten minutes
and, with ten million sites, some gigabytes.
"""

import argparse
import time
from itertools import pairwise

import numpy as np
from peers import lattice
from precision import Entry, times_at
from report import show

import liouville as lv
from liouville.problems import lorenz96

SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
COMPARED = (10_000, 100_000, 1_000_000)
THREADS = (1, 2)
SLICE, SLICES, ROUNDS, SEED = 0.05, 12, 3, 1
SMALL, SPAN = 1e-4, 1.0
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10)
COLOURS = 3
SWEEPS = {"S2": 2, "BM4": 12, "BM6": 20, "SS8s21": 42}  # half steps through all colours
STEPS = {
    "S2": (60, 200, 600, 2000),
    "BM4": (4, 6, 10, 16, 28, 50, 90, 150),
    "BM6": (3, 4, 6, 9, 13, 20, 30),
    "SS8s21": (3, 4, 6, 9, 13),
}
RK4 = (10, 16, 25, 40, 64, 100, 160, 250, 400)
REFERENCE = (1500, 3000)


class Splitting:
    """The library's own run, with a plan made beforehand."""

    def __init__(self, field, start, composition):
        method = lv.VolumeSplitting("exponentials", "natural", composition=composition)
        self.field, self.start = field, start
        self.plan = lv.plan(field, method, h=SMALL, x=start)

    def run(self, span, steps, threads=1, progress=None):
        """Integrate, and return the end."""
        found = lv.integrate(
            self.field,
            self.plan,
            t=(0.0, span),
            steps=steps,
            every=steps,
            progress=progress,
            threads=threads,
            x=self.start,
        )
        return found.x[-1]

    def cost(self, guess, threads):
        """Return the seconds of a step: the least over the slices that progress is told of."""
        marks = []
        steps = 1 + int(SLICE * SLICES / guess)

        def mark(done, total):
            marks.append((time.perf_counter(), done))

        self.run(SMALL * steps, steps, threads, mark)
        return min((b[0] - a[0]) / (b[1] - a[1]) for a, b in pairwise(marks) if b[1] > a[1])


class Peer:
    """RK4 in Numba, asked in the same way."""

    def __init__(self, start, threads, *, tiled):
        self.code = lattice.Numba(start, SPAN, tiled=tiled, threads=threads)

    def run(self, steps):
        """Integrate to the end, and return it."""
        self.code.span = SPAN
        return self.code.run(steps)[1]

    def cost(self, guess, threads):
        """Return the seconds of a step: the least over slices."""
        steps = 1 + int(SLICE / guess)
        self.code.span = steps * SMALL
        return min(self.code.run(steps)[0] for _ in range(SLICES)) / steps


def codes(field, start, threads, schemes):
    """Return the codes by name."""
    found = {scheme: Splitting(field, start, scheme) for scheme in schemes}
    found["RK4, tiles"] = Peer(start, threads, tiled=True)
    if threads == 1:
        found["RK4, plain"] = Peer(start, threads, tiled=False)
    return found


def costs(n, threads):
    """Return the seconds of a step of each code, in turn, and the bytes a second of the triad."""
    start = np.random.default_rng(SEED).normal(size=n)
    few = n > COMPARED[-1]
    found = codes(lorenz96.build(n), start, threads, ["S2"] if few else STEPS)
    triad = lattice.Triad(8 * n, threads=threads)
    seconds, speed = dict.fromkeys(found, np.inf), 0.0
    for _ in range(1 if few else ROUNDS):
        for name, code in found.items():
            guess = 1e-9 * n * SWEEPS.get(name, 4) / 4 / threads
            seconds[name] = min(seconds[name], code.cost(guess, threads))
        repeats = 1 + int(SLICE * 2e10 / (8 * n))
        speed = max(speed, *(triad.run(repeats)[1] for _ in range(SLICES)))
    return seconds, speed


def costs_row(n, threads, seconds, speed):
    """Return costs as a row of a table."""
    row = {"n": n, "threads": threads}
    names = (*STEPS, "RK4, tiles", "RK4, plain")
    row |= {f"{name} ns": 1e9 * seconds.get(name, np.nan) / n for name in names}
    flows = SWEEPS["S2"] * (COLOURS - 1)  # neighbouring flows of one colour are one
    moved = flows * 8 * (1 + 1 / COLOURS) * n / seconds["S2"]
    return row | {"triad GB/s": 1e-9 * speed, "S2 GB/s": 1e-9 * moved, "share": moved / speed}


def errors(n):
    """Return the error of each code with each number of steps."""
    start = np.random.default_rng(SEED).normal(size=n)
    found = codes(lorenz96.build(n), start, 1, STEPS)
    del found["RK4, plain"]  # in other words what the tiles do
    coarse, end = (found["RK4, tiles"].run(steps) for steps in REFERENCE)
    if np.abs(coarse - end).max() > 1e-10:
        raise AssertionError("the reference is not settled")
    reached = {}
    for name, code in found.items():
        for steps in STEPS.get(name, RK4):
            x = code.run(SPAN, steps) if name in STEPS else code.run(steps)
            reached[name, steps] = float(np.sqrt(((x - end) ** 2).mean()))
    return reached


def compare(n, threads, seconds, reached):
    """Return a row for each error: milliseconds of each code, and how many times our fastest's."""
    runs = []
    for name, cost in seconds.items():
        for (code, steps), error in reached.items():
            if code == name or (code, name) == ("RK4, tiles", "RK4, plain"):
                runs.append(Entry(name, None, steps, steps * cost, {"rms": error}))
    for error in LEVELS:
        times = times_at(runs, "rms", error)
        own = min(times[scheme] for scheme in STEPS if np.isfinite(times[scheme]))
        row = {"n": n, "threads": threads, "error": error}
        row |= {f"{name} ms": 1e3 * x for name, x in times.items()}
        yield row | {f"{name} / ours": x / own for name, x in times.items() if name not in STEPS}


def main():
    parser = argparse.ArgumentParser(description="inviscid Lorenz-96 with many sites")
    parser.add_argument("--largest", type=int, default=SIZES[-1], help="leave out larger ones")
    largest = parser.parse_args().largest
    sizes = [n for n in SIZES if n <= largest]
    found = {(n, threads): costs(n, threads) for n in sizes for threads in THREADS}
    show([costs_row(*key, *cost) for key, cost in found.items()])
    reached = {n: errors(n) for n in COMPARED if n <= largest}
    for threads in THREADS:
        print(f"\nMilliseconds for T = 1, threads: {threads}\n")
        rows = [
            row
            for n, errors_of_n in reached.items()
            for row in compare(n, threads, found[n, threads][0], errors_of_n)
        ]
        show(rows)


if __name__ == "__main__":
    main()
