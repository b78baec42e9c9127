"""C-grids: each component of a velocity on the faces of cells, and the volume that flows through.

Cells are found by coordinates: each has a centre between two faces along every axis. So it does not
matter on which side of a centre a model counts its face, or how many faces there are at the ends.
The volume is the velocity times the size of its face, as the model has that, so that transports
that cancel in each cell do so in the field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.gridded import names, sphere, units
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.conventions import frame
from liouville._systems.fields.gridded.lines import Line, between, levels_between
from liouville._systems.fields.gridded.places import letters_of, place
from liouville._systems.fields.gridded.reading import Variable, Variables

#: The axes that components go along.
ALONG = {"u": "X", "v": "Y", "w": "Z"}

#: Lengths of faces, their thicknesses, or the open parts of them and thicknesses of levels.
LENGTHS = {"u": ("dyG", "DYG", "e2u"), "v": ("dxG", "DXG", "e1v")}
THICK = {"u": ("e3u", "e3u_0"), "v": ("e3v", "e3v_0")}
OPEN = {"u": ("hFacW", "HFacW"), "v": ("hFacS", "HFacS")}
OF_LEVELS = ("drF", "DRF", "e3t_1d")

#: Areas of cells, or both their lengths.
AREAS = (("rA",), ("RAC",), ("e1t", "e2t"))

#: Variables that are 0 in cells of land.
MASKS = ("hFacC", "HFacC", "maskC", "tmask", "mask_rho")

#: Levels between cells, where no component is there.
FACES = ("Zp1", "Zl", "Zu", "depthw", "gdepw_1d", "gdepw_0")

#: Radii of models differ from the earth's mean one by less than this part.
NEAR = 1e-2


def is_staggered(variables: Variables, components: Mapping[str, Variable]) -> bool:
    """Return whether the components are on the faces of cells.

    Their dimensions differ then, or the coordinates of faces are beside those of centres.
    """
    dims = []
    for x in (components["u"], components["v"]):
        sizes = zip(x.dims, np.shape(x.values), strict=True)
        dims.append({dim for dim, size in sizes if size > 1})
    return dims[0] != dims[1] or {"glamf", "gphif"} <= set(variables) or (
        {"glamu", "gphiv"} <= set(variables)
    )  # fmt: skip


def arguments(
    variables: Variables, components: dict[str, Variable], options: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a gridded field for the components of a C-grid.

    Raises
    ------
    ValueError
        The places of faces and centres are not known, do not alternate, or are curvilinear.
    """
    grid = _Grid(variables, components, options)
    if names.is_angle(grid.axis("Y")):
        lines = grid.lines
        lines["Y"] = lines["Y"].cut(sphere.inner(lines["Y"].edges, 5))
    space = [grid.axis(letter) for letter in grid.space]
    made = frame(components, space, grid.time, options)
    if made["coordinates"] == "spherical":
        made["radius"] = options.get("radius", grid.radius(made["radius"]))
        if grid.lines["X"].is_round:
            made["periodic"] = ("lon",)
    made["fluxes"], made["mask"] = grid.fluxes(made), grid.land
    known = grid.names(made["names"])
    return made | {key: names.renamed(key, x, known, options) for key, x in options.items()}


