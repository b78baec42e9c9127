"""The solution that a file holds: what its parts must be, and the reader that checks them.

A file may come from anybody, so nothing in it is used before it is known to be of the right kind
and of a size that fits the others. What is wrong is said by file and entry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville._basics import schema
from liouville._solution.export.layout import TABLES, Axes, Layout, Variable, label_of
from liouville._solution.export.touching import WHOLE, contacts_of
from liouville._solution.failure import Failure
from liouville._solution.points import STATES, Points
from liouville._solution.solution import RESIDUALS, Array, Solution
from liouville._solution.tangents import Tangent

#: What the attributes of a file are.
ATTRIBUTES = {
    "status": schema.one_of("done", "failed", "interrupted", "partly failed"),
    "message": schema.TEXT,
    "method": schema.TEXT,
    "h": schema.NUMBER,
    "dense_order": schema.integers(0),
    "members": schema.integers(-1),
}

#: What those are that are JSON texts.
DOCUMENTS = {
    "order": schema.NAMES,
    "initial": schema.mappings(schema.NUMBERS),
    "failures": schema.mappings(
        schema.rows(schema.integers(0), schema.NUMBER, schema.TEXT), by_number=True
    ),
    "endings": schema.mappings(schema.TEXT, by_number=True),
    "varied": schema.NAMES,
    "changing": schema.NAMES,
    "units": schema.mappings(schema.TEXT),
    "tolerances": schema.mappings(schema.NUMBERS),
    "stats": schema.mappings(schema.either(schema.NUMBER, schema.TEXT)),
    "params": schema.mappings(schema.NUMBERS),
}

#: What the names along an axis are, where they are not the system's own.
LABELS = {"residual": schema.some_of(*RESIDUALS)}

#: What a file of an earlier release may lack, and what it then is.
DEFAULTS: dict[str, Any] = {
    "dense_order": 0,
    "members": -1,
    **dict.fromkeys(("failures", "endings", "units", "initial"), "{}"),
    **dict.fromkeys(("varied", "changing"), "[]"),
}

#: The families of variables that are called by what they are of, and what that may be.
FAMILIES = {"observed": {"name"}, "event": {"name", "state"}, "tangent": {"name", "state", "event"}}

#: States that may be complex, as what is observed may.
COMPLEX = ("psi",)

#: The state of an event that says whose it is.
WHOSE = "member"


def order_of(attributes: Mapping[str, Any], where: str) -> list[str]:
    """Return the names of all arrays that a file holds."""
    return list(_document(attributes, "order", where))


def read(layout: Layout, where: str) -> Solution:
    """Return the solution of a file, whose name is `where`; ValueError where it is none."""
    attributes = DEFAULTS | layout.attributes
    own = {key: schema.entry(attributes, key, kind, where) for key, kind in ATTRIBUTES.items()}
    own |= {key: _document(attributes, key, where) for key in DOCUMENTS}
    members = None if own["members"] < 0 else int(own["members"])
    names = _names(layout, where)
    axes = Axes(members is not None, "unknown" in names)
    variables = _variables(layout, own["order"], axes, where)
    times = _times(layout, where)
    _check_sizes(variables, names, times, members, where)
    _check_members(own, members, names, where)

    def columns(variable: str) -> dict[str, Array]:
        if variable not in variables:
            return {}
        dim = TABLES[variable][0]
        axis = variables[variable][0].index(dim)
        return {name: variables[variable][1].take(i, axis) for i, name in enumerate(names[dim])}

    forces = variables.get("reactions")
    return Solution(
        t=times,
        states={name: x for name, (_, x, _) in variables.items() if name in STATES},
        invariants=columns("invariants"),
        residuals={
            name: values[..., _filled(values)] for name, values in columns("residuals").items()
        },
        observed={
            about["name"]: x
            for name, (_, x, about) in variables.items()
            if name.startswith("observed_")
        },
        angles=columns("angles"),
        balance=columns("balance"),
        events=_events(variables, axes.is_ensemble, where),
        contacts=contacts_of(variables, names.get("contact", ()), members, where),
        tangents=_tangents(variables, axes.is_ensemble, where),
        names={
            "coordinates": names["coordinate"],
            "constraints": names["constraint"],
            **({"unknowns": names["unknown"]} if axes.has_unknowns else {}),
        },
        failures={int(k): Failure(*failure) for k, failure in own["failures"].items()},
        endings={int(k): x for k, x in own["endings"].items()},
        varied=tuple(own["varied"]),
        changing=tuple(own["changing"]),
        reactions=None if forces is None else forces[1],
        members=members,
        h=float(own["h"]),
        dense_order=int(own["dense_order"]),
        **{
            key: own[key] for key in ("units", "initial", "tolerances", "method", "stats", "params")
        },
        status=own["status"],
        message=own["message"],
    )


def _variables(
    layout: Layout, order: list[str], axes: Axes, where: str
) -> dict[str, tuple[Any, Any, Any]]:
    """Return the arrays of a file in their order; ValueError where one is missing or wrong."""
    for name in order:
        if name not in layout.variables and name not in layout.labels:
            raise ValueError(f"{where} has no {name!r}, which its 'order' names")
    own = (name for name in order if name in layout.variables)
    return {name: _variable(name, layout.variables[name], axes, where) for name in own}


def _document(attributes: Mapping[str, Any], key: str, where: str) -> Any:
    """Return the value of an attribute that is JSON text."""
    text = schema.entry(DEFAULTS | dict(attributes), key, schema.TEXT, where)
    what = f"{key!r} of {where}"
    return schema.checked(schema.parsed(text, what), DOCUMENTS[key], what)


def _names(layout: Layout, where: str) -> dict[str, tuple[str, ...]]:
    """Return the names along the axes that have some."""
    wanted = {"coordinate", "constraint"} | ({"unknown", "contact"} & layout.labels.keys())
    wanted |= {dims[0] for name, dims in TABLES.items() if name in layout.variables}
    found = {}
    for dim in sorted(wanted):
        labels = layout.labels.get(dim)
        given = labels.tolist() if isinstance(labels, np.ndarray) else labels
        kind = LABELS.get(dim, schema.NAMES)
        found[dim] = tuple(schema.entry({dim: given}, dim, kind, where))
    return found


def _times(layout: Layout, where: str) -> Array:
    if "time" not in layout.labels:
        raise ValueError(f"{where} has no 'time'")
    times = np.asarray(layout.labels["time"])
    if times.dtype.kind != "f" or times.ndim != 1:
        raise ValueError(f"'time' of {where} must be a row of numbers, not {_described(times)}")
    return times


def _variable(name: str, variable: Variable, axes: Axes, where: str) -> Variable:
    """Return a variable whose name, axes and numbers are known to be those of a solution."""
    dims, values, own = variable
    what = f"{name!r} of {where}"
    family = name.partition("_")[0]
    if family in FAMILIES and name not in STATES:
        about = {k: own[k] for k in FAMILIES[family] & own.keys()}
        for key in about:
            schema.entry(about, key, schema.TEXT, what)
        if "name" not in about or label_of(family, about) != name:
            raise ValueError(f"{what} must say what it is of, not {dict(own)!r}")
    else:
        about = {}
    state = about.get("state", name)
    is_complex = family == "observed" or state in COMPLEX
    is_whole = state == WHOSE or name in WHOLE
    kinds = "iu" if is_whole else "fc" if is_complex else "f"
    if values.dtype.kind not in kinds:
        wanted = (
            "whole numbers" if kinds == "iu" else "complex numbers" if is_complex else "numbers"
        )
        raise ValueError(f"{what} must be {wanted}, not {_described(values)}")
    allowed = axes.of(name, about)
    if tuple(dims) not in allowed or len(dims) != values.ndim:
        wanted = " or ".join(", ".join(each) for each in allowed)
        raise ValueError(f"{what} must have the axes {wanted}, not {', '.join(map(str, dims))}")
    return dims, values, about


def _described(values: Array) -> str:
    return f"{values.dtype.name} of shape {values.shape}"


def _check_sizes(
    variables: Mapping[str, Variable],
    names: Mapping[str, tuple[str, ...]],
    times: Array,
    members: int | None,
    where: str,
) -> None:
    """Refuse arrays that are longer or shorter along an axis than what is along it."""
    known = {dim: (len(labels), f"{dim!r}") for dim, labels in names.items()}
    known["time"] = len(times), "'time'"
    if members is not None:
        known[WHOSE] = members, "'members'"
    for name, (dims, values, _) in variables.items():
        for dim, size in zip(dims, values.shape, strict=True):
            length, of = known.setdefault(dim, (size, repr(name)))
            if size != length:
                raise ValueError(
                    f"{name!r} of {where} must have {length} along {dim!r} as {of} has, not {size}"
                )


def _check_members(
    own: Mapping[str, Any], members: int | None, names: Mapping[str, Any], where: str
) -> None:
    """Refuse what is said of members that are none, and parameters without a value for each."""
    count = 0 if members is None else members
    for key in ("failures", "endings"):
        for member in own[key]:
            if int(member) >= count:
                raise ValueError(f"{key!r} of {where} must be of its {count} members, not {member}")
    each = {f"parameter {name!r}": own["params"].get(name) for name in own["varied"]}
    if members is not None:
        each |= {f"initial {name!r}": x for name, x in own["initial"].items()}
    for name, values in each.items():
        if not isinstance(values, list) or len(values) != count:
            raise ValueError(f"{name} of {where} must have a value for each of {count} members")
    unknown = own["initial"].keys() - set(names.get("invariant", ()))
    if unknown:
        raise ValueError(f"'initial' of {where} must be of its invariants, not {min(unknown)!r}")


def _events(variables: Mapping[str, Variable], is_ensemble: bool, where: str) -> dict[str, Points]:
    found = [(x, own) for name, (_, x, own) in variables.items() if name.startswith("event_")]
    points = {}
    for name in dict.fromkeys(own["name"] for _, own in found):
        states = {own.get("state", "t"): x for x, own in found if own["name"] == name}
        points[name] = _points(states, is_ensemble, f"event {name!r} of {where}")
    return points


def _points(states: dict[str, Array], is_ensemble: bool, what: str) -> Points:
    for name in ("t", *[WHOSE] * is_ensemble):
        if name not in states:
            raise ValueError(f"{what} has no {name!r}")
    return Points(states.pop("t"), states)


def _tangents(
    variables: Mapping[str, Variable], is_ensemble: bool, where: str
) -> dict[str, Tangent]:
    rows = [(x, own) for name, (_, x, own) in variables.items() if name.startswith("tangent_")]

    def of(name: str, event: str | None) -> dict[str, Array]:
        """Return the arrays of a direction at the records or at an event; times are "t"."""
        return {
            o.get("state", "t"): x for x, o in rows if (o["name"], o.get("event")) == (name, event)
        }

    found = {}
    for name in dict.fromkeys(own["name"] for _, own in rows):
        what = f"tangent {name!r} of {where}"
        met = dict.fromkeys(o["event"] for _, o in rows if o["name"] == name and "event" in o)
        events = {
            event: _points(of(name, event), is_ensemble, f"{event!r} of {what}") for event in met
        }
        states = of(name, None)
        if not states or "t" in states:
            raise ValueError(f"{what} has no states")
        found[name] = Tangent(states, events)
    return found


def _filled(values: Array) -> Array:
    """Return which columns are there: the others are NaN throughout."""
    flat = values.reshape(math.prod(values.shape[:-1]), values.shape[-1])
    is_missing = np.isnan(flat).all(axis=0) & bool(len(flat))
    return np.logical_not(is_missing)
