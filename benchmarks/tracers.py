"""Tracers in the Bajer-Moffatt flow: microseconds a tracer at equal error, beside other codes.

100000 tracers, uniform in the ball of radius 0.95, to T = 2. The flow stretches and folds: by then
the largest stretch of a neighbourhood is about 100, and the unit sphere, which pulls tracers along,
has been met by most of them; for longer times the errors of a few tracers are all that a root mean
square sees. Errors are those at the end, against Taylor series at a tolerance of 1e-16, as root mean
square and as median over the tracers. SciPy alone takes a sample, its time scaled. Building, planning
and compiling are not part of the time; what moves starts in and ends out is.

Run as ``python benchmarks/tracers.py``, after ``pip install liouville[bench]``; takes some minutes.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="2")

import argparse
import time

import numpy as np
from peers import flow
from precision import Entry, race, times_at
from report import publish

import liouville as lv
from liouville import problems

TRACERS, RADIUS, SPAN, SEED = 100_000, 0.95, 2.0, 4
SAMPLE = 200
LEVELS = (1e-4, 1e-6, 1e-8)
PIECES = ("exponentials", "shears", "auto")
STEPS = {
    "BM4": (24, 36, 54, 80, 120, 180, 270, 400),
    "BM6": (10, 14, 18, 24, 30, 38, 48, 64, 90),
    "SS8s21": (6, 8, 10, 12, 15, 18, 22, 28),
}
RK4 = (100, 150, 220, 320, 460, 680, 1000, 1500)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)
PACKAGES = ("heyoka", "numba", "scipy")
COARSE, FINE = 200, 300  # steps of the order 10 that checks the reference


class Splitting:
    """The library's own ensemble, with a plan made beforehand."""

    def __init__(self, field, start, *, diagonal, composition, threads):
        self.field, self.start, self.threads = field, start, threads
        self.method = lv.VolumeSplitting(diagonal, composition=composition)
        self.plans = {}

    def plan(self, steps):
        """Return the plan for a number of steps, made once."""
        if steps not in self.plans:
            pilot = self.start[:64]
            self.plans[steps] = lv.plan(self.field, self.method, h=SPAN / steps, x=pilot)
        return self.plans[steps]

    def run(self, steps):
        """Integrate with a number of steps."""
        plan = self.plan(steps)
        begin = time.perf_counter()
        found = lv.ensemble(
            self.field,
            plan,
            t=(0.0, SPAN),
            steps=steps,
            every=steps,
            x=self.start,
            threads=self.threads,
        )
        return time.perf_counter() - begin, found.x[-1]


def ball(tracers):
    """Return points uniform in the ball, (tracers, 3)."""
    random = np.random.default_rng(SEED)
    directions = random.normal(size=(tracers, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return directions * RADIUS * np.cbrt(random.random((tracers, 1)))


def entries(start, threads):
    """Set up every code for a number of threads."""
    field = problems.load("bajer_moffatt").system
    codes = [
        (f"{scheme}, {pieces}", Splitting(field, start, **given), STEPS[scheme])
        for pieces in PIECES
        for scheme in STEPS
        for given in [{"diagonal": pieces, "composition": scheme, "threads": threads}]
    ]
    rk4 = ("Numba RK4, loop", False), ("Numba RK4, vectors", True)
    codes += [
        (name, flow.Numba(start, SPAN, vectorised=vectorised, threads=threads), RK4)
        for name, vectorised in rk4
    ]
    codes.append(("heyoka", flow.Heyoka(start, SPAN, threads=threads), TOLERANCES))
    if threads == 1:
        codes += [
            ("NumPy RK4", flow.NumPy(start, SPAN, chunk=0), RK4[:-2]),
            ("NumPy RK4, chunks", flow.NumPy(start, SPAN), RK4[:-2]),
            ("DOP853, one system", flow.SciPy(start, SPAN, sample=0), TOLERANCES[2:]),
            ("DOP853, each alone", flow.SciPy(start, SPAN, sample=SAMPLE), TOLERANCES[2:]),
        ]
    return [
        Entry(name, solver, setting) for name, solver, settings in codes for setting in settings
    ]


def reference(start):
    """Return the ends of the tracers, from Taylor series, once a second method agrees."""
    _, found = flow.Heyoka(start, SPAN, threads=1).run(1e-16)
    method = {"diagonal": "exponentials", "composition": "SS10s35", "threads": 1}
    own = Splitting(problems.load("bajer_moffatt").system, start[:1000], **method)
    apart = max(np.abs(own.run(steps)[1] - found[:1000]).max() for steps in (COARSE, FINE))
    if apart > 1e-11:
        raise AssertionError(f"two references differ by {apart:.1e}")
    return found


def compare(runs, threads):
    """Return a row for each measure and error: microseconds a tracer, and ratios to the best own."""
    for measure in ("rms", "median"):
        for error in LEVELS:
            times = times_at(runs, measure, error)
            times = {code: 1e6 * seconds / TRACERS for code, seconds in times.items()}
            own = {code: x for code, x in times.items() if code.startswith(tuple(STEPS))}
            fastest = min((x for x in own.values() if np.isfinite(x)), default=np.nan)
            row = {"threads": threads, "of": measure, "error": error, **times}
            peers = {code: x / fastest for code, x in times.items() if code not in own}
            yield row | {f"{code} / ours": ratio for code, ratio in peers.items()}


def main():
    parser = argparse.ArgumentParser(description="tracers in the Bajer-Moffatt flow")
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    start = ball(TRACERS)
    ends = reference(start)

    def errors(x):
        distances = np.linalg.norm(x - ends[: len(x)], axis=1)
        return {"rms": float(np.sqrt((distances**2).mean())), "median": float(np.median(distances))}

    table, runs = [], []
    for threads in parser.parse_args().threads:
        found = entries(start, threads)
        race(found, errors)
        runs += [{"threads": threads, **entry.row()} for entry in found]
        table += compare(found, threads)
    publish("tracers_runs", runs, PACKAGES)
    print("\nMicroseconds a tracer:\n")
    for row in table:
        print(
            *(f"{key}: {x:.3g}" if isinstance(x, float) else x for key, x in row.items()), sep="; "
        )
    publish("tracers", table, PACKAGES)


if __name__ == "__main__":
    main()
