"""Tracers in the Bajer-Moffatt flow: microseconds a tracer at equal error, beside other codes.

100000 tracers, uniform in the ball of radius 0.95, to T = 2: at a mean speed of 2.8 three diameters
of the ball. By then the flow has stretched neighbourhoods by 6 in the median, by more than 150 for
one in a hundred tracers, and by up to 1e5: longer runs would measure the errors of a few tracers
only. Errors are those at the end, against Taylor series at a tolerance of 1e-16: their root mean
square, which a few tracers decide, and their median. SciPy alone takes a sample, its time scaled.
Building, planning and compiling are not part of the time; what moves starts in and ends out is.
Of one thread it is the processor's time.

Run as ``python benchmarks/tracers.py``, after ``pip install --group bench``; takes some minutes.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="2")

import argparse

import numpy as np
from peers import flow
from precision import Entry, race, times_at
from report import publish, show

import liouville as lv
from liouville.problems import bajer_moffatt

TRACERS, RADIUS, SPAN, SEED = 100_000, 0.95, 2.0, 4
SAMPLE = 500
LEVELS = (1e-4, 1e-6, 1e-8)
PIECES = ("pairs", "exponentials", "shears")  # "auto" takes the first
STEPS = {
    "BM4": (32, 45, 64, 90, 130, 180, 260, 400),
    "BM6": (14, 19, 26, 36, 50, 70, 100),
    "SS8s21": (12, 16, 22, 30, 40, 52),
}
RK4 = (100, 150, 220, 320, 460, 680, 1000, 1500)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)
PACKAGES = ("heyoka", "numba", "scipy")
FINE = 100  # steps of order 10 that the reference is checked with


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
        begin = flow.clock(self.threads)
        found = lv.ensemble(
            self.field,
            plan,
            t=(0.0, SPAN),
            steps=steps,
            every=steps,
            x=self.start,
            threads=self.threads,
        )
        return flow.clock(self.threads) - begin, found.x[-1]


def flow_field():
    """Return the field alone; the problem's own records an invariant too."""
    params = {"alpha": 1.0, "beta": 1.0}
    return lv.PolynomialField(bajer_moffatt.field, x=("x", "y", "z"), params=params)


def ball(tracers):
    """Return points uniform in the ball, (tracers, 3)."""
    random = np.random.default_rng(SEED)
    directions = random.normal(size=(tracers, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return directions * RADIUS * np.cbrt(random.random((tracers, 1)))


def entries(start, threads):
    """Set up every code for a number of threads."""
    field = flow_field()
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
    own = Splitting(flow_field(), start[:1000], **method)
    ends = own.run(FINE)[1]
    apart = float(np.median(np.linalg.norm(ends - found[:1000], axis=1)))
    if apart > 1e-12:
        raise AssertionError(f"two references differ by {apart:.1e}")
    return found


def compare(runs, threads):
    """Return a row for each code: microseconds a tracer, and how many times our fastest's."""
    wanted = [(measure, error) for measure in ("rms", "median") for error in LEVELS]
    times = {want: times_at(runs, *want) for want in wanted}
    fastest = {
        want: min((found[code] for code in found if is_own(code)), key=infinite_if_missing)
        for want, found in times.items()
    }
    for code in times[wanted[0]]:
        row = {"threads": threads, "code": code}
        for measure, error in wanted:
            row[f"{measure} {error:.0e}"] = 1e6 * times[measure, error][code] / TRACERS
        for want in (("rms", 1e-6), ("median", 1e-6)):
            row[f"of ours, {want[0]} 1e-6"] = times[want][code] / fastest[want]
        yield row


def is_own(code):
    """Whether a code is the library's."""
    return code.startswith(tuple(STEPS))


def infinite_if_missing(seconds):
    """Sort what is not a number last."""
    return seconds if np.isfinite(seconds) else np.inf


def main():
    parser = argparse.ArgumentParser(description="tracers in the Bajer-Moffatt flow")
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--only", nargs="*", default=[""], help="codes that begin so")
    given = parser.parse_args()
    start = ball(TRACERS)
    ends = reference(start)

    def errors(x):
        distances = np.linalg.norm(x - ends[: len(x)], axis=1)
        return {"rms": float(np.sqrt((distances**2).mean())), "median": float(np.median(distances))}

    table, runs = [], []
    for threads in given.threads:
        found = [e for e in entries(start, threads) if e.code.startswith(tuple(given.only))]
        race(found, errors)
        runs += [{"threads": threads, **entry.row()} for entry in found]
        table += compare(found, threads)
    show(runs)
    print("\nMicroseconds a tracer:\n")
    columns = ("threads", "code", "rms 1e-04", "rms 1e-06", "median 1e-06")
    publish("tracers", table, PACKAGES, columns)


if __name__ == "__main__":
    main()
