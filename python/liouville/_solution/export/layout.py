"""Solutions as named arrays with the names of their axes: what files hold."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._solution.contacts import COLUMNS
from liouville._solution.export.touching import changes_of, columns_of
from liouville._solution.points import STATES
from liouville._solution.solution import Array, Solution
from liouville._systems import Field, Mechanics
from liouville._systems.events import AFTER

# The attribute that marks liouville's files, and the version of their layout.
MARK, VERSION = "liouville_solution", 3

# What a file has beside states and what is called by names, with the axes after time and member.
TABLES = {
    "invariants": ("invariant",),
    "residuals": ("residual", "constraint"),
    "angles": ("angle",),
    "balance": ("term",),
    "reactions": ("coordinate",),
    **dict.fromkeys((f"contact_{what}" for what in COLUMNS), ("contact",)),
}

# The axis of a state, where it is not "coordinate".
AXES = {"lam": "constraint", "psi": "place"}

# Neither NetCDF nor Zarr takes a slash in a variable's name; this one only looks like it.
SLASH = "\u2215"

#: A variable: the names of its axes, its values, its attributes.
Variable = tuple[tuple[str, ...], Array, dict[str, str]]


@dataclass(frozen=True)
class Layout:
    """A solution as a dataset of named arrays.

    Attributes
    ----------
    variables : dict of str to (tuple of str, ndarray, dict)
        For each the names of its axes, its values and its attributes.
    labels : dict of str to ndarray or list
        What is along an axis: times, or names.
    attributes : dict
        How the run went, as numbers and text.
    """

    variables: dict[str, Variable]
    labels: dict[str, Any]
    attributes: dict[str, Any]


def laid_out(solution: Solution) -> Layout:
    """Return a solution as named arrays; nothing is copied."""
    names, failures = solution.names, solution.failures
    axes = Axes(solution.members is not None, "unknowns" in names)
    variables = {
        name: (axes.fitting(name, own, values.ndim), values, own)
        for name, values, own in _arrays(solution)
    }
    labels = {
        "coordinate": names["coordinates"],
        "constraint": names["constraints"],
        **({"unknown": names["unknowns"]} if "unknowns" in names else {}),
        "invariant": solution.invariants,
        "residual": solution.residuals,
        "angle": solution.angles,
        "term": solution.balance,
        **({"contact": solution.contacts} if solution.contacts else {}),
    }
    attributes = {
        MARK: VERSION,
        "status": solution.status,
        "message": solution.message,
        "method": solution.method,
        "h": solution.h,
        "dense_order": 0 if solution.stretches else solution.dense_order,
        "initial": json.dumps(solution.initial, default=_plain),
        "members": -1 if solution.members is None else solution.members,
        "failures": json.dumps({k: [x.step, x.t, x.message] for k, x in failures.items()}),
        "endings": json.dumps(solution.endings),
        "varied": json.dumps(solution.varied),
        "changing": json.dumps(solution.changing),
        "units": json.dumps(solution.units),
        "tolerances": json.dumps(solution.tolerances, default=_plain),
        # Zarr forgets the order of variables, and that one was there.
        "order": json.dumps([*variables, "time", *labels]),
        "stats": json.dumps(solution.stats, default=_plain),
        "params": json.dumps(solution.params, default=_plain),
    }
    named = {dim: list(values) for dim, values in labels.items()}
    return Layout(variables, {"time": solution.t, **named}, attributes)


def _arrays(solution: Solution) -> list[tuple[str, Array, dict[str, str]]]:
    """Return all arrays of a solution by their names in files, with their attributes."""
    found: list[tuple[str, Array, dict[str, str]]] = []
    for name, values in solution.states.items():
        found.append((name, values, unit_attribute(solution, name)))
    for name, (values, said) in positions(solution).items():
        found.append((name, values, said))
    if solution.invariants:
        columns = np.stack(list(solution.invariants.values()), axis=-1)
        found.append(("invariants", columns, {}))
    if solution.residuals:
        known = solution.names["constraints"]
        shape = next(iter(solution.residuals.values())).shape[:-1]
        rows = np.full((*shape, len(solution.residuals), len(known)), np.nan)
        for place, (name, values) in enumerate(solution.residuals.items()):
            rows[..., place, place_of(name, values, known)] = values
        found.append(("residuals", rows, {}))
    for name, each in (("angles", solution.angles), ("balance", solution.balance)):
        if each:
            found.append((name, np.stack(list(each.values()), axis=-1), {}))
    forces = reactions(solution)
    if forces is not None:
        found.append(("reactions", forces, unit_attribute(solution, "reaction")))
    for name, values in solution.observed.items():
        own = {"name": name} | unit_attribute(solution, name)
        found.append(labelled("observed", values, own))
    for name, points in solution.events.items():
        own = {"name": name} | unit_attribute(solution, "t")
        found.append(labelled("event", points.t, own))
        for state, values in points.states.items():
            own = {"name": name, "state": state}
            own |= unit_attribute(solution, state.removesuffix(AFTER))
            found.append(labelled("event", values, own))
    found += [*columns_of(solution.contacts), *changes_of(solution.contacts)]
    for name, tangent in solution.tangents.items():
        for state, values in tangent.states.items():
            found.append(labelled("tangent", values, {"name": name, "state": state}))
        for event, points in tangent.events.items():
            own = {"name": name, "event": event}
            found.append(labelled("tangent", points.t, own))
            for state, values in points.states.items():
                found.append(labelled("tangent", values, own | {"state": state}))
    return found


def unit_attribute(solution: Solution, name: str) -> dict[str, str]:
    """Return the attribute of a quantity that has one unit, empty where it has none."""
    unit = solution.units.get(name, "")
    has_others = any(
        key.partition("[")[0] == name and own != unit for key, own in solution.units.items()
    )
    return {"units": unit} if unit and not has_others else {}


def time_attributes(solution: Solution) -> dict[str, str]:
    """Return the attributes of the time: the date that it is counted from, or else its unit."""
    dates = solution.system.dates if isinstance(solution.system, Field) else None
    return (dates.attributes if dates else {}) or unit_attribute(solution, "t")


def positions(solution: Solution) -> dict[str, tuple[Array, dict[str, str]]]:
    """Return points by coordinates that the states of a field do not have, with attributes."""
    if not isinstance(solution.system, Field) or "x" not in solution.states:
        return {}
    return solution.system.positions(solution.states["x"])


def labelled(family: str, values: Array, own: dict[str, str]) -> tuple[str, Array, dict[str, str]]:
    """Return a variable that is called by what it is of."""
    return label_of(family, own), values, own


def label_of(family: str, own: Mapping[str, str]) -> str:
    """Call a variable by its family, and by the names and the state that it is of."""
    words = ["event"] * (family == "tangent" and "event" in own)
    words += [own.get("state", "t")] * (family != "observed")
    words += [own[key].replace("/", SLASH) for key in ("name", "event") if key in own]
    return "_".join([family, *words])


@dataclass(frozen=True)
class Axes:
    """The axes that variables have, in a file that is of an ensemble, or has unknowns, or not."""

    is_ensemble: bool
    has_unknowns: bool

    @property
    def lead(self) -> tuple[str, ...]:
        """The axes of what is known at each record."""
        return ("time", "member") if self.is_ensemble else ("time",)

    def of(self, name: str, own: Mapping[str, str]) -> list[tuple[str, ...]]:
        """Return the axes that a variable may have, none of them with as many as another."""
        family = name.partition("_")[0]
        if name in TABLES:
            return [(*self.lead, *TABLES[name])]
        if name in STATES:
            return [(*self.lead, self._axis(name))]
        if family == "observed":
            return [self.lead, (*self.lead, f"{name}_axis")]
        if family == "change":
            return [("change",)]
        if family not in ("event", "tangent"):
            return [self.lead]  # a position, which the states give too
        last = (self._axis(own["state"].removesuffix(AFTER)),) if "state" in own else ()
        direction = f"direction_{own['name'].replace('/', SLASH)}"
        event = own["name"] if family == "event" else own.get("event")
        first = self.lead if event is None else (f"event_axis_{event.replace('/', SLASH)}",)
        found = [(*first, *last)]
        if family == "tangent":
            found.append((*first, direction, *last))
        # of an ensemble the numbers of members
        return [*found, first] if event is not None and last else found

    def fitting(self, name: str, own: Mapping[str, str], count: int) -> tuple[str, ...]:
        """Return the axes of a variable that has so many."""
        return next(axes for axes in self.of(name, own) if len(axes) == count)

    def _axis(self, state: str) -> str:
        return "unknown" if state == "z" and self.has_unknowns else AXES.get(state, "coordinate")


def reactions(solution: Solution) -> Array | None:
    """Return the reaction forces that a file holds, None where there are none."""
    if solution.reactions is not None:
        return solution.reactions
    system = solution.system
    if not isinstance(system, Mechanics) or "lam" not in solution.states:
        return None
    is_whole = system.coordinates == solution.names["coordinates"]
    return solution.reaction() if system.constraints and is_whole else None


def place_of(residual: str, values: Array, constraints: tuple[str, ...]) -> slice:
    """Return to which constraints a residual belongs."""
    first = len(constraints) - values.shape[-1] if residual == "nonholonomic" else 0
    return slice(first, first + values.shape[-1])


def _plain(value: Any) -> Any:
    """Give NumPy's numbers and arrays as Python's, which JSON writes with all their digits."""
    return np.asarray(value).tolist()
