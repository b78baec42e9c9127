"""Arguments by names that the calls do not have, and what to give instead."""

from __future__ import annotations

from collections.abc import Iterable

from liouville.errors import hinted

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


def check_options(names: Iterable[str], call: str) -> None:
    """Refuse names that are meant as options of a call; TypeError has their spelling."""
    for name in names:
        hint = SPELLINGS.get(name)
        if call == "ensemble":
            hint = SINGLE.get(name, hint)
        if hint is not None:
            raise TypeError(hinted(f"{call} takes no {name}=", hint))
        if call == "resume":
            raise TypeError(f"resume takes no {name}=")
