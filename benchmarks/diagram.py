"""The work-precision diagram: codes with settings, timed in turn, and read at equal errors."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

import liouville as lv
from liouville import problems

SHARE = 0.3  # seconds of repeats a run may take, 40 at most
LONGEST = 2.0  # seconds of a run after which tighter settings are left out


@dataclass
class Case:
    """A problem with its end state."""

    name: str
    build: Callable
    start: dict
    span: tuple
    reference: tuple

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
    notes: dict = field(default_factory=dict)


@dataclass(eq=False)
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


def published(name):
    """Return one of the library's problems with its reference, without invariants."""
    problem = problems.load(name)
    end = problem.reference[problem.interval[1]]
    reference = tuple(np.array(end[state]) for state in "qv")

    def build():
        names, params = problem.system.coordinates, problem.system.params
        return lv.Lagrangian(problem.lagrangian, problem.constraint, q=names, params=params)

    if name == "chain":
        build = partial(problem.build, 10)
    return Case(name, build, problem.start, problem.interval, reference)


class Setup:
    """Entries in the making, and the seconds that setting up each family took."""

    def __init__(self, case, only=("",)):
        self.case, self.only, self.entries, self.took = case, tuple(only), [], {}

    def add(self, family, variant, settings, make, *args):
        """Make a solver and enter it with each setting, the loosest first; or say why not."""
        if not family.startswith(self.only):
            return
        begin = time.perf_counter()
        try:
            solver = make(*args)
        except Exception as trouble:
            print(f"{self.case.name}: {family}, {variant} is left out: {first_line(trouble)}")
            return
        self.spend(family, time.perf_counter() - begin)
        self.entries += [Entry(family, variant, setting, solver) for setting in settings]

    def spend(self, family, seconds):
        """Count seconds of setting up."""
        self.took[family] = self.took.get(family, 0.0) + seconds


def first_line(trouble):
    """Return what an exception says, in a line."""
    return (str(trouble) or type(trouble).__name__).splitlines()[0]


def measure(case, entries, share=SHARE, longest=LONGEST):
    """Run each code for warmth, all settings for errors, then all in turn for their share."""
    warm, over = set(), set()
    for entry in entries:
        variant = entry.family, entry.variant
        if variant in over:
            entry.trouble = "a looser setting took too long"
            continue
        try:
            if entry.solver not in warm:
                warm.add(entry.solver)
                entry.solver.run(entry.setting)
            seconds, *end = entry.solver.run(entry.setting)
        except Exception as trouble:
            entry.trouble = first_line(trouble)
            continue
        if seconds > longest:
            over.add(variant)
        pairs = zip(end, case.reference, case.scales, strict=True)
        entry.errors = tuple(float(np.abs(x - y).max()) / scale for x, y, scale in pairs)
        entry.seconds, entry.repeats = seconds, int(min(share / seconds, 40))
    for round_ in range(40):
        for entry in entries:
            if round_ < entry.repeats:
                entry.seconds = min(entry.seconds, entry.solver.run(entry.setting)[0])


def front(entries, state=0):
    """Return the entries that no other beats in both time and error, the coarsest first."""
    kept = []
    for entry in sorted((e for e in entries if e.errors), key=lambda e: e.seconds):
        error = entry.errors[state]
        if np.isfinite(error) and error < 1 and (not kept or error < kept[-1].errors[state]):
            kept.append(entry)
    return kept


def best(entries, state=0):
    """Return errors and seconds of the front."""
    return np.array([(e.errors[state], e.seconds) for e in front(entries, state)]).reshape(-1, 2)


def seconds_at(error, points):
    """Interpolate powers; a code whose fastest run is better than wanted takes that one's time."""
    if not len(points) or error < points[-1, 0]:
        return np.nan
    errors, seconds = np.log(points[::-1].T)
    return float(np.exp(np.interp(np.log(error), errors, seconds)))


def least(times):
    """Return the least of the times there are."""
    return min((x for x in times if np.isfinite(x)), default=np.nan)
