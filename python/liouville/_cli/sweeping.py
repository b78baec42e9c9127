"""A run of ``liouville run --sweep``: an ensemble over a parameter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import liouville as lv
from liouville._basics.errors import hinted
from liouville._basics.progress import bar
from liouville._cli.screen import say
from liouville._systems import Mechanics


def swept(text: str) -> tuple[str, np.ndarray]:
    """Read a parameter and its values, ``l=1,2,3``, or ``l=0.5:2:20``: from, to, how many."""
    name, equals, given = text.partition("=")
    if name.strip() and "," in given:
        try:
            return name.strip(), np.array([float(x) for x in given.split(",")])
        except ValueError:
            pass
    parts = given.split(":")
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        count = 0
    if not (name.strip() and equals and len(parts) == 3 and count > 0):
        sentence = f"--sweep {text!r} has no values of a parameter"
        hint = "write --sweep name=from:to:count, as l=0.5:2:20, or values, as l=1,2,3"
        raise ValueError(hinted(sentence, hint))
    return name.strip(), np.linspace(first, last, count)


def sweep(
    model: str,
    system: Any,
    method: Any,
    values: tuple[str, np.ndarray],
    start: Mapping[str, Any],
    params: Mapping[str, Any] | None,
    unwanted: Mapping[str, Any],
    **options: Any,
) -> lv.Solution:
    """Integrate a member for each value of a parameter, its start moved onto any constraints."""
    for option, value in unwanted.items():
        if value:
            raise ValueError(f"a sweep takes equal steps in memory: it takes no --{option}")
    name, of = values
    if name in (params or {}):
        raise ValueError(f"parameter {name!r} is given twice, by --param and by --sweep")
    default = system.params.get(name, 0.0)
    if np.ndim(default):
        raise ValueError(f"parameter {name!r} is a vector, and a sweep is of numbers")
    given = {**(params or {}), name: of}
    placed: dict[str, Any] = dict(start)
    if isinstance(system, Mechanics | lv.SemiExplicit):
        placed = system.consistent(t=options["t"][0], params=given, **start)
        moved = max(np.abs(placed[x] - np.asarray(start[x], float)).max() for x in start)
        if moved > 1e-9:
            say(f"starts were moved onto their constraints, by {moved:.3g} at most")
    with bar(model, "steps") as report:
        return lv.ensemble(system, method, params=given, progress=report, **options, **placed)
