"""Tracers in the ABC flow at equal error, beside RK4 by Numba: what sines and cosines cost.

1024 tracers, uniform in the cell of the flow, to T = 10, on one thread: microseconds of processor
time a tracer for a root mean square error. Then a single trajectory of 200 times that length, of
which each code makes as many steps a unit of time as the error took: microseconds for the length of
one tracer above.

Run as ``python benchmarks/abc_tracers.py``, after ``pip install --group bench``; takes a minute.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1")

import time

import numpy as np
from peers import abc
from precision import Entry, race, times_at
from report import publish

import liouville as lv
from liouville.problems import abc_flow

TRACERS, SPAN, SEED, LONGER = 1024, 10.0, 4, 200
LEVELS = (1e-4, 1e-6, 1e-8)
STEPS = {
    "BM4": (20, 32, 45, 64, 90, 130, 180, 260, 400),
    "BM6": (10, 14, 19, 26, 32, 36, 50, 70, 100),
    "SS8s21": (8, 12, 16, 18, 22, 30, 40),
}
RK4 = (64, 100, 150, 200, 220, 320, 460, 680, 1000, 1500, 2200)


class Splitting:
    """The library's own, of pieces in their order."""

    def __init__(self, start, span, composition):
        params = {"A": abc.A, "B": abc.B, "C": abc.C}
        self.field = lv.PolynomialField(abc_flow.field, x=("x", "y", "z"), params=params)
        self.start, self.span = start, span
        self.method = lv.VolumeSplitting(
            "exponentials", "natural", composition=composition, linear="split"
        )

    def run(self, steps):
        """Integrate with a number of steps."""
        span = {"t": (0.0, self.span), "steps": steps, "every": steps}
        begin = time.process_time()
        if len(self.start) > 1:
            found = lv.ensemble(self.field, self.method, x=self.start, threads=1, **span).x[-1]
        else:
            found = lv.integrate(self.field, self.method, x=self.start[0], **span).x[-1:]
        return time.process_time() - begin, found


def codes(start, span):
    """Return the codes by name, each with its numbers of steps for the short run."""
    own = {name: (Splitting(start, span, name), steps) for name, steps in STEPS.items()}
    peers = {"Numba RK4, loop": abc.loop, "Numba RK4, vectors": abc.vectors}
    return own | {name: (abc.RK4(start, span, kernel), RK4) for name, kernel in peers.items()}


def rms(found, wanted):
    """Return the root mean square of the distances."""
    return {"rms": float(np.sqrt(np.mean(np.sum((found - wanted) ** 2, axis=1))))}


def main():
    """Race the codes."""
    random = np.random.default_rng(SEED)
    start = random.uniform(0, 2 * np.pi, (TRACERS, 3))
    wanted = Splitting(start, SPAN, "SS10s35").run(150)[1]
    other = abc.RK4(start, SPAN, abc.loop).run(6000)[1]
    if rms(other, wanted)["rms"] > 1e-9:
        raise AssertionError("two references differ")
    entries = [
        Entry(name, code, n) for name, (code, steps) in codes(start, SPAN).items() for n in steps
    ]
    race(entries, lambda found: rms(found, wanted))
    times = {error: times_at(entries, "rms", error) for error in LEVELS}
    long = codes(start[:1], LONGER * SPAN)
    rows = []
    for name in times[LEVELS[0]]:
        mine = [entry for entry in entries if entry.code == name]
        row = {"code": name} | {f"rms {e:.0e}": 1e6 * times[e][name] / TRACERS for e in LEVELS}
        enough = [entry.setting for entry in mine if entry.errors["rms"] <= LEVELS[1]]
        if enough:
            steps = min(enough)
            seconds = min(long[name][0].run(LONGER * steps)[0] for _ in range(20))
            row |= {"steps": steps, "alone 1e-06": 1e6 * seconds / LONGER}
        rows.append(row)
    columns = ("code", *(f"rms {e:.0e}" for e in LEVELS), "alone 1e-06")
    publish("abc_tracers", rows, ("numba",), columns)


if __name__ == "__main__":
    main()
