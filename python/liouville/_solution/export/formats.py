"""Solutions as files of NumPy, of MATLAB, and of programs that show molecules."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from liouville._basics import schema
from liouville._basics.errors import hinted
from liouville._solution.contacts import ContactRecord
from liouville._solution.export.datasets import needed
from liouville._solution.export.layout import Layout, laid_out, reactions
from liouville._solution.export.touching import changes_of, columns_of
from liouville._solution.points import Points
from liouville._solution.solution import Solution

#: The key of the description of the arrays in an .npz file.
DESCRIPTION = "liouville"

#: What the description has: axes and attributes of each array, and the names along axes.
ANY = schema.Kind("a value", lambda _: True)
ARRAY = schema.rows(schema.lists(schema.TEXT), schema.mappings(schema.TEXT))
LABELS = schema.mappings(schema.NAMES)

#: MATLAB takes names of so many letters.
LONGEST = 63

#: Names of points that a program takes for atoms begin with one of these.
ELEMENTS = (
    "H He Li Be B C N O F Ne Na Mg Al Si P S Cl Ar K Ca Sc Ti V Cr Mn Fe Co Ni Cu Zn Ga Ge As Se "
    "Br Kr Rb Sr Y Zr Nb Mo Tc Ru Rh Pd Ag Cd In Sn Sb Te I Xe Cs Ba La Ce Pr Nd Pm Sm Eu Gd Tb "
    "Dy Ho Er Tm Yb Lu Hf Ta W Re Os Ir Pt Au Hg Tl Pb Bi Po At Rn Fr Ra Ac Th Pa U Np Pu"
)


def save_npz(solution: Solution, path: Path) -> None:
    """Write the arrays of a solution under their names, and what they are as JSON."""
    layout = laid_out(solution)
    described = {
        "attributes": layout.attributes,
        "labels": {name: list(x) for name, x in layout.labels.items() if name != "time"},
        "axes": {name: [dims, own] for name, (dims, _, own) in layout.variables.items()},
    }
    arrays: dict[str, Any] = {name: values for name, (_, values, _) in layout.variables.items()}
    arrays |= {"time": solution.t, DESCRIPTION: np.array(json.dumps(described))}
    with path.open("wb") as file:
        np.savez(file, **arrays)


def read_npz(path: Path) -> Layout:
    """Read what :func:`save_npz` wrote, those arrays alone that it names."""
    where = repr(str(path))
    with path.open("rb") as file, np.load(file, allow_pickle=False) as opened:
        _check_sizes(opened.zip, path)
        if DESCRIPTION not in opened:
            return Layout({}, {}, {})
        what = f"{DESCRIPTION!r} of {where}"
        described = schema.checked(
            schema.parsed(str(opened[DESCRIPTION]), what), schema.MAPPING, what
        )
        axes = schema.entry(described, "axes", schema.mappings(ANY), what)
        labels = schema.entry(described, "labels", LABELS, what)
        attributes = schema.entry(described, "attributes", schema.mappings(ANY), what)
        for name in axes:
            schema.entry(axes, name, ARRAY, f"'axes' of {where}")
        for name in ("time", *axes):
            if name not in opened:
                raise ValueError(f"it has no {name!r}")
        variables = {name: (tuple(dims), opened[name], own) for name, (dims, own) in axes.items()}
        return Layout(variables, {"time": opened["time"], **labels}, attributes)


def _check_sizes(opened: zipfile.ZipFile, path: Path) -> None:
    """Refuse arrays that ask for more memory than they take in the file."""
    for member in opened.infolist():
        with opened.open(member) as array:
            is_old = np.lib.format.read_magic(array) == (1, 0)
            shape, _, dtype = (
                np.lib.format.read_array_header_1_0(array)
                if is_old
                else np.lib.format.read_array_header_2_0(array)
            )
        size = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or size > member.compress_size:
            name = member.filename.removesuffix(".npy")
            raise ValueError(
                f"its array {name!r} is of {size} bytes, of which {member.compress_size} are there"
            )


def save_mat(solution: Solution, path: Path) -> None:
    """Write a solution as variables of MATLAB, with structures for what has names."""
    matlab = needed("scipy.io")
    forces = reactions(solution)
    found: dict[str, Any] = {
        "t": solution.t,
        **solution.states,
        "invariants": _structure(solution.invariants),
        "residuals": _structure(solution.residuals),
        "angles": _structure(solution.angles),
        "balance": _structure(solution.balance),
        "observed": _structure(solution.observed),
        "events": _structure({name: _point(x) for name, x in solution.events.items()}),
        "contacts": _structure({name: _contact(x) for name, x in solution.contacts.items()}),
        "names": _structure({k: np.array(x, dtype=object) for k, x in solution.names.items()}),
        "params": _structure(solution.params),
        "stats": _structure(solution.stats),
        "initial": _structure(solution.initial),
        "h": solution.h,
        "method": solution.method,
        "status": solution.status,
        "message": solution.message,
        "failed": np.array([*solution.failures], dtype=float),  # numbers of members, from 0
        **({} if forces is None else {"reactions": forces}),
    }
    with path.open("wb") as file:
        matlab.savemat(file, found, long_field_names=True, do_compression=True, oned_as="column")


def _point(points: Points) -> dict[str, Any]:
    return _structure({"t": points.t, **points.states})


def _contact(record: ContactRecord) -> dict[str, Any]:
    one = {"": record}
    return _structure({name: x.ravel() for name, x, _ in (*columns_of(one), *changes_of(one))})


def _structure(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by names that MATLAB takes for fields, each of them once."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = (plain if plain[:1].isalpha() else f"x{plain}")[:LONGEST]
        own, count = plain, 2
        while own in found:
            tail = f"_{count}"
            own, count = plain[: LONGEST - len(tail)] + tail, count + 1
        found[own] = value
    return found


def save_xyz(solution: Solution, path: Path) -> None:
    """Write an extended XYZ file: a frame for each kept step, a line for each point."""
    if solution.members is not None:
        hint = "save a member, solution.member(0).save(...), or take .nc, .zarr or .npz"
        raise ValueError(hinted("a film of points has no room for an ensemble", hint))
    points = points_of(solution.names["coordinates"])
    state = next((x for x in ("q", "y", "x") if x in solution.states), None)
    if state is None:
        raise ValueError("the run stored no states, and a film of points needs their positions")
    values = solution.states[state]
    head = f'{len(points)}\nProperties=species:S:1:pos:R:3:name:S:1 pbc="F F F" Time='
    kinds = [_element(name) for name in points]
    zero = np.zeros(len(values))
    where = np.stack(
        [[zero if k is None else values[:, k] for k in places] for places in points.values()]
    )
    with path.open("w", encoding="utf-8") as file:
        for t, frame in zip(solution.t, np.moveaxis(where, -1, 0), strict=True):
            file.write(f"{head}{t:.17g}\n")
            for kind, name, (x, y, z) in zip(kinds, points, frame, strict=True):
                file.write(f"{kind} {x:.17g} {y:.17g} {z:.17g} {name}\n")


def points_of(coordinates: Sequence[str]) -> dict[str, tuple[int, int, int | None]]:
    """Return the places of x, y and z of points by their names, as those of "x1", "y1", "z1".

    Raises
    ------
    ValueError
        Some coordinate is none of a point's, or a point has no x or y.
    """
    found: dict[str, dict[str, int]] = {}
    for k, name in enumerate(coordinates):
        match = re.fullmatch(r"([xyz])[_.]?(.*)", name) or re.fullmatch(r"(.+?)[_.]?([xyz])", name)
        if match is None or "'" in name:
            raise ValueError(_no_points(f"{name!r} is no x, y or z of a point"))
        first, second = match.groups()
        axis, point = (first, second) if first in "xyz" else (second, first)
        found.setdefault(point or "point", {})[axis] = k
    for point, places in found.items():
        if not {"x", "y"} <= places.keys():
            raise ValueError(_no_points(f"point {point!r} has only {', '.join(places)}"))
    if not found:
        raise ValueError(_no_points("the system has no coordinates by name"))
    return {name: (at["x"], at["y"], at.get("z")) for name, at in found.items()}


def _no_points(why: str) -> str:
    sentence = f"a film of points is for systems whose coordinates are points in space: {why}"
    return hinted(sentence, "name them x1, y1, z1, x2, ..., or C1_x, C1_y, C1_z, ...")


def _element(name: str) -> str:
    """Return the element that a name begins with, X if none."""
    known, start = ELEMENTS.split(), re.match(r"[A-Z][a-z]?", name)
    words = () if start is None else (start[0], start[0][0])
    return next((word for word in words if word in known), "X")
