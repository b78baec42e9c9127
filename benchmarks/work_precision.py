"""Work against precision: SPARK beside SUNDIALS, scipy_dae, Exudyn, heyoka and diffrax.

Planar pendulum, car axis, Andrews' mechanism, heavy top and a chain of ten. Errors are those of the
positions at the end, relative to the largest, against the problems' references in quadruple
precision; times are minima of repeats, all codes in turn in one process on one thread. Every code
has several settings and forms, and its fastest run that reaches an error counts, in between by
powers:

Spark, LobattoPair   equal steps; stages and step by the error wanted; solver "auto"
Spark to tolerance   the same with newton_tol: stage equations solved to what the error wants
IDA                  index 1, index 2, stabilised index 2 and its integral form, Jacobian in C; as a
                     library called from C, and through scikit-sundae with a compiled residual
CasADi IDAS          index 1 and stabilised index 2, compiled
scipy_dae            Radau of 3 and 7 stages and BDF, compiled residual and Jacobians
Exudyn               generalised alpha on its own bodies and joints, modified Newton
heyoka, diffrax      the index-reduced ordinary equation, with no constraint any more: Taylor, and
                     Dopri8; the top as the library has it, and by Euler's equations

Setting up (symbols, tapes, compilers) is not part of the times and has a table of its own. A code
that cannot be imported is left out, with a line that says so. Run as
``python benchmarks/work_precision.py``, after ``pip install --group bench`` and with a C
compiler: about ten minutes, most of them heyoka's compiler. ``--short`` takes fewer settings, and
heyoka's compact mode; ``--only Spark heyoka`` some of the codes. ``benchmarks/figure.py`` draws the
figure.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")

import argparse
import time
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from diagram import Own, Setup, best, first_line, front, least, measure, published, seconds_at
from peers import implicit, reduced
from report import publish, show

import liouville as lv

LEVELS = (1e-3, 1e-6, 1e-9, 1e-12)
STAGES_AT = 1e-6  # the error that the best number of stages is shown for
DRIFT_AT = 1e-9  # the tolerance that the constraints of heyoka are shown for
COUNTS = {  # numbers of steps of SPARK, the fewest and the most, and of Exudyn
    "pendulum": ((28, 320), (100, 50_000)),
    "car_axis": ((30, 340), None),
    "andrews": ((20, 240), (100, 10_000)),
    "heavy_top": ((70, 800), (3_000, 100_000)),
    "chain": ((1, 32), (10, 10_000)),
}
STAGES = range(2, 9)
LOOSE = "Spark to tolerance"
OWN = ("Spark", LOOSE, "LobattoPair")
DAE = (
    "IDA in C",
    "IDA, scikit-sundae",
    "CasADi IDAS",
    "scipy_dae",
    "Exudyn",
)  # no package, then four
ODE = ("heyoka", "diffrax")
PACKAGES = ("scikit-sundae", "scipy_dae", "exudyn", "heyoka", "diffrax", "jax", "numba", "scipy")


@dataclass(frozen=True)
class Effort:
    """How many settings, and how many seconds of repeats and of a run."""

    tolerances: tuple
    newton: tuple
    taylor: tuple
    per_octave: int
    share: float
    longest: float
    is_short: bool


FULL = Effort(
    tuple(10.0**-k for k in range(2, 14)),
    (1e-5, 1e-8, 1e-11),
    (1e-4, 1e-9, 1e-14),
    3,
    0.2,
    2.0,
    False,
)
SHORT = Effort(
    tuple(10.0**-k for k in range(3, 14, 2)), (1e-8, 1e-11), (1e-6, 1e-14), 2, 0.1, 0.5, True
)


def peer(name):
    """Import one of the modules of peers; says what is missing and returns None if it cannot."""
    try:
        return import_module(f"peers.{name}")
    except ImportError as trouble:
        print(f"{name} is left out: {first_line(trouble)}")
        return None


def ladder(ends, per_octave):
    """Return whole numbers between two, so many for each doubling."""
    count = round(np.log2(ends[1] / ends[0]) * per_octave)
    return tuple(dict.fromkeys(int(x) for x in np.geomspace(*ends, count + 1).round()))


def entries(case, effort, peers, only):
    """Set up every code on a case whose name begins with one of these."""
    setup = Setup(case, only)
    begin = time.perf_counter()
    _ = case.system
    setup.spend("liouville", time.perf_counter() - begin)
    counts = ladder(COUNTS[case.name][0], effort.per_octave)
    for s in STAGES:
        setup.add("Spark", f"s = {s}", counts, Own, lv.Spark(s), case, False)
        for tol in effort.newton:
            method = lv.Spark(s, newton_tol=tol)
            setup.add(LOOSE, f"s = {s}, newton_tol = {tol:g}", counts, Own, method, case, False)
    for s in STAGES[1::2]:
        setup.add("LobattoPair", f"s = {s}", counts, Own, lv.LobattoPair(s), case, False)
    add_implicit(setup, effort, peers)
    if peers["mechanisms"] and COUNTS[case.name][1]:
        models = peers["mechanisms"]
        steps = ladder(COUNTS[case.name][1], 1)
        for name in ("euler_parameters", "lie_group") if case.name == "heavy_top" else (case.name,):
            given = getattr(models, name), case.system, case.start, case.span
            setup.add("Exudyn", name, steps, models.Exudyn, *given)
    for form in ("euler", "reduced") if case.name == "heavy_top" else ("reduced",):
        equation = getattr(reduced, form)(case.system, case.start)
        if peers["taylor"]:
            given = equation, case.span, effort.taylor, effort.is_short
            setup.add("heyoka", form, effort.taylor, peers["taylor"].Heyoka, *given)
        if peers["compiled"]:
            given = equation, case.span, case.scales
            setup.add("diffrax", form, effort.tolerances, peers["compiled"].Diffrax, *given)
    return setup


def add_implicit(setup, effort, peers):
    """Set up the codes that take the equations as they are; their C needs SUNDIALS' own."""
    case, sundials, general = setup.case, peers["sundials"], peers["general"]
    if not sundials:
        return
    sundials.libraries()
    place = case.span, case.scales
    for form in implicit.FORMS:
        begin = time.perf_counter()
        equation = implicit.implicit(case.system, form, case.start, case.span[0])
        _ = equation.library
        compiling = time.perf_counter() - begin
        for family, make in (
            ("IDA in C", sundials.InC),
            ("IDA, scikit-sundae", sundials.ScikitSundae),
        ):
            setup.spend(family, compiling)
            setup.add(family, form, effort.tolerances, make, equation, *place)
        if general and form in general.FORMS[effort.is_short :]:
            setup.spend("scipy_dae", compiling)
            for method, stages in (("Radau", 3), ("Radau", 7), ("BDF", None)):
                variant = f"{method} {stages or ''}, {form}"
                few = effort.tolerances[effort.is_short :: 2]
                given = equation, *place, method, stages
                setup.add("scipy_dae", variant, few, general.ScipyDae, *given)
    for form in general.FORMS if general else ():
        few = effort.tolerances[:: 1 if effort.is_short else 2]
        given = case.system, form, case.start, *place, few
        setup.add("CasADi IDAS", form, few, general.Idas, *given)


