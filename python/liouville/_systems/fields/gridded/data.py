"""The data of a gridded field: arrays on axes, land among them, and their potential."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.gridded import checks, islands
from liouville._systems.fields.gridded.axis import Array, Axis
from liouville._systems.fields.gridded.coordinates import POLE, Coordinates
from liouville._systems.fields.gridded.land import with_land
from liouville._systems.fields.gridded.potential import (
    Potential,
    blocks,
    curl,
    fluxes_of_faces,
    fluxes_of_nodes,
    joined,
    of_potential,
    solved,
)

#: The unit of height on a sphere where heights do not change, of a sphere of the earth's radius.
HEIGHT = 6.371


@dataclass(frozen=True, eq=False)
class Given:
    """The data of a field.

    Attributes
    ----------
    what : {"velocity", "potential", "fluxes"}
        Which arrays there are.
    kind : Coordinates
        The coordinates of the axes.
    axes : list of Axis
        In the user's coordinates.
    time : Axis, or None
        That of the samples.
    """

    what: str
    kind: Coordinates
    axes: list[Axis]
    time: Axis | None

    @property
    def lead(self) -> int:
        """How many axes of arrays are before those of space."""
        return int(self.time is not None)

    def arrays(self, data: Any, turned: Sequence[bool]) -> list[Array]:
        """Return the arrays given, axes growing."""
        what, axes, n = self.what, self.axes, len(self.axes)
        times = () if self.time is None else (self.time.nodes,)
        lead = len(times)
        if what == "fluxes":
            shapes = [
                tuple(a.nodes if j == k else a.n for j, a in enumerate(axes)) for k in range(n)
            ]
        else:
            count = 1 if what == "potential" and n == 2 else n
            shapes = [tuple(axis.nodes for axis in axes)] * count
        shapes = [times + shape for shape in shapes]
        named = [axis.name for axis in axes] if len(shapes) == n else ["psi"]
        arrays = checks.arrays_of(what, data, named, shapes)
        if what != "fluxes":
            checks.check_ends(what, arrays, axes, lead)
        flips = tuple(lead + k for k, is_turned in enumerate(turned) if is_turned)
        return [np.flip(array, flips) for array in arrays]

    def land(self, arrays: list[Array], mask: Any, turned: Sequence[bool]) -> tuple[Any, Any]:
        """Return which nodes and which cells are land, None where there is none."""
        what, axes = self.what, self.axes
        bad = [np.isnan(array) for array in arrays]
        if any(np.isinf(array).any() for array in arrays):
            sentence = f"{what} is infinite at {sum(int(np.isinf(x).sum()) for x in arrays)} places"
            raise ValueError(hinted(sentence, "land is NaN of a velocity, or has a mask="))
        land = None
        if mask is not None:
            land = np.asarray(mask)
            wanted = tuple(a.n if what == "fluxes" else a.nodes for a in axes)
            if land.dtype != bool or land.shape != wanted:
                sentence = (
                    f"mask must be an array of bool of shape {wanted}, not {land.dtype} of shape "
                )
                hint = "True is land: of a mask that is 1 in the water give mask == 0"
                raise ValueError(hinted(f"{sentence}{land.shape}", hint))
            land = np.flip(land, tuple(k for k, is_turned in enumerate(turned) if is_turned))
        if any(each.any() for each in bad):
            if what != "velocity":
                raise ValueError(hinted(f"{what} has values that are not finite", "give 0 on land"))
            missing = np.logical_or.reduce(bad)
            if self.time is not None:
                known = np.zeros(missing.shape[1:], dtype=bool) if land is None else land
                checks.check_gaps(missing & ~known, axes, self.time)
                missing = missing.all(0)
            if missing.all():
                raise ValueError("velocity is NaN at all nodes")
            land = missing if land is None else land | missing
        if land is None:
            return None, None
        cells = land if what == "fluxes" else islands.cells_of_nodes(land, axes)
        if len(axes) == 3 and cells.any():
            checks.check_floor(cells, axes)
        return (None if what == "fluxes" else land), cells if cells.any() else None

    def stepped(self) -> list[Axis]:
        """Return the axes in the coordinates that are stepped."""
        axes, (first, second, *_) = self.axes, self.axes
        if self.kind.kind == "cylindrical":
            if not first.edges[0] > POLE * first.edges[-1]:
                sentence = f"R begins at {first.edges[0]:g}, and cylindrical grids beyond the axis"
                raise ValueError(hinted(sentence, "give a Cartesian grid around the axis"))
            return [Axis(first.name, first.edges**2 / 2, first.p, first.bounds), *axes[1:]]
        if self.kind.kind == "spherical":
            if np.abs(second.edges).max() > 90 * (1 - POLE):
                sentence = "latitudes are between -90 and 90 degrees, without the poles"
                raise ValueError(hinted(sentence, "cut the data at 89 degrees or before"))
            mu = np.sin(np.radians(second.edges))
            lon = Axis(first.name, np.radians(first.edges), first.p, first.bounds)
            return [lon, Axis(second.name, mu, second.p, second.bounds), *axes[2:]]
        return axes

    def potential(
        self, arrays: list[Array], dry: Any, land: Any, axes: list[Axis], gauge: str
    ) -> Potential:
        """Return the potential of the data on these axes, and the mean flow.

        Nothing moves at nodes that are `dry`, nor, in three dimensions, in cells of land. Some
        times are taken together, for what is made on the way is many times as large as they are.
        """
        unit = self._unit_of_height(arrays)
        if unit != 1.0:
            axes = [*axes[:2], replace(axes[2], edges=axes[2].edges * unit)]
        parts = blocks(arrays[0]) if self.lead else (slice(None),)
        found = joined(
            [
                self._potential_at([x[times] for x in arrays], dry, axes, gauge, unit)
                for times in parts
            ]
        )
        if land is not None and len(axes) == 3:
            found = with_land(found, land, axes, self.lead)
        if unit == 1.0:
            return found
        mean = found.mean.copy()
        mean[..., 2] /= unit
        return replace(found, a=tuple(a / unit for a in found.a), mean=mean)

    def _unit_of_height(self, arrays: list[Array]) -> float:
        """Return the unit of heights on a sphere in which a divergence is weighed; 1 elsewhere.

        Rates of angles and of heights have the same root of their mean square in it. Where heights
        do not change, a thousand kilometres on the earth are one: then they are what is corrected.
        """
        if self.kind.kind != "spherical" or len(self.axes) < 3 or self.what == "potential":
            return 1.0
        sizes = [float(np.nanmean(np.square(x, dtype=float))) for x in arrays]
        if self.what == "fluxes":  # through faces: about cells of the mean size
            turned = [np.radians(float(np.mean(np.diff(axis.edges)))) for axis in self.axes[:2]]
            deep = float(np.mean(np.diff(self.axes[2].edges)))
            across = (turned[1] * deep, turned[0] * deep, turned[0] * turned[1] * self.kind.radius)
            sizes = [
                x / (self.kind.radius * part) ** 2 for x, part in zip(sizes, across, strict=True)
            ]
        level, up = np.sqrt(sizes[0] + sizes[1]) / self.kind.radius, np.sqrt(sizes[2])
        return float(level / up) if up else HEIGHT / self.kind.radius

    def _potential_at(
        self, arrays: list[Array], dry: Any, axes: list[Axis], gauge: str, unit: float
    ) -> Potential:
        arrays = [np.asarray(array, dtype=float) for array in arrays]
        if dry is not None:
            arrays = [np.where(dry, 0.0, array) for array in arrays]
        what, lead, kind = self.what, self.lead, self.kind
        nodes = [axis.edges[: axis.nodes] for axis in self.axes]
        if what == "fluxes":
            faces = kind.fluxes(arrays)
            faces = faces if unit == 1.0 else [unit * each for each in faces]
            return solved(fluxes_of_faces(faces, axes, lead), axes, lead)
        if what == "velocity":
            rates = kind.velocity(arrays, nodes[0], nodes[1])
            rates[2:] = [unit * rate for rate in rates[2:]]
            return solved(fluxes_of_nodes(rates, axes, lead), axes, lead)
        a = of_potential(kind.potential(arrays, nodes[0], nodes[1]), axes, lead)
        if gauge == "coulomb":
            return solved(curl(a, axes, lead), axes, lead)
        return Potential(a, np.zeros((*a[0].shape[:lead], len(axes))), 0.0, 0.0)
