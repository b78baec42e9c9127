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

import argparse  # noqa: E402
import time  # noqa: E402
from dataclasses import dataclass, field  # noqa: E402

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from peers import general, implicit, mechanisms, sundials  # noqa: E402
from report import RESULTS, publish  # noqa: E402

import liouville as lv  # noqa: E402
from liouville import problems  # noqa: E402

TOLERANCES = tuple(10.0**-k for k in range(2, 9))
LEVELS = (1e-3, 1e-4, 1e-5, 1e-6)
SHARE = 0.3  # seconds of repeats a run may take, within 3 and 40 repeats
OWN = ("HHT", "generalised alpha", "Spark(3)")


@dataclass
class Case:
    """A problem with its end state, and the numbers of steps that equal steps are tried with."""

    name: str
    system: lv.Lagrangian
    start: dict
    span: tuple
    reference: tuple
    build: object
    steps: tuple
    spark: tuple
    rotations: bool = True

    @property
    def scales(self):
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
    last: dict = field(default_factory=dict)

    def run(self, setting):
        if self.control:
            pace = {"rtol": setting, "atol": setting * self.case.scales[0]}
        else:
            pace = {"steps": setting}
        found = lv.integrate(
            self.case.system, self.method, t=self.case.span, every=10**9, **pace, **self.case.start
        )
        self.last[setting] = found.stats
        return found.stats["seconds"], found.q[-1], found.v[-1]


def case(name, steps, spark):
    problem = problems.load(name)
    end = problem.reference[problem.interval[1]]
    reference = tuple(np.array(end[state]) for state in "qv")
    build = getattr(mechanisms, name)
    return Case(
        name, problem.system, problem.start, problem.interval, reference, build, steps, spark
    )


