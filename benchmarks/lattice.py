"""One large sparse field: inviscid Lorenz-96 with up to ten million sites.

First what a step costs: nanoseconds a site, from the difference of a long and a short run, beside
RK4 in Numba and beside the memory: a STREAM triad over as many bytes as the state has, in the same
round with the same threads. A flow of one colour reads the state and writes its share of it,
8 + 8/3 bytes a site. That many times the flows of a step is what the step moves, colour by colour;
its speed over the triad's is the part of the bandwidth that is reached. Then the time for T = 1 at
equal error, for one random state of each size: the root mean square over the sites, against RK4
with very small steps.

Run as ``python benchmarks/lattice.py``, after ``pip install liouville[bench]``; takes some minutes
and, with ten million sites, some gigabytes.
"""

import argparse
import time

import numpy as np
from peers import lattice
from precision import Entry, race, times_at
from report import publish

import liouville as lv
from liouville import problems

SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
COMPARED = (10_000, 100_000, 1_000_000)
UPDATES = 40_000_000  # sites times steps in the long run
SHORT, ROUNDS, SEED = 4, 7, 1
H, SPAN = 0.005, 1.0
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10)
SWEEPS = {"S2": 2, "BM4": 12}  # half steps through all colours
COLOURS = 3
STEPS = {
    "S2": (100, 400, 1600, 6400),
    "BM4": (6, 9, 13, 20, 30, 45, 70, 110, 170, 260),
    "BM6": (4, 6, 8, 11, 15, 21, 30, 42, 60),
    "SS8s21": (3, 4, 5, 7, 9, 12, 16, 22),
}
RK4 = (10, 15, 22, 33, 50, 75, 110, 170, 250, 380)
REFERENCE = (1500, 3000)


class Splitting:
    """The library's own run, with a plan made beforehand."""

    def __init__(self, field, start, span, *, composition, threads):
        method = lv.VolumeSplitting("exponentials", "natural", composition=composition)
        self.field, self.start, self.span, self.threads = field, start, span, threads
        self.plan = lv.plan(field, method, h=H, x=start)

    def run(self, steps):
        """Integrate with a number of steps."""
        begin = time.perf_counter()
        found = lv.integrate(
            self.field,
            self.plan,
            t=(0.0, self.span),
            steps=steps,
            every=steps,
            x=self.start,
            threads=self.threads,
        )
        return time.perf_counter() - begin, found.x[-1]

    def step(self, steps):
        """Return the seconds of a step, from a long and a short run, and the state."""
        times = []
        for count in (SHORT, SHORT + steps):
            self.span = count * H
            times.append(self.run(count)[0])
        return (times[1] - times[0]) / steps, None


class Steps:
    """What a peer's steps cost, in the manner of `Splitting.step`."""

    def __init__(self, peer):
        self.peer = peer

    def step(self, steps):
        """Return the seconds of a step."""
        times = []
        for count in (SHORT, SHORT + steps):
            self.peer.span = count * H
            times.append(self.peer.run(count)[0])
        return (times[1] - times[0]) / steps, None


def costs(n, threads):
    """Return the row of one size and number of threads."""
    start = np.random.default_rng(SEED).normal(size=n)
    field = problems.load("lorenz96").build(n)
    steps = max(8, UPDATES // n)
    codes = {
        scheme: Splitting(field, start, H, composition=scheme, threads=threads) for scheme in SWEEPS
    }
    codes |= {
        f"RK4, {name}": Steps(lattice.Numba(start, H, tiled=tiled, threads=threads))
        for name, tiled in (("plain", False), ("tiles", True))
        if tiled or threads == 1
    }
    triad = lattice.Triad(8 * n, threads=threads)
    seconds, speed = dict.fromkeys(codes, np.inf), 0.0
    for _ in range(ROUNDS):
        for name, code in codes.items():
            seconds[name] = min(seconds[name], code.step(steps)[0])
        speed = max(speed, triad.run(steps)[1])
    row = {"n": n, "threads": threads}
    row |= {f"ns a site, {name}": 1e9 * x / n for name, x in seconds.items()}
    row["triad GB/s"] = 1e-9 * speed
    for scheme, sweeps in SWEEPS.items():
        flows = sweeps * (COLOURS - 1)  # neighbouring flows of one colour are one
        moved = flows * 8 * (1 + 1 / COLOURS) * n / seconds[scheme]
        row[f"{scheme} GB/s"] = 1e-9 * moved
        row[f"{scheme} of triad"] = moved / speed
    return row


def compare(n, threads):
    """Return the runs of one size, and a row for each error."""
    start = np.random.default_rng(SEED).normal(size=n)
    field = problems.load("lorenz96").build(n)
    coarse, end = (
        lattice.Numba(start, SPAN, tiled=True, threads=1).run(steps)[1] for steps in REFERENCE
    )
    if np.abs(coarse - end).max() > 1e-11:
        raise AssertionError("the reference is not settled")

    def errors(x):
        return {"rms": float(np.sqrt(((x - end) ** 2).mean()))}

    found = [
        Entry(scheme, solver, setting)
        for scheme, settings in STEPS.items()
        for solver in [Splitting(field, start, SPAN, composition=scheme, threads=threads)]
        for setting in settings
    ]
    for name, tiled in (("RK4, plain", False), ("RK4, tiles", True)):
        if tiled or threads == 1:
            solver = lattice.Numba(start, SPAN, tiled=tiled, threads=threads)
            found += [Entry(name, solver, setting) for setting in RK4]
    race(found, errors)
    rows = []
    for error in LEVELS:
        times = times_at(found, "rms", error)
        own = min((times[scheme] for scheme in STEPS if np.isfinite(times[scheme])), default=np.nan)
        row = {"n": n, "threads": threads, "error": error}
        row |= {f"{code} ms": 1e3 * x for code, x in times.items()}
        row |= {f"{code} / ours": x / own for code, x in times.items() if code not in STEPS}
        rows.append(row)
    return [{"n": n, "threads": threads, **entry.row()} for entry in found], rows


def main():
    parser = argparse.ArgumentParser(description="inviscid Lorenz-96 with many sites")
    parser.add_argument("--largest", type=int, default=SIZES[-1], help="leave out larger ones")
    largest = parser.parse_args().largest
    sizes = [n for n in SIZES if n <= largest]
    for threads in (1, 2):
        publish(f"lattice_steps_{threads}", [costs(n, threads) for n in sizes], ("numba",))
        runs, table = [], []
        for n in COMPARED:
            if n <= largest:
                more, rows = compare(n, threads)
                runs, table = runs + more, table + rows
        publish(f"lattice_runs_{threads}", runs, ("numba",))
        print("\nMilliseconds for T = 1:\n")
        publish(f"lattice_{threads}", table, ("numba",))


if __name__ == "__main__":
    main()
