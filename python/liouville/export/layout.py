"""Solutions as named arrays with the names of their axes, and back: what files hold."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville.events import AFTER
from liouville.failure import Failure
from liouville.points import STATES, Points
from liouville.solution import Array, Solution
from liouville.systems import Field, Mechanics
from liouville.tangents import Tangent

# The attribute that marks liouville's files, and the version of their layout.
MARK, VERSION = "liouville_solution", 3

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
    variables: dict[str, Variable] = {}
    lead = ("time",) if solution.members is None else ("time", "member")
    axis_of = AXES | ({"z": "unknown"} if "unknowns" in names else {})
    for name, values in solution.states.items():
        own = unit_attribute(solution, name)
        variables[name] = ((*lead, axis_of.get(name, "coordinate")), values, own)
    for name, (values, unit) in positions(solution).items():
        variables[name] = (lead, values, {"units": unit} if unit else {})
    if solution.invariants:
        columns = np.stack(list(solution.invariants.values()), axis=-1)
        variables["invariants"] = ((*lead, "invariant"), columns, {})
    if solution.residuals:
        known = names["constraints"]
        shape = next(iter(solution.residuals.values())).shape[:-1]
        rows = np.full((*shape, len(solution.residuals), len(known)), np.nan)
        for place, (name, values) in enumerate(solution.residuals.items()):
            rows[..., place, place_of(name, values, known)] = values
        variables["residuals"] = ((*lead, "residual", "constraint"), rows, {})
    if solution.balance:
        columns = np.stack(list(solution.balance.values()), axis=-1)
        variables["balance"] = ((*lead, "term"), columns, {})
    forces = reactions(solution)
    if forces is not None:
        own = unit_attribute(solution, "reaction")
        variables["reactions"] = ((*lead, "coordinate"), forces, own)
    for name, values in solution.observed.items():
        label = "observed_" + name.replace("/", SLASH)
        own = {"name": name} | unit_attribute(solution, name)
        variables[label] = ((*lead, f"{label}_axis")[: values.ndim], values, own)
    for name, points in solution.events.items():
        label = name.replace("/", SLASH)
        axis = f"event_axis_{label}"
        own = {"name": name} | unit_attribute(solution, "t")
        variables[f"event_t_{label}"] = ((axis,), points.t, own)
        for state, values in points.states.items():
            dims = (axis, axis_of.get(state.removesuffix(AFTER), "coordinate"))[: values.ndim]
            own = {"name": name, "state": state}
            own |= unit_attribute(solution, state.removesuffix(AFTER))
            variables[f"event_{state}_{label}"] = (dims, values, own)
    for name, tangent in solution.tangents.items():
        variables |= _of_tangent(name, tangent, lead, axis_of)
    labels = {
        "coordinate": names["coordinates"],
        "constraint": names["constraints"],
        **({"unknown": names["unknowns"]} if "unknowns" in names else {}),
        "invariant": solution.invariants,
        "residual": solution.residuals,
        "term": solution.balance,
    }
    attributes = {
        MARK: VERSION,
        "status": solution.status,
        "message": solution.message,
        "method": solution.method,
        "h": solution.h,
        "dense_order": solution.dense_order,
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


def unit_attribute(solution: Solution, name: str) -> dict[str, str]:
    """Return the attribute of a quantity that has one unit, empty where it has none."""
    unit = solution.units.get(name, "")
    has_others = any(
        key.partition("[")[0] == name and own != unit for key, own in solution.units.items()
    )
    return {"units": unit} if unit and not has_others else {}


def positions(solution: Solution) -> dict[str, tuple[Array, str]]:
    """Return points by coordinates that the states of a field do not have, with their units."""
    if not isinstance(solution.system, Field) or "x" not in solution.states:
        return {}
    return solution.system.positions(solution.states["x"])


def _of_tangent(
    name: str, tangent: Tangent, lead: tuple[str, ...], axis_of: dict[str, str]
) -> dict[str, Variable]:
    """Return the arrays of a tangent: of several directions these are an axis before the last."""
    label, found = name.replace("/", SLASH), dict[str, Variable]()
    is_several = next(iter(tangent.states.values())).ndim > len(lead) + 1
    directions = (f"direction_{label}",) if is_several else ()
    for state, values in tangent.states.items():
        axes = (*lead, *directions, axis_of.get(state, "coordinate"))
        found[f"tangent_{state}_{label}"] = (axes, values, {"name": name, "state": state})
    for event, points in tangent.events.items():
        of, own = event.replace("/", SLASH), {"name": name, "event": event}
        axes = (f"event_axis_{of}", *directions)
        found[f"tangent_event_t_{label}_{of}"] = (axes, points.t, own)
        for state, values in points.states.items():
            dims = (*axes, axis_of.get(state.removesuffix(AFTER), "coordinate"))
            dims = dims if values.ndim > 1 else dims[:1]
            found[f"tangent_event_{state}_{label}_{of}"] = (dims, values, own | {"state": state})
    return found


def reactions(solution: Solution) -> Array | None:
    """Return the reaction forces that a file holds, None where there are none."""
    if solution.reactions is not None:
        return solution.reactions
    system = solution.system
    if not isinstance(system, Mechanics) or "lam" not in solution.states:
        return None
    is_whole = system.coordinates == solution.names["coordinates"]
    return solution.reaction() if system.constraints and is_whole else None


def read(layout: Layout) -> Solution:
    """Return the solution of a layout that :func:`laid_out` made."""

    def names(dim: str) -> tuple[str, ...]:
        return tuple(str(label) for label in layout.labels[dim])

    def columns(variable: str, dim: str) -> dict[str, Array]:
        if variable not in layout.variables:
            return {}
        dims, values, _ = layout.variables[variable]
        axis = dims.index(dim)
        return {name: values.take(i, axis) for i, name in enumerate(names(dim))}

    attributes = layout.attributes
    order = [name for name in json.loads(attributes["order"]) if name in layout.variables]
    variables = {name: layout.variables[name] for name in order}
    forces = variables.get("reactions")
    return Solution(
        t=np.asarray(layout.labels["time"]),
        states={name: x for name, (_, x, _) in variables.items() if name in STATES},
        invariants=columns("invariants", "invariant"),
        residuals={
            name: values[..., _filled(values)]
            for name, values in columns("residuals", "residual").items()
        },
        observed={
            own["name"]: x
            for name, (_, x, own) in variables.items()
            if name.startswith("observed_")
        },
        balance=columns("balance", "term"),
        events=_events(variables),
        tangents=_tangents(variables),
        dense_order=int(attributes.get("dense_order", 0)),
        names={
            "coordinates": names("coordinate"),
            "constraints": names("constraint"),
            **({"unknowns": names("unknown")} if "unknown" in layout.labels else {}),
        },
        h=float(attributes["h"]),
        members=_members(attributes.get("members", -1)),
        failures=_failures(json.loads(attributes.get("failures", "{}"))),
        endings={int(k): x for k, x in json.loads(attributes.get("endings", "{}")).items()},
        units=json.loads(attributes.get("units", "{}")),
        varied=tuple(json.loads(attributes.get("varied", "[]"))),
        changing=tuple(json.loads(attributes.get("changing", "[]"))),
        reactions=None if forces is None else forces[1],
        initial=json.loads(attributes.get("initial", "{}")),
        tolerances=json.loads(attributes["tolerances"]),
        method=attributes["method"],
        stats=json.loads(attributes["stats"]),
        params=json.loads(attributes["params"]),
        status=attributes["status"],
        message=attributes["message"],
    )


def _events(variables: dict[str, Variable]) -> dict[str, Points]:
    found = [(x, own) for name, (_, x, own) in variables.items() if name.startswith("event_")]
    points = {}
    for times, own in found:
        if "state" not in own:
            name = own["name"]
            of = [(x, own) for x, own in found if "state" in own and own["name"] == name]
            points[name] = Points(times, {own["state"]: x for x, own in of})
    return points


def _tangents(variables: dict[str, Variable]) -> dict[str, Tangent]:
    rows = [(x, own) for name, (_, x, own) in variables.items() if name.startswith("tangent_")]

    def of(name: str, event: str | None) -> dict[str, Array]:
        """Return the arrays of a direction at the records or at an event; times are "t"."""
        where = name, event
        return {o.get("state", "t"): x for x, o in rows if (o["name"], o.get("event")) == where}

    found = {}
    for name in dict.fromkeys(own["name"] for _, own in rows):
        met = dict.fromkeys(o["event"] for _, o in rows if o["name"] == name and "event" in o)
        points = {event: of(name, event) for event in met}
        events = {event: Points(states.pop("t"), states) for event, states in points.items()}
        found[name] = Tangent(of(name, None), events)
    return found


def place_of(residual: str, values: Array, constraints: tuple[str, ...]) -> slice:
    """Return to which constraints a residual belongs."""
    first = len(constraints) - values.shape[-1] if residual == "nonholonomic" else 0
    return slice(first, first + values.shape[-1])


def _filled(values: Array) -> Array:
    """Return which columns are there: the others are NaN throughout."""
    flat = values.reshape(math.prod(values.shape[:-1]), values.shape[-1])
    is_missing = np.isnan(flat).all(axis=0) & bool(len(flat))
    return np.logical_not(is_missing)


def _failures(given: dict[str, list[Any]]) -> dict[int, Failure]:
    return {int(member): Failure(*failure) for member, failure in given.items()}


def _members(count: int) -> int | None:
    return None if count < 0 else int(count)


def _plain(value: Any) -> Any:
    """Give NumPy's numbers and arrays as Python's, which JSON writes with all their digits."""
    return np.asarray(value).tolist()