@dataclass(frozen=True, eq=False)
class _Grid:
    """The components of a C-grid and what it has beside them."""

    variables: Variables
    components: dict[str, Variable]
    options: Mapping[str, Any]

    def __post_init__(self) -> None:
        dims = self.dims
        if "Z" not in dims["u"]:
            self.components.pop("w", None)
        wanted = set(dims["u"])
        for key, x in self.components.items():
            if set(dims[key]) != wanted or not {"X", "Y"} <= wanted:
                sentence = (
                    f"'{x.name}' must have an X and a Y axis, and levels and times as the others"
                )
                raise ValueError(f"{sentence}, not {', '.join(x.dims)}")

    @cached_property
    def dims(self) -> dict[str, dict[str, str]]:
        """The dimensions of the components by their letters."""
        return {key: letters_of(self.variables, x) for key, x in self.components.items()}

    @property
    def space(self) -> str:
        """The letters of the axes of space."""
        return "XYZ" if "Z" in self.dims["u"] else "XY"

    @cached_property
    def time(self) -> Variable | None:
        """The axis of times."""
        dim = self.dims["u"].get("T")
        if dim is None:
            return None
        if dim not in self.variables:
            sentence = f"dimension '{dim}' has no coordinate that says what times it has"
            raise ValueError(hinted(sentence, "add them: dataset.assign_coords(...)"))
        return self.variables[dim]

    @property
    def _letters(self) -> str:
        """The letters of the axes of arrays."""
        return ("T" if self.time is not None else "") + self.space

    def _place(self, key: str, letter: str) -> Variable:
        return place(self.variables, key, self.dims[key], letter)

    @cached_property
    def _centres(self) -> dict[str, Variable]:
        """The centres of cells: along an axis those of a component that goes along another."""
        return {letter: self._place("v" if letter == "X" else "u", letter) for letter in self.space}

    @cached_property
    def lines(self) -> dict[str, Line]:
        """The cells along each axis."""
        centres, found = self._centres, {}
        for key, letter in (("u", "X"), ("v", "Y")):
            faces = self._place(key, letter)
            found[letter] = between(faces, centres[letter], *self._circle(faces, letter))
        if "Z" in self.space:
            found["Z"] = self._levels(centres["Z"])
        return found

    def _circle(self, x: Variable, letter: str) -> tuple[float | None, bool]:
        """Return the length of the circle that faces are on, if they are, and whether it closes."""
        own = {x.name, *(dims[letter] for dims in self.dims.values())}
        own |= {"lon"} if letter == "X" else set()
        walls, periodic = (self.options.get(key, ()) for key in ("walls", "periodic"))
        if letter == "X" and names.is_angle(x):
            return sphere.ROUND, not own & set(sphere.names(walls))
        if not own & set(sphere.names(periodic)):
            return None, False
        values = np.asarray(x.values, dtype=float)
        return float(abs(np.diff(values).mean()) * values.size), True

    def _levels(self, centres: Variable) -> Line:
        """Return the cells between levels."""
        if "w" in self.components:
            return levels_between(self._place("w", "Z"), centres)
        for name in FACES:
            if name in self.variables and np.ndim(self.variables[name].values) == 1:
                line = levels_between(self.variables[name], centres)
                return Line(line.edges, np.full(line.edges.size, -1), line.cells)
        sentence = f"the levels between which '{centres.name}' is are not in the data set"
        raise ValueError(hinted(sentence, "add them: 'Zp1' of MITgcm, 'gdepw_1d' of NEMO, or w"))

    def axis(self, letter: str) -> Variable:
        """Return the edges of cells along an axis."""
        centre = self._centres[letter]
        name = "depth" if centre.name in names.DOWNWARD else centre.name
        return Variable(name, (name,), self.lines[letter].edges, centre.attrs)

    def names(self, given: Sequence[str]) -> dict[str, str]:
        """Return the names of axes that a field has, by those that the data set has."""
        found: dict[str, str] = {}
        for letter, name in zip(self.space, given, strict=True):
            own = [dims[letter] for dims in self.dims.values()]
            own += [self._centres[letter].name, self.axis(letter).name]
            found |= dict.fromkeys(own, name)
        return found

    # transports through faces

    def _taken(self, x: Variable, along: str | None) -> Array:
        """Return values on the faces across an axis, or in cells; axes are t, x, y, z.

        Axes that a variable does not have are of one point.
        """
        letters, lines = letters_of(self.variables, x), self.lines
        if more := set(letters) - set(self._letters):
            dim = letters[more.pop()]
            sentence = f"'{x.name}' has an axis '{dim}', and the velocity has none of its kind"
            raise ValueError(hinted(sentence, f"choose a point of it: dataset.isel({dim}=0)"))
        order = [letter for letter in "TXYZ" if letter in letters]
        shape = np.shape(x.values)
        values = np.asarray(x.values).reshape([size for size in shape if size > 1])
        dims = [dim for dim, size in zip(x.dims, shape, strict=True) if size > 1]
        values = values.transpose([dims.index(letters[letter]) for letter in order])
        for k, letter in enumerate(order):
            if letter != "T":
                own = lines[letter]
                places = own.faces if letter == along else own.cells
                if places.max() >= values.shape[k]:
                    sentence = f"'{x.name}' has {values.shape[k]} points along '{letters[letter]}'"
                    raise ValueError(f"{sentence}, and others have more than {places.max()}")
                values = values.take(places, axis=k)
                if (places < 0).any():  # water beyond the levels is still
                    zero = [-1 if j == k else 1 for j in range(values.ndim)]
                    values = np.where((places < 0).reshape(zero), 0.0, values)
        missing = [k for k, letter in enumerate(self._letters) if letter not in letters]
        return np.expand_dims(values, missing)

    def _first(self, known: Sequence[str], along: str | None) -> Array | None:
        """Return the first of these variables that there is."""
        found = next((self.variables[name] for name in known if name in self.variables), None)
        return None if found is None else np.nan_to_num(self._taken(found, along))

    def _shaped(self, values: Array, letter: str) -> Array:
        """Return values along an axis for products with arrays of all."""
        return values.reshape([-1 if each == letter else 1 for each in self._letters])

    def radius(self, usual: float) -> float:
        """Return the radius of the sphere by lengths of faces, or the usual one."""
        lengths = self._first(LENGTHS["u"], "X")
        if lengths is None:
            return usual
        widths = self._shaped(np.radians(self.lines["Y"].widths), "Y")
        found = float(np.median(lengths / widths)) * usual / sphere.EARTH
        return found if abs(found / usual - 1) < NEAR else usual

    def fluxes(self, made: Mapping[str, Any]) -> list[Array]:
        """Return the volume through each face in unit time, in the velocity's unit of length."""
        u, v = (self._speeds(key) * self._face(key, made) for key in "uv")
        if "Z" not in self.space:
            return [u, v]
        level = self.axis("Z")
        if "w" not in self.components:
            return [u, v, self._upward([u, v], names.axis_is_down(level))]
        w = self._speeds("w") * self._area(made)
        return [u, v, -w if names.is_against(level, self.components["w"], w) else w]

    def _speeds(self, key: str) -> Array:
        return np.nan_to_num(self._taken(self.components[key], ALONG[key]))

    def _upward(self, level: list[Array], is_down: bool | None) -> Array:
        """Return the volume through each level, where there is none through the floor."""
        lead = level[0].ndim - 3
        for k, letter in enumerate("XY"):
            if self.lines[letter].is_round:
                level[k] = np.concatenate([level[k], level[k].take([0], lead + k)], axis=lead + k)
        total = np.diff(level[0], axis=lead) + np.diff(level[1], axis=lead + 1)
        floor = np.zeros((*total.shape[:-1], 1))
        if is_down:
            return np.concatenate([np.cumsum(total[..., ::-1], axis=-1)[..., ::-1], floor], axis=-1)
        return np.concatenate([floor, -np.cumsum(total, axis=-1)], axis=-1)

    def _widths(self, letter: str, made: Mapping[str, Any]) -> Array:
        """Return the widths of cells, on a sphere of longitudes at the equator."""
        unit = made.get("height", 1.0)
        if letter != "Z":
            unit = np.radians(made["radius"]) if "radius" in made else 1.0
        return self._shaped(self.lines[letter].widths * unit, letter)

    def _face(self, key: str, made: Mapping[str, Any]) -> Array:
        """Return the sizes of the faces of a component."""
        unit, along = self._metres, ALONG[key]
        found = self._first(LENGTHS[key], along)
        if found is not None:
            found = found / unit
        else:
            found = self._widths("Y" if key == "u" else "X", made)
            if key == "v" and "radius" in made:
                found = found * self._shaped(np.cos(np.radians(self.lines["Y"].edges)), "Y")
        if "Z" not in self.space:
            return found
        thick = self._first(THICK[key], along)
        if thick is not None:
            return found * thick / unit
        levels, part = self._first(OF_LEVELS, along), self._first(OPEN[key], along)
        found = found * (self._widths("Z", made) if levels is None else levels / unit)
        return found if part is None else found * part

    def _area(self, made: Mapping[str, Any]) -> Array:
        """Return the areas of cells."""
        for known in AREAS:
            if set(known) <= set(self.variables):
                sides = [self._taken(self.variables[name], "Z") / self._metres for name in known]
                return sides[0] / self._metres if len(sides) == 1 else sides[0] * sides[1]
        if "radius" not in made:
            return self._widths("X", made) * self._widths("Y", made)
        sines = made["radius"] * np.diff(np.sin(np.radians(self.lines["Y"].edges)))
        return self._widths("X", made) * self._shaped(sines, "Y")

    @property
    def _metres(self) -> float:
        """The velocity's unit of length in metres."""
        return (units.velocity(self.components["u"].units) or (1.0,))[0]

    @property
    def land(self) -> Any:
        """Which cells are land: those that a mask says, or all whose faces have no numbers."""
        given = next((self.variables[name] for name in MASKS if name in self.variables), None)
        lead = int(self.time is not None)
        shape = tuple(self.lines[letter].cells.size for letter in self.space)
        if given is not None:
            found = self._taken(given, None) == 0
            return np.broadcast_to(found[0] if lead else found, shape)
        missing = np.ones(shape, dtype=bool)
        for k, key in enumerate("uv"):
            none = np.isnan(self._taken(self.components[key], ALONG[key]))
            if lead:
                self._check_gaps(key, none)
                none = none[0]
            after = np.roll(none, -1, k) if self.lines["XY"[k]].is_round else none.take(
                range(1, none.shape[k]), k)  # fmt: skip
            missing &= none.take(range(shape[k]), k) & after
        return missing if missing.any() else None

    def _check_gaps(self, key: str, none: Array) -> None:
        if (gaps := none != none[:1]).any():
            count = int(gaps.any(0).sum())
            sentence = (
                f"'{self.components[key].name}' is NaN at some times only, at {count} of its points"
            )
            raise ValueError(hinted(sentence, "fill the gaps, or leave these times out"))
