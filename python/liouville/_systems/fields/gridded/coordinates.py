"""Coordinates in which a divergence is the plain one.

With q = R^2 / 2 a field without divergence in space has none in (q, phi, Z):

    q' = R v_R,   phi' = v_phi / R,   Z' = v_Z;   A_q = A_R / R,   A_phi -> R A_phi

and on a sphere of radius a, with mu = sin(latitude), none in (longitude, mu), or in (longitude,
mu, z) of a thin shell, z being a height or a depth:

    lon' = u / (a cos lat),   mu' = v cos(lat) / a,   z' = w
    A_lon -> A_east cos(lat) / a,   A_mu -> A_north / (a cos lat),   A_z -> A_up / a^2
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from liouville._systems.fields.gridded.axis import Array

#: The kinds of coordinates.
KINDS = ("cartesian", "cylindrical", "spherical")

#: Nodes nearer to an axis or a pole than this part of the rest count as being on it.
POLE = 1e-9


@dataclass(frozen=True)
class Turn:
    """A coordinate that is an angle: its place among the axes, a whole turn and its unit."""

    place: int
    length: float
    unit: str
    advice: str


#: The angles that an axis may go round.
TURNS = {
    "cylindrical": Turn(1, 2 * np.pi, "", "angles are in radians: np.radians"),
    "spherical": Turn(0, 360.0, " degrees", "angles are in degrees: np.degrees"),
}


@dataclass(frozen=True)
class Coordinates:
    """The way from a user's coordinates to those that are stepped.

    Attributes
    ----------
    kind : {"cartesian", "cylindrical", "spherical"}
        Which they are.
    radius : float
        Of the sphere.
    height : float
        The user's unit of heights on it, in that of the radius.
    """

    kind: str = "cartesian"
    radius: float = 1.0
    height: float = 1.0

    def names(self, given: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the coordinates that are stepped."""
        if self.kind == "cylindrical":
            return ("q", "phi", "Z")
        return ("lon", "mu", *given[2:]) if self.kind == "spherical" else given

    def inward(self, x: Array, span: tuple[float, float] | None = None) -> Array:
        """Return states of points, the coordinate last.

        Longitudes that are in a span but for a turn are brought there.
        """
        x = np.array(x, dtype=float)
        if self.kind == "cylindrical":
            x[..., 0] = x[..., 0] ** 2 / 2
        elif self.kind == "spherical":
            x[..., :2] = np.radians(x[..., :2])
            x[..., 1] = np.sin(x[..., 1])
            x[..., 2:] *= self.height
            if span is not None:
                lon, turn = x[..., 0], 2 * np.pi
                turned = lon + turn * np.ceil((span[0] - lon) / turn)
                is_off = (lon < span[0]) | (lon > span[1])
                x[..., 0] = np.where(is_off & (turned <= span[1]), turned, lon)
        return x

    def outward(self, x: Array) -> Array:
        """Return points of states."""
        x = np.array(x, dtype=float)
        if self.kind == "cylindrical":
            x[..., 0] = np.sqrt(2 * x[..., 0])
        elif self.kind == "spherical":
            x[..., 1] = np.arcsin(np.clip(x[..., 1], -1, 1))
            x[..., :2] = np.degrees(x[..., :2])
            x[..., 2:] /= self.height
        return x

    def positions(self, x: Array) -> dict[str, tuple[Array, dict[str, str]]]:
        """Return the coordinates of points that states do not have, with CF's attributes."""
        points = np.moveaxis(self.outward(x), -1, 0)
        if self.kind == "spherical":
            east = {"units": "degrees_east", "standard_name": "longitude"}
            north = {"units": "degrees_north", "standard_name": "latitude"}
            return {"lon": (points[0], east), "lat": (points[1], north)}
        return {"R": (points[0], {})} if self.kind == "cylindrical" else {}

    def lengths(self, x: Array) -> Array:
        """Return the lengths of unit changes of the coordinates of states x, shape (..., n)."""
        found = np.ones_like(x)
        if self.kind == "cylindrical":
            r = np.sqrt(2 * x[..., 0])
            found[..., 0], found[..., 1] = 1 / r, r
        elif self.kind == "spherical":
            cosine = np.sqrt(1 - x[..., 1] ** 2)
            found[..., 0], found[..., 1] = self.radius * cosine, self.radius / cosine
        return found

    def velocity(self, components: Sequence[Array], first: Array, second: Array) -> list[Array]:
        """Return the rates of the states, given the nodes along the first and the second axis."""
        if self.kind == "cylindrical":
            r = first[:, None, None]
            return [r * components[0], components[1] / r, components[2]]
        if self.kind == "spherical":
            cosine = _along_second(np.cos(np.radians(second)), components)
            u, v, *w = components
            return [u / (self.radius * cosine), v * cosine / self.radius, *w]
        return list(components)

    def fluxes(self, components: Sequence[Array]) -> list[Array]:
        """Return fluxes through faces in the coordinates of the states."""
        if self.kind == "spherical":
            return [each / self.radius**2 for each in components]
        return list(components)

    def potential(self, components: Sequence[Array], first: Array, second: Array) -> list[Array]:
        """Return the potential in the coordinates of the states."""
        if self.kind == "cylindrical":
            r = first[:, None, None]
            return [components[0] / r, r * components[1], components[2]]
        if self.kind == "spherical":
            *level, up = components
            cosine = _along_second(np.cos(np.radians(second)), components)
            factors = (cosine / self.radius, 1 / (self.radius * cosine))
            level = [x * factor for x, factor in zip(level, factors, strict=False)]
            return [*level, up / self.radius**2]
        return list(components)


def _along_second(values: Array, components: Sequence[Array]) -> Array:
    """Return values along the second axis of components, two or three of them."""
    return values[:, None] if len(components) == 3 else values
