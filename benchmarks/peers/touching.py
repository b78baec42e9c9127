"""Scenes of bodies in a plane that touch by discs, as data that each code builds its model of."""

from dataclasses import dataclass

import numpy as np

G = 9.81


@dataclass(frozen=True)
class Body:
    """A body with its centre of mass, its velocity, and discs: places in its axes and radii."""

    mass: float
    inertia: float
    at: tuple
    velocity: tuple
    discs: tuple


@dataclass(frozen=True)
class Scene:
    """Bodies and half planes, each a point and a normal, that all touch one another."""

    bodies: tuple
    planes: tuple
    seconds: float
    friction: float = 0.0
    restitution: float = 0.0
    gravity: float = G

    def gaps(self, places):
        """Return the least gap of discs and planes at each of the places (records, bodies, 3)."""
        discs = []
        for k, body in enumerate(self.bodies):
            x, y, angle = places[:, k].T
            c, s = np.cos(angle), np.sin(angle)
            for px, py, radius in body.discs:
                discs.append((k, np.stack([x + c * px - s * py, y + s * px + c * py]), radius))
        gaps = [
            np.array(normal) @ (place - np.array([point]).T) - radius
            for _, place, radius in discs
            for point, normal in self.planes
        ]
        for n, (one, here, radius) in enumerate(discs):
            for other, there, more in discs[:n]:
                if one != other:
                    gaps.append(np.hypot(*(here - there)) - radius - more)
        return np.min(gaps, axis=0)


FLOOR = ((0.0, 0.0), (0.0, 1.0))
REST = (0.0, 0.0, 0.0)


def sliding():
    """Return a block on two feet that slides to its stop."""
    feet = ((-0.2, -0.1, 0.02), (0.2, -0.1, 0.02))
    block = Body(1.0, 0.02, (0.0, 0.12, 0.0), (2.0, 0.0, 0.0), feet)
    return Scene((block,), (FLOOR,), 1.0, friction=0.5)


def rod(angle, foot, **more):
    """Return a rod of length 1 with small discs as ends, whose lower one stands at `foot`."""
    ends = ((0.0, -0.5, 0.01), (0.0, 0.5, 0.01))
    at = foot[0] - np.sin(angle) / 2, foot[1] + np.cos(angle) / 2, angle
    return Scene((Body(1.0, 1 / 12, at, REST, ends),), **more)


def ladder():
    """Return a ladder that slides down a smooth wall and leaves it."""
    wall = ((0.0, 0.0), (1.0, 0.0))
    foot = np.sin(0.3) + 0.01, 0.01
    return rod(0.3, foot, planes=(FLOOR, wall), seconds=0.7)


def toppling():
    """Return a rod on a rough floor that topples, and whose foot slips."""
    return rod(-0.1, (0.0, 0.01), planes=(FLOOR,), seconds=0.8, friction=0.3)


def bouncing():
    """Return an elastic ball."""
    ball = Body(1.0, 0.004, (0.0, 1.1, 0.0), REST, ((0.0, 0.0, 0.1),))
    return Scene((ball,), (FLOOR,), 2.0, restitution=1.0)


def box():
    """Return ten elastic discs in a box, one of which comes in."""
    disc = ((0.0, 0.0, 0.1),)
    places = [(0.3 + 0.35 * (k % 4), 0.3 + 0.35 * (k // 4), 0.0) for k in range(10)]
    speeds = [(3.0, 1.0, 0.0)] + 9 * [REST]
    bodies = tuple(Body(1.0, 0.005, *both, disc) for both in zip(places, speeds, strict=True))
    sides = [((0.0, 0.0), (1.0, 0.0)), FLOOR, ((1.6, 0.0), (-1.0, 0.0)), ((0.0, 1.6), (0.0, -1.0))]
    return Scene(bodies, tuple(sides), 1.0, restitution=1.0, gravity=0.0)


SCENES = {
    "sliding block": sliding,
    "ladder": ladder,
    "toppling rod": toppling,
    "elastic ball": bouncing,
    "ten discs": box,
}
