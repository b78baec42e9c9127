"""Work against precision: the alpha methods beside four other codes on three mechanisms.

Errors are those at the end against the problems' references, relative to the largest component, in
positions and in velocities; times are minima of repeats, all codes taken in turn in one process on
one thread. Each code runs in every form of the equations it takes (``peers``), and its fastest run
that reaches an error counts, in between by powers. Setting up is not part of the time: symbols,
tapes, C compilers, Exudyn's assembly. IDA appears twice: through scikit-sundae, which calls into
Python at every residual, and as the same library driven from C alone.

Run as ``python benchmarks/work_precision_alpha.py``, after ``pip install liouville[bench]`` and
with a C compiler; takes some minutes. Draws results/work_precision_alpha.png.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import matplotlib.pyplot as plt
import numpy as np
from peers import general, implicit, mechanisms, sundials
from report import RESULTS, publish

import liouville as lv
from liouville import problems

TOLERANCES = tuple(10.0**-k for k in range(2, 11))
LEVELS = (1e-3, 1e-4, 1e-5, 1e-6)
SHARE = 0.3  # seconds of repeats a run may take, within 1 and 40 repeats
OWN = ("HHT", "generalised alpha", "Spark(3)")


@dataclass
class Case:
    """A problem with its end state, and the numbers of steps that equal steps are tried with."""

    name: str
    build: Callable
    start: dict
    span: tuple
    reference: tuple
    mechanism: Callable
    steps: tuple
    spark: tuple

    @cached_property
    def system(self):
        """The system, traced."""
        return self.build()

    @property
    def scales(self):
        """The largest position and velocity of the end state."""
        return tuple(float(np.abs(state).max()) for state in self.reference)


@dataclass
class Entry:
    """One code in one form with one setting, and what it took and reached."""

    family: str
    variant: str
    setting: float
    solver: object
    seconds: float = np.inf
    errors: tuple = ()
    repeats: int = 0
    trouble: str = ""


@dataclass
class Own:
    """A method of the library; the run is timed as its statistics say, without tracing."""

    method: object
    case: Case
    control: bool

    def run(self, setting):
        """Integrate with a relative tolerance or a number of steps."""
        case, pace = self.case, {"steps": setting}
        if self.control:
            pace = {"rtol": setting, "atol": setting * case.scales[0]}
        found = lv.integrate(
            case.system, self.method, t=case.span, every=10**9, **pace, **case.start
        )
        return found.stats["seconds"], found.q[-1], found.v[-1]


def case(name, steps, spark):
    """Return one of the library's problems that have a mechanism and a reference."""
    problem = problems.load(name)
    end = problem.reference[problem.interval[1]]
    reference = tuple(np.array(end[state]) for state in "qv")

    def build():
        names, params = problem.system.coordinates, problem.system.params
        return lv.Lagrangian(problem.lagrangian, problem.constraint, q=names, params=params)

    if name == "chain":
        build = partial(problem.build, 10)
    start, mechanism = problem.start, getattr(mechanisms, name)
    return Case(name, build, start, problem.interval, reference, mechanism, steps, spark)


def long_chain(links):
    """Return a chain without a published end state; its own is that of Spark(5)."""
    chain = problems.load("chain")
    start, ends = chain.start_for(links), []
    for count in (20 * links, 40 * links):
        found = lv.integrate(
            chain.build(links), lv.Spark(5), t=chain.interval, steps=count, **start
        )
        ends.append((found.q[-1], found.v[-1]))
    if max(np.abs(a - b).max() for a, b in zip(*ends, strict=True)) > 1e-10:
        raise AssertionError("the chain's end state is not settled")
    steps = tuple(int(20 * 2 ** (k / 2)) for k in range(15))
    spark = (6, 8, 12, 16, 24, 40)
    build, name = partial(chain.build, links), f"chain of {links}"
    return Case(name, build, start, chain.interval, ends[1], mechanisms.chain, steps, spark)


