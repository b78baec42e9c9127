"""Arguments by names that the calls do not have, and what to give instead."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from liouville._basics.errors import hinted

P = ParamSpec("P")
R = TypeVar("R")

#: What an option for single precision is told.
DOUBLE = "states are of double precision, whatever the start is; a sector makes them shorter"

#: The spelling of arguments that are given by another name.
SPELLINGS = {
    "dt": "give h=, the step size",
    "h_min": "give control=lv.Adaptive(h_min=...) or control=lv.Reversible(h_min=...)",
    "monitor": "give control=lv.Reversible(monitor=...)",
    "checkpoint": "give lv.Store(path, checkpoint=...) as the store",
    "c_ops": "collapse operators are not taken: QuTiP's mesolve and mcsolve take open systems",
    "e_ops": "give observe=, operators by name",
    "dtype": DOUBLE,
    "precision": DOUBLE,
    "tol": "the tolerance is the method's: give method=lv.SchrodingerSplitting(tol=...)",
}

#: Arguments of integrate that ensemble does not take, and why.
SINGLE = {
    "rtol": "its members take equal steps: give h or steps",
    "atol": "its members take equal steps: give h or steps",
    "control": "its members take equal steps: give h or steps",
    "store": "solution.save(path) writes what it returns",
}

#: Arguments of integrate that extrapolate does not take, and why.
HALVED = {
    **dict.fromkeys(("rtol", "atol", "control"), "its runs take equal steps: give h or steps"),
    **dict.fromkeys(
        ("events", "t_eval", "tangents", "states", "store"),
        "it combines the ends of steps of runs with h and h/2; lv.integrate makes one run",
    ),
}


def check_options(names: Iterable[str], call: str) -> None:
    """Refuse names that are meant as options of a call; TypeError has their spelling."""
    for name in names:
        hint = SPELLINGS.get(name)
        if call in ("ensemble", "extrapolate"):
            hint = {"ensemble": SINGLE, "extrapolate": HALVED}[call].get(name, hint)
        if hint is not None:
            raise TypeError(hinted(f"{call} takes no {name}=", hint))
        if call == "resume":
            raise TypeError(f"resume takes no {name}=")


def started(start: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return start values that are given by one mapping, by keywords, or by both."""
    if start is None:
        return dict(values)
    if not isinstance(start, Mapping):
        hint = "write start={'q': ..., 'v': ...}, or q=..., v=..."
        raise TypeError(hinted(f"start must be a mapping of names to values, not {start!r}", hint))
    for name in start:
        if name in values:
            raise TypeError(f"start value '{name}' is given twice: by start= and by {name}=")
    return {**start, **values}


def by_name(call: Callable[P, R]) -> Callable[P, R]:
    """Let a call of system and method refuse what else is given by its place."""

    @wraps(call)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        if len(args) > 2:
            given = ", ".join(map(repr, args[2:]))
            sentence = f"{call.__name__} takes system and method by their places, not {given}"
            raise TypeError(hinted(sentence, f"write t={args[2]!r}"))
        return call(*args, **kwargs)

    return checked