def long_chain(links):
    """Return a chain without a published end state; its own is that of Spark(5)."""
    chain = problems.load("chain")
    system, start = chain.build(links), chain.start_for(links)
    ends = []
    for count in (20 * links, 40 * links):
        found = lv.integrate(system, lv.Spark(5), t=chain.interval, steps=count, **start)
        ends.append((found.q[-1], found.v[-1]))
    if max(np.abs(a - b).max() for a, b in zip(*ends, strict=True)) > 1e-10:
        raise AssertionError("the chain's end state is not settled")
    steps = tuple(links * k for k in (4, 8, 16, 32, 64, 128, 256, 512))
    spark = tuple(links * k // 4 for k in (2, 3, 4, 6, 8, 16))
    return Case(
        f"chain of {links}", system, start, chain.interval, ends[1], mechanisms.chain, steps, spark
    )


def cases():
    crank = tuple(int(100 * 2 ** (k / 2)) for k in range(16))
    return (
        case("slider_crank", crank, (20, 30, 40, 60, 80, 120, 160)),
        case("andrews", crank, (45, 50, 60, 75, 90, 110, 150)),
        case("chain", tuple(int(10 * 2 ** (k / 2)) for k in range(16)), (3, 4, 6, 8, 10, 15, 20)),
        long_chain(40),
    )


def entries(case):
    """Set up every code on a case; returns its runs and the seconds that setting up took."""
    found, took = [], {}

    def add(family, variant, settings, make):
        begin = time.perf_counter()
        try:
            solver = make()
        except Exception as trouble:
            print(f"{case.name}: {family} {variant} is left out: {trouble}")
            return
        took.setdefault(family, []).append(time.perf_counter() - begin)
        found.extend(Entry(family, variant, setting, solver) for setting in settings)

    own = (("HHT", lv.HHT(-0.1)), ("generalised alpha", lv.GeneralizedAlpha(0.9)))
    for family, method in own:
        add(family, "controlled", (*TOLERANCES, 1e-10, 1e-11), lambda: Own(method, case, True))
        add(family, "equal steps", case.steps, lambda: Own(method, case, False))
    add("Spark(3)", "equal steps", case.spark, lambda: Own(lv.Spark(3), case, False))
    sparse = len(case.start["q"]) > 20
    for form in implicit.FORMS:
        begin = time.perf_counter()
        equation = implicit.implicit(case.system, form, case.start, case.span[0])
        _ = equation.library
        compiling = time.perf_counter() - begin
        place = case.span, case.scales
        add("IDA in C", form, TOLERANCES, lambda: sundials.InC(equation, *place, sparse))
        add(
            "IDA, scikit-sundae",
            form,
            TOLERANCES,
            lambda: sundials.ScikitSundae(equation, *place, sparse),
        )
        for method in ("Radau", "BDF") if form != "index2" else ():
            add(
                "scipy_dae",
                f"{method}, {form}",
                TOLERANCES[1:6],
                lambda: general.ScipyDae(equation, *place, method),
            )
        for family in ("IDA in C", "IDA, scikit-sundae", "scipy_dae"):
            took[family][-1] += compiling
    for form in general.FORMS:
        add(
            "CasADi IDAS",
            form,
            TOLERANCES,
            lambda: general.Idas(case.system, form, case.start, case.span, case.scales),
        )
    add(
        "Exudyn",
        "equal steps",
        case.steps,
        lambda: mechanisms.Exudyn(case.build, case.system, case.start, case.span),
    )
    return found, {family: sum(parts) for family, parts in took.items()}


def measure(case, entries):
    """Run all once for warmth and errors, then in turn until each has had its share."""
    for entry in entries:
        try:
            entry.solver.run(entry.setting)
            seconds, *end = entry.solver.run(entry.setting)
        except Exception as trouble:
            entry.trouble = str(trouble).splitlines()[0]
            continue
        pairs = zip(end, case.reference, case.scales, strict=True)
        entry.errors = tuple(float(np.abs(x - y).max()) / scale for x, y, scale in pairs)
        entry.seconds, entry.repeats = seconds, int(np.clip(SHARE / seconds, 3, 40))
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
    for state, name in enumerate(("q", "v")):
        fronts = {f: best([e for e in entries if e.family == f], state) for f in families}
        for error in LEVELS:
            times = {f: 1e3 * seconds_at(error, fronts[f]) for f in families}
            peers = [times[f] for f in families if f not in OWN]
            row = {"problem": case.name, "of": name, "error": error, **times}
            for own in OWN[:2]:
                row[f"fastest peer / {own}"] = np.nanmin(peers) / times[own]
            packages = [times[f] for f in families if f not in (*OWN, "IDA in C")]
            row["fastest package / HHT"] = np.nanmin(packages) / times["HHT"]
            yield {k: round(x, 3) if isinstance(x, float) and k != "error" else x for k, x in row.items()}


def draw(results):
    colours = dict(zip(dict.fromkeys(e.family for _, es in results for e in es), "C3 C1 C0 k C7 C8 C2 C4".split(), strict=False))
    figure, axes = plt.subplots(2, len(results), figsize=(4 * len(results), 7), sharey="row", squeeze=False)
    for column, (case, found) in zip(axes.T, results, strict=True):
        for state, axis in enumerate(column):
            for family, colour in colours.items():
                front = best([e for e in found if e.family == family], state)
                if len(front):
                    dashes = "-" if family in OWN else "--"
                    axis.loglog(*front.T, dashes, marker=".", color=colour, label=family)
            axis.set(xlabel=f"relative error of {'qv'[state]}", xlim=(1e-8, 1e-1))
            axis.invert_xaxis()
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
    results, table, runs = [], [], []
    for case in cases():
        if wanted and case.name not in wanted:
            continue
        found, took = entries(case)
        measure(case, found)
        results.append((case, found))
        table += compare(case, found)
        print(case.name, "set up in seconds:", {k: round(x, 2) for k, x in took.items()})
        runs += [
            {
                "problem": case.name,
                "code": e.family,
                "variant": e.variant,
                "setting": e.setting,
                "ms": round(1e3 * e.seconds, 4) if e.errors else None,
                "error q": e.errors[0] if e.errors else None,
                "error v": e.errors[1] if e.errors else None,
                "trouble": e.trouble,
            }
            for e in found
        ]
    draw(results)
    publish("work_precision_alpha_runs", runs)
    print()
    publish("work_precision_alpha", table)


if __name__ == "__main__":
    main()