def cases():
    """Yield the cases by name, each made when it is its turn."""
    crank = tuple(int(100 * 2 ** (k / 2)) for k in range(16))
    few = tuple(int(10 * 2 ** (k / 2)) for k in range(16))
    yield "slider_crank", partial(case, "slider_crank", crank, (20, 30, 40, 60, 80, 120, 160))
    yield "andrews", partial(case, "andrews", crank, (45, 50, 60, 75, 90, 110, 150))
    yield "chain", partial(case, "chain", few, (3, 4, 6, 8, 10, 15, 20))
    yield "chain of 40", partial(long_chain, 40)


def entries(case):
    """Set up every code on a case; returns its runs and the seconds that setting up took."""
    found, took = [], {}

    def add(family, variant, settings, make, *args):
        begin = time.perf_counter()
        try:
            solver = make(*args)
        except Exception as trouble:
            print(f"{case.name}: {family}, {variant} is left out: {trouble}")
            return
        took[family] = took.get(family, 0.0) + time.perf_counter() - begin
        found.extend(Entry(family, variant, setting, solver) for setting in settings)

    begin = time.perf_counter()
    _ = case.system
    took["Spark(3)"] = time.perf_counter() - begin
    _ = case.system.second_order
    for family, method in (("HHT", lv.HHT(-0.1)), ("generalised alpha", lv.GeneralizedAlpha(0.9))):
        took[family] = time.perf_counter() - begin
        add(family, "controlled", TOLERANCES, Own, method, case, True)
        add(family, "equal steps", case.steps, Own, method, case, False)
    add("Spark(3)", "equal steps", case.spark, Own, lv.Spark(3), case, False)
    place, sparse = (case.span, case.scales), len(case.start["q"]) > 20
    for form in implicit.FORMS:
        begin = time.perf_counter()
        equation = implicit.implicit(case.system, form, case.start, case.span[0])
        _ = equation.library
        compiling = time.perf_counter() - begin
        add("IDA in C", form, TOLERANCES, sundials.InC, equation, *place, sparse)
        package = sundials.ScikitSundae
        add("IDA, scikit-sundae", form, TOLERANCES, package, equation, *place, sparse)
        for method in ("Radau", "BDF") if form != "index2" else ():
            variant, few = f"{method}, {form}", TOLERANCES[1:6]
            add("scipy_dae", variant, few, general.ScipyDae, equation, *place, method)
        for family in ("IDA in C", "IDA, scikit-sundae", "scipy_dae"):
            took[family] = took.get(family, 0.0) + compiling
    for form in general.FORMS:
        given = case.system, form, case.start, *place, TOLERANCES
        add("CasADi IDAS", form, TOLERANCES, general.Idas, *given)
    for solver in ("dense", "sparse") if sparse else ("dense",):
        given = case.mechanism, case.system, case.start, case.span, solver
        add("Exudyn", f"equal steps, {solver}", case.steps, mechanisms.Exudyn, *given)
    return found, took


def measure(case, entries):
    """Run all once for warmth and errors, then in turn until each has had its share."""
    for entry in entries:
        try:
            seconds, *end = entry.solver.run(entry.setting)
            if seconds < SHARE:
                seconds, *end = entry.solver.run(entry.setting)
        except Exception as trouble:
            entry.trouble = str(trouble).splitlines()[0]
            continue
        pairs = zip(end, case.reference, case.scales, strict=True)
        entry.errors = tuple(float(np.abs(x - y).max()) / scale for x, y, scale in pairs)
        entry.seconds, entry.repeats = seconds, int(np.clip(SHARE / seconds, 1, 40))
    for round_ in range(40):
        for entry in entries:
            if round_ < entry.repeats:
                entry.seconds = min(entry.seconds, entry.solver.run(entry.setting)[0])


def best(entries, state):
    """Return errors and seconds of the runs that no other beats in both, the coarsest first."""
    points = sorted((e.seconds, e.errors[state]) for e in entries if e.errors)
    front = []
    for seconds, error in points:
        if np.isfinite(error) and error < 1 and (not front or error < front[-1][0]):
            front.append((error, seconds))
    return np.array(front).reshape(-1, 2)