def times(case, entries):
    """Return milliseconds of every family at every error."""
    families = list(dict.fromkeys(entry.family for entry in entries))
    for error in LEVELS:
        found = {
            family: 1e3 * seconds_at(error, best([e for e in entries if e.family == family]))
            for family in families
        }
        yield {"problem": case.name, "error": error, **found}


def ratio(row):
    """Return a row of how many times as long as Spark the others take."""
    codes = [key for key in row if key not in ("problem", "error", "Spark")]
    own, loose = row["Spark"], row[LOOSE]
    code = least(row[key] for key in DAE if key in row)
    package = least(row[key] for key in DAE[1:] if key in row)
    return {
        "problem": row["problem"],
        "error": row["error"],
        "DAE code / to tolerance": code / loose,
        "DAE package / to tolerance": package / loose,
        "DAE code": code / own,
        "DAE package": package / own,
        **{key: row[key] / own for key in codes},
    }


def by_stages(case, entries):
    """Return what Spark takes at every error: the fastest of all, and each number of stages."""
    own = [entry for entry in entries if entry.family == "Spark"]
    for error in LEVELS:
        found = {}
        for s in STAGES:
            points = best([entry for entry in own if entry.variant == f"s = {s}"])
            found[f"s = {s}"] = 1e3 * seconds_at(error, points)
        there = [entry for entry in front(own) if entry.errors[0] <= error]
        if not there:
            continue
        run, span = there[0], case.span[1] - case.span[0]
        stats = lv.integrate(
            case.system, run.solver.method, t=case.span, steps=run.setting, **case.start
        ).stats
        yield {
            "problem": case.name,
            "error": error,
            "best": run.variant,
            "h": span / run.setting,
            "steps": run.setting,
            "corrections a step": stats["iterations"] / run.setting,
            "us a step": 1e6 * run.seconds / run.setting,
            **found,
        }


