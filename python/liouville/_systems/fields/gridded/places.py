"""Where the points of a model's grid are: coordinates of its dimensions, which may be mere indices.

Longitudes and latitudes of two dimensions are taken where they depend on one of them alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.gridded import names
from liouville._systems.fields.gridded.reading import Variable, Variables
from liouville._systems.fields.gridded.sphere import ROUND

#: Dimensions of models by their names, where they have no coordinate that says more.
DIMENSIONS = {
    "X": ("x", "xc", "xg", "xp1", "i", "i_g", "x_c", "x_f", "lon", "longitude",
          "xi_rho", "xi_u", "xi_v", "xi_psi"),
    "Y": ("y", "yc", "yg", "yp1", "j", "j_g", "y_c", "y_f", "lat", "latitude",
          "eta_rho", "eta_u", "eta_v", "eta_psi"),
    "Z": ("z", "zl", "zu", "zp1", "k", "k_l", "k_u", "k_p1", "z_c", "z_f", "nav_lev", "lev",
          *names.DOWNWARD),
    "T": ("t", "time", "time_counter", "ocean_time"),
}  # fmt: skip

#: How names of longitudes and of latitudes begin, and their standard names.
ANGLES = {
    "X": (("glam", "nav_lon", "lon", "xc", "xg"), "longitude"),
    "Y": (("gphi", "nav_lat", "lat", "yc", "yg"), "latitude"),
}

#: Levels that a model has beside its dimension.
LEVELS = ("z", "zl", "rc", *names.DOWNWARD)

#: How names of the coordinates of a component end, those of its faces and those of its centres.
ENDINGS = {"u": {"X": "uf", "Y": "ut"}, "v": {"X": "vt", "Y": "vf"}, "w": {"X": "wt", "Y": "wt"}}

#: Longitudes depend on a dimension where they change by more than this part of their distances.
DEPENDS = 1e-2

#: What helps where they do.
RECTANGULAR = (
    "cut the data to where longitudes depend on one index and latitudes on the other, as south of "
    "20 degrees north on NEMO's global grids; or interpolate them to a rectangular grid"
)


def letters_of(variables: Variables, x: Variable) -> dict[str, str]:
    """Return the dimensions of a variable that have several points, by their letters.

    Raises
    ------
    ValueError
        A dimension is not known, or there are two of one letter.
    """
    found: dict[str, str] = {}
    for dim, size in zip(x.dims, np.shape(x.values), strict=True):
        if size == 1:
            continue
        letter = letter_of(variables, dim)
        if letter is None or letter in found:
            sentence = f"'{dim}' of '{x.name}' is no axis that is known"
            hint = f"choose one of it: dataset.isel({dim}=0)"
            if dim in variables:
                hint += f"; or say which it is: dataset['{dim}'].attrs['axis'] = 'X'"
            raise ValueError(hinted(sentence, hint))
        found[letter] = dim
    return found


def letter_of(variables: Variables, dim: str) -> str | None:
    """Return the letter of a dimension, None where it is not known."""
    own = variables.get(dim)
    said = names.letter(own) if own is not None and np.ndim(own.values) == 1 else None
    return said or next((key for key, known in DIMENSIONS.items() if dim.lower() in known), None)


def place(variables: Variables, key: str, dims: Mapping[str, str], letter: str) -> Variable:
    """Return the coordinate of a component along an axis, in degrees if it is an angle.

    Raises
    ------
    ValueError
        There is none, or it depends on the other axis as well.
    """
    dim = dims[letter]
    own = variables.get(dim)
    own = own if own is not None and np.ndim(own.values) == 1 else None
    if own is not None and not names.is_bare(own):
        return _in_degrees(own)
    others = _levels(variables, dim) if letter == "Z" else _angles(variables, key, dim, letter)
    found = others[0] if others else own
    if found is None:
        wanted = {"X": "longitudes", "Y": "latitudes", "Z": "depths"}[letter]
        sentence = f"dimension '{dim}' has no coordinate that says where its points are"
        raise ValueError(hinted(sentence, f"add {wanted}: dataset.assign_coords(...)"))
    return _in_degrees(_along(found, dim))


def _levels(variables: Variables, dim: str) -> list[Variable]:
    """Return levels along a dimension of indices."""
    return [
        x for x in variables.values()
        if (x.name != dim and x.dims == (dim,) and names.letter(x) == "Z")
        or (x.name.lower() in LEVELS and _plain(x).dims == (dim,))
    ]  # fmt: skip


def _angles(variables: Variables, key: str, dim: str, letter: str) -> list[Variable]:
    """Return longitudes or latitudes along a dimension, those of the component's points first."""
    starts, standard = ANGLES[letter]
    found = []
    for x in map(_plain, variables.values()):
        is_angle = x.name.lower().startswith(starts) or str(
            x.attrs.get("standard_name", "")
        ).startswith(standard)
        level = all(letter_of(variables, each) in ("X", "Y") for each in x.dims)
        if is_angle and dim in x.dims and x.name != dim and level:
            found.append(x)
    endings = ENDINGS[key][letter]
    return sorted(found, key=lambda x: (endings.find(x.name[-1].lower()) % 9, x.name))


def _plain(x: Variable) -> Variable:
    """Return a variable without its dimensions of one point."""
    shape = np.shape(x.values)
    dims = tuple(dim for dim, size in zip(x.dims, shape, strict=True) if size > 1)
    return x if dims == x.dims else Variable(x.name, dims, np.squeeze(x.values), x.attrs)


def _along(x: Variable, dim: str) -> Variable:
    """Return a coordinate that depends on this dimension alone."""
    if x.dims == (dim,):
        return x
    values = np.moveaxis(np.asarray(x.values, dtype=float), x.dims.index(dim), 0)
    values = values.reshape(len(values), -1)
    first = values[:, :1]
    change = np.abs((values - first + ROUND / 2) % ROUND - ROUND / 2).max()
    if not change <= DEPENDS * np.abs(np.diff(first[:, 0])).min():
        other = next(each for each in x.dims if each != dim)
        sentence = f"'{x.name}' depends on '{other}' and '{dim}': the grid is curvilinear"
        raise ValueError(hinted(sentence, RECTANGULAR))
    own = np.asarray(x.values).dtype
    return Variable(x.name, (dim,), first[:, 0].astype(own), x.attrs)


def _in_degrees(x: Variable) -> Variable:
    is_angle = names.is_angle(x) or x.name.lower().startswith(("glam", "gphi"))
    if not is_angle:
        return x
    return Variable(x.name, x.dims, names.degrees(x), {**x.attrs, "units": "degrees"})
