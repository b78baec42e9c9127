"""Work against precision: the alpha methods beside four other codes on three mechanisms.

Errors are those at the end against the problems' references, relative to the largest component, in
positions and in velocities; times are minima of repeats, all codes taken in turn in one process on
one thread. Each code runs in every form of the equations it takes (``peers``), and its fastest run
that reaches an error counts, in between by powers. Setting up is not part of the time: symbols,
tapes, C compilers, Exudyn's assembly. IDA appears twice: through scikit-sundae, which calls into
Python at every residual, and as the same library driven from C alone.

Run as ``python benchmarks/work_precision_alpha.py``, after ``pip install --group bench`` and
with a C compiler; takes some minutes. Draws build/measured/work_precision_alpha.png.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from diagram import Case, Own, Setup, best, least, measure, published, seconds_at
from peers import general, implicit, mechanisms, sundials
from report import FOLDER, publish, show

import liouville as lv
from liouville import problems

TOLERANCES = tuple(10.0**-k for k in range(2, 11))
LEVELS = (1e-3, 1e-4, 1e-5, 1e-6)
OWN = ("HHT", "generalised alpha", "Spark(3)")


@dataclass
class Mechanism(Case):
    """A case that Exudyn knows, and the numbers of steps that equal steps are tried with."""

    mechanism: Callable
    steps: tuple
    spark: tuple


def case(name, steps, spark):
    """Return one of the library's problems that have a mechanism and a reference."""
    return Mechanism(
        **vars(published(name)), mechanism=getattr(mechanisms, name), steps=steps, spark=spark
    )


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
    return Mechanism(name, build, start, chain.interval, ends[1], mechanisms.chain, steps, spark)


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
    setup = Setup(case)
    begin = time.perf_counter()
    _ = case.system
    setup.spend("Spark(3)", time.perf_counter() - begin)
    _ = case.system.second_order
    for family, method in (("HHT", lv.HHT(-0.1)), ("generalised alpha", lv.GeneralizedAlpha(0.9))):
        setup.spend(family, time.perf_counter() - begin)
        setup.add(family, "controlled", TOLERANCES, Own, method, case, True)
        setup.add(family, "equal steps", case.steps, Own, method, case, False)
    setup.add("Spark(3)", "equal steps", case.spark, Own, lv.Spark(3), case, False)
    place, sparse = (case.span, case.scales), len(case.start["q"]) > 20
    for form in implicit.FORMS:
        begin = time.perf_counter()
        equation = implicit.implicit(case.system, form, case.start, case.span[0])
        _ = equation.library
        compiling = time.perf_counter() - begin
        setup.add("IDA in C", form, TOLERANCES, sundials.InC, equation, *place, sparse)
        package = sundials.ScikitSundae
        setup.add("IDA, scikit-sundae", form, TOLERANCES, package, equation, *place, sparse)
        for method in ("Radau", "BDF") if form != "index2" else ():
            variant, few = f"{method}, {form}", TOLERANCES[1:6]
            setup.add("scipy_dae", variant, few, general.ScipyDae, equation, *place, method)
        for family in ("IDA in C", "IDA, scikit-sundae", "scipy_dae"):
            setup.spend(family, compiling)
    for form in general.FORMS:
        given = case.system, form, case.start, *place, TOLERANCES
        setup.add("CasADi IDAS", form, TOLERANCES, general.Idas, *given)
    for solver in ("dense", "sparse") if sparse else ("dense",):
        given = case.mechanism, case.system, case.start, case.span, solver
        setup.add("Exudyn", f"equal steps, {solver}", case.steps, mechanisms.Exudyn, *given)
    return setup.entries, setup.took


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
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "work_precision_alpha.png", dpi=120)


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
    show(runs)
    print("\nSeconds of setting up, all forms together:\n")
    show(setups)
    print("\nMilliseconds of a run:\n")
    show(table)
    print()
    columns = ("problem", "error", *OWN, "IDA in C", "IDA, scikit-sundae", "CasADi IDAS")
    columns += ("scipy_dae", "Exudyn")
    positions = [x for x in table if x["of"] == "q" and x["error"] in (LEVELS[0], LEVELS[-1])]
    publish("work_precision_alpha", positions, packages, columns)


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