def taylor(case, entries):
    """Return build time and constraint drift of heyoka's runs."""
    for entry in entries:
        if entry.family == "heyoka" and entry.errors:
            yield {
                "problem": case.name,
                "form": entry.variant,
                "tolerance": entry.setting,
                "ms": 1e3 * entry.seconds,
                "error": entry.errors[0],
                "constraints off by": entry.solver.drift[entry.setting],
                "s to build": entry.solver.building[entry.setting],
            }


def call(case):
    """Return milliseconds that calling `integrate` takes beside its run: checks and arrays."""
    found = []
    for _ in range(20):
        begin = time.perf_counter()
        run = lv.integrate(
            case.system, lv.Spark(3), t=case.span, steps=500, every=500, **case.start
        )
        found.append(time.perf_counter() - begin - run.stats["seconds"])
    return 1e3 * min(found)


def row(case, entry):
    """Return one run as a row."""
    return {
        "problem": case.name,
        "code": entry.family,
        "variant": entry.variant,
        "setting": entry.setting,
        "ms": 1e3 * entry.seconds if entry.errors else None,
        "error": entry.errors[0] if entry.errors else None,
        "trouble": entry.trouble,
    }


def main():
    parser = argparse.ArgumentParser(description="work against precision of mechanical methods")
    parser.add_argument("problems", nargs="*", help="some of the problems, by name")
    parser.add_argument("--short", action="store_true", help="fewer settings and repeats")
    parser.add_argument("--only", nargs="*", default=[""], help="codes that begin so")
    asked = parser.parse_args()
    effort = SHORT if asked.short else FULL
    peers = {
        name: peer(name) for name in ("sundials", "general", "mechanisms", "taylor", "compiled")
    }
    tables = {name: [] for name in ("", "_stages", "_taylor", "_setup", "_runs")}
    for name in asked.problems or COUNTS:
        print(f"{name} ...", flush=True)
        case = published(name)
        setup = entries(case, effort, peers, asked.only)
        measure(case, setup.entries, effort.share, effort.longest)
        tables[""] += times(case, setup.entries)
        tables["_stages"] += by_stages(case, setup.entries)
        tables["_taylor"] += taylor(case, setup.entries)
        took = {key: round(x, 3) for key, x in setup.took.items() if key not in OWN}
        tables["_setup"].append({"problem": name, "ms a call": call(case), **took})
        tables["_runs"] += (row(case, entry) for entry in setup.entries)
    tables["_ratios"] = [ratio(found) for found in tables[""]]
    for name in ("_runs", "_setup", "_stages", "_ratios"):
        if tables[name]:
            print(f"\nwork_precision{name}\n")
            show(tables[name])
    print()
    publish("work_precision", tables[""], PACKAGES)
    if tables["_taylor"]:
        print()
        fine = [found for found in tables["_taylor"] if found["tolerance"] == DRIFT_AT]
        publish("work_precision_taylor", fine, ("heyoka",))
    stages = [found for found in tables["_stages"] if found["error"] == STAGES_AT]
    if stages:
        print()
        columns = ("problem", "error", "best", "h", "steps", "corrections a step")
        publish("work_precision_stages", stages, columns=columns)


if __name__ == "__main__":
    main()
