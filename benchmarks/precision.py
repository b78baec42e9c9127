"""Codes at several settings, timed in turn, and the time each takes for an error.

A code is anything with ``run(setting) -> (seconds, state)``. All runs of a race are taken in turn,
round after round, so that a slow minute of the machine falls on all of them; the least time counts.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass
class Entry:
    """A code at one setting, and what it took and reached."""

    code: str
    solver: Any
    setting: float
    seconds: float = np.inf
    errors: dict[str, float] | None = None
    trouble: str = ""

    def row(self):
        """Return the run as a row of a table."""
        errors = self.errors or {}
        return {
            "code": self.code,
            "setting": self.setting,
            "seconds": self.seconds if errors else None,
            **errors,
            "trouble": self.trouble,
        }


def race(entries, errors, rounds=5, longest=6.0):
    """Run each entry once for warmth and its errors, then all in turn.

    An entry that fails has its trouble written down; one that would take longer than ``longest``
    seconds over all rounds is run fewer times, but at least once.
    """
    for entry in entries:
        try:
            seconds, state = entry.solver.run(entry.setting)
        except (ArithmeticError, RuntimeError) as trouble:
            entry.trouble = str(trouble).splitlines()[0]
            continue
        entry.errors, entry.seconds = errors(state), seconds
    for turn in range(rounds):
        for entry in entries:
            if entry.errors and turn <= longest / entry.seconds:
                entry.seconds = min(entry.seconds, entry.solver.run(entry.setting)[0])


def front(entries, measure):
    """Return errors and seconds of the runs that no other beats in both, the coarsest first."""
    points = sorted((e.seconds, e.errors[measure]) for e in entries if e.errors)
    best = []
    for seconds, error in points:
        if np.isfinite(error) and (not best or error < best[-1][0]):
            best.append((error, seconds))
    return np.array(best).reshape(-1, 2)


def seconds_at(error, points):
    """Interpolate powers; a code whose fastest run is better than wanted takes that one's time."""
    if not len(points) or error < points[-1, 0]:
        return np.nan
    errors, seconds = np.log(points[::-1].T)
    return float(np.exp(np.interp(np.log(error), errors, seconds)))


def times_at(entries, measure, error):
    """Return the seconds of every code at an error, by name, in the order of the race."""
    codes = dict.fromkeys(entry.code for entry in entries)
    return {
        code: seconds_at(error, front([e for e in entries if e.code == code], measure))
        for code in codes
    }