def seconds_at(error, front):
    """Interpolate powers; a code whose fastest run is better than wanted takes that one's time."""
    if not len(front) or error < front[-1, 0]:
        return np.nan
    errors, seconds = np.log(front[::-1].T)
    return float(np.exp(np.interp(np.log(error), errors, seconds)))


def compare(case, entries):
    """Return a row for each state and error: milliseconds of all, and ratios to the peers."""
    families = list(dict.fromkeys(entry.family for entry in entries))
    peers = [family for family in families if family not in OWN]
    for state, name in enumerate("qv"):
        fronts = {f: best([e for e in entries if e.family == f], state) for f in families}
        for error in LEVELS:
            times = {f: 1e3 * seconds_at(error, fronts[f]) for f in families}
            row = {"problem": case.name, "of": name, "error": error, **times}
            for own in OWN:
                row[f"fastest peer / {own}"] = least(times[f] for f in peers) / times[own]
            packages = (times[f] for f in peers if f != "IDA in C")
            row["fastest package / HHT"] = least(packages) / times["HHT"]
            row["Exudyn / HHT"] = times["Exudyn"] / times["HHT"]
            yield row


def least(times):
    """Return the least of the times there are."""
    return min((x for x in times if np.isfinite(x)), default=np.nan)


def draw(results):
    """Draw each code's best runs: a column a problem, a row a state."""
    families = dict.fromkeys(entry.family for _, found in results for entry in found)
    colours = dict(zip(families, ("C3", "C1", "C0", "k", "C7", "C8", "C2", "C4"), strict=True))
    size = 4 * len(results), 7
    figure, axes = plt.subplots(2, len(results), figsize=size, sharey="row", squeeze=False)
    for column, (case, found) in zip(axes.T, results, strict=True):
        for state, axis in enumerate(column):
            for family, colour in colours.items():
                front = best([e for e in found if e.family == family], state)
                dashes = "-" if family in OWN else "--"
                axis.loglog(*front.T, dashes, marker=".", color=colour, label=family)
            axis.set(xlabel=f"relative error of {'qv'[state]}", xlim=(1e-1, 1e-8))
            axis.grid(alpha=0.3)
        column[0].set_title(case.name)
    for axis in axes[:, 0]:
        axis.set_ylabel("seconds")
    axes[0, -1].legend(fontsize=7)
    figure.tight_layout()
    RESULTS.mkdir(exist_ok=True)
    figure.savefig(RESULTS / "work_precision_alpha.png", dpi=120)


def main():
    parser = argparse.ArgumentParser(description="work against precision of the alpha methods")
    parser.add_argument("problems", nargs="*", help="some of the problems, by name")
    wanted = parser.parse_args().problems
    sundials.libraries()
    results, table, setups, runs = [], [], [], []
    for name, make in cases():
        if wanted and name not in wanted:
            continue
        case = make()
        found, took = entries(case)
        measure(case, found)
        results.append((case, found))
        table += compare(case, found)
        setups.append({"problem": name, **{f: round(x, 3) for f, x in took.items()}})
        runs += [row(case, entry) for entry in found]
    draw(results)
    packages = ("scikit-sundae", "scipy_dae", "exudyn", "numba", "scipy")
    publish("work_precision_alpha_runs", runs, packages)
    print("\nSeconds of setting up, all forms together:\n")
    publish("work_precision_alpha_setup", setups, packages)
    print("\nMilliseconds of a run:\n")
    publish("work_precision_alpha", table, packages)


def row(case, entry):
    """Return one run as a row."""
    error_q, error_v = entry.errors or (None, None)
    return {
        "problem": case.name,
        "code": entry.family,
        "variant": entry.variant,
        "setting": entry.setting,
        "ms": 1e3 * entry.seconds if entry.errors else None,
        "error q": error_q,
        "error v": error_v,
        "trouble": entry.trouble,
    }


if __name__ == "__main__":
    main()
