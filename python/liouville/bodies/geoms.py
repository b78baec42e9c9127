"""Which shapes of MuJoCo's models can touch, and what of it contacts of an assembly have."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body
from liouville.bodies.shapes import Box, Capsule, Plane, Shape, Sphere
from liouville.bodies.unmodelled import JOINTS, is_off, named

#: Codes of shapes that touch; and pairs of them that do, the first of which may be the second too.
PLANE, SPHERE, CAPSULE, BOX = 0, 2, 3, 6
MODELLED = {(PLANE, SPHERE), (PLANE, CAPSULE), (PLANE, BOX)}
MODELLED |= {(SPHERE, SPHERE), (SPHERE, CAPSULE), (SPHERE, BOX)}
#: Pairs that have friction in space.
ROUND = [PLANE, SPHERE], [PLANE, CAPSULE]
#: Numbers of directions of contacts: none has friction, and of others those that slide and turn
#: about the normal, which motions in a plane do not.
SMOOTH, SLIDING, IN_SPACE = 1, (3, 4), 3
#: Directions are parallel, or across, within this.
ALIKE = 1e-9
#: The most pairs of shapes that are read.
MOST = 1000


@dataclass(frozen=True)
class Pair:
    """Two shapes that can touch.

    Attributes
    ----------
    name : str
        Those of both.
    geoms : tuple of two int
        Their numbers; a plane is the second.
    friction : float or None
        The coefficient, None where the friction is not modelled.
    is_modelled : bool
        Whether shapes like these touch in an assembly.
    """

    name: str
    geoms: tuple[int, int]
    friction: float | None
    is_modelled: bool


def pairs_of(model: Any, data: Any, without: Sequence[str]) -> list[Pair]:
    """Return the pairs of shapes that can touch, but for what is named in `without`."""
    if "contact" in without or is_off(model, "contact") or is_off(model, "constraint"):
        return []
    across, found = plane_of(model, data), list[Pair]()
    for a, b, dims, friction in _meeting(model):
        if len(found) == MOST:
            sentence = f"more than {MOST} pairs of shapes can touch in the file"
            raise ValueError(hinted(sentence, "leave them out: without=('contact',)"))
        kinds = sorted(int(model.geom_type[k]) for k in (a, b))
        is_modelled = tuple(kinds) in MODELLED
        if kinds == [CAPSULE, CAPSULE] and across is not None:  # and both lie in that plane
            axes = [data.geom_xmat[k].reshape(3, 3)[:, 2] for k in (a, b)]
            is_modelled = all(abs(axis @ across) < ALIKE for axis in axes)
        if not is_modelled and "contact shapes" in without:
            continue
        one, other = (b, a) if model.geom_type[a] == PLANE else (a, b)
        name = f"{named(model, 'geom', one)}.{named(model, 'geom', other)}"
        is_in_plane = across is not None and _lies(data, (a, b), kinds, across)
        mu: float | None = None
        if dims == SMOOTH or not friction.any() or "friction of contacts" in without:
            mu = 0.0
        elif is_in_plane and dims in SLIDING and friction[0] == friction[1]:
            mu = float(friction[0])
        elif across is None and kinds in ROUND and dims == IN_SPACE:
            mu = float(friction[0]) if friction[0] == friction[1] else None
        found.append(Pair(name, (one, other), mu, is_modelled))
    return found


def refused(pairs: Sequence[Pair]) -> dict[str, list[str]]:
    """Return which pairs are not modelled, by the reason."""
    shapes = [pair.name for pair in pairs if not pair.is_modelled]
    rubbing = [pair.name for pair in pairs if pair.is_modelled and pair.friction is None]
    return {"contact shapes": shapes, "friction of contacts": rubbing}


def plane_of(model: Any, data: Any) -> NDArray[np.float64] | None:
    """Return the normal of the plane that all bodies move in, None where they do not."""
    kinds = [JOINTS[k] for k in model.jnt_type]
    hinges = [data.xaxis[k] for k, kind in enumerate(kinds) if kind == "hinge"]
    slides = [data.xaxis[k] for k, kind in enumerate(kinds) if kind == "slide"]
    if len(hinges) + len(slides) < len(kinds) or not hinges:
        return None
    normal = np.array(hinges[0])
    if any(np.linalg.norm(np.cross(axis, normal)) > ALIKE for axis in hinges):
        return None
    return None if any(abs(axis @ normal) > ALIKE for axis in slides) else normal


def shape_of(model: Any, data: Any, k: int, body: Body) -> Shape:
    """Return a shape as drawn."""
    at, turn, size = data.geom_xpos[k].copy(), data.geom_xmat[k].reshape(3, 3), model.geom_size[k]
    kind = int(model.geom_type[k])
    if kind == PLANE:
        return Plane(body, at, turn[:, 2].copy())
    if kind == SPHERE:
        return Sphere(body, float(size[0]), at)
    if kind == CAPSULE:
        arm = size[1] * turn[:, 2]
        return Capsule(body, (at - arm, at + arm), float(size[0]))
    rotation = rot.of_frame(turn[:, 0].copy(), turn[:, 2].copy())
    return Box(body, 2 * size, at, rotation)


def restitution_of(pairs: Sequence[Pair], given: float | Mapping[str, float]) -> Callable[..., Any]:
    """Return the restitution of contacts by name, from one for all or those of some."""
    if not isinstance(given, Mapping):
        return lambda name: given
    known = [pair.name for pair in pairs]
    for name in given:
        if name not in known:
            sentence = f"restitution= has {name!r}, which is no contact"
            raise ValueError(hinted(sentence, f"contacts are {', '.join(known) or 'none'}"))
    return lambda name: given.get(name, 0.0)


def _lies(
    data: Any, geoms: tuple[int, int], kinds: Sequence[int], across: NDArray[np.float64]
) -> bool:
    """Return whether planes among shapes have normals in the plane of motion."""
    if kinds[0] != PLANE:
        return True
    turned = [data.geom_xmat[k].reshape(3, 3)[:, 2] for k in geoms]
    return any(abs(normal @ across) < ALIKE for normal in turned)


def _meeting(model: Any) -> Iterator[tuple[int, int, int, NDArray[np.float64]]]:
    """Yield pairs of shapes that MuJoCo looks for contacts of, their dimensions and friction."""
    weld = model.body_weldid
    parent = weld[model.body_parentid[weld]]
    filters = not is_off(model, "filter parent")
    left_out = {int(x) for x in model.exclude_signature}
    known = set()
    for k in range(model.npair):
        a, b = int(model.pair_geom1[k]), int(model.pair_geom2[k])
        known.add((min(a, b), max(a, b)))
        if weld[model.geom_bodyid[a]] != weld[model.geom_bodyid[b]]:
            yield a, b, int(model.pair_dim[k]), model.pair_friction[k, :2]

    def is_free(a: int, b: int) -> bool:
        one, other = int(weld[a]), int(weld[b])
        kin = one == int(parent[other]) or other == int(parent[one])
        if one == other or (filters and kin and one and other):
            return False
        low, high = sorted((a, b))
        return (low << 16) + high not in left_out

    own = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    types, affinities = model.geom_contype[own], model.geom_conaffinity[own]
    bodies = model.geom_bodyid[own]
    carriers = weld[bodies]
    for j, a in enumerate(own.tolist()):
        meets = (types[j] & affinities[:j]) | (types[:j] & affinities[j])
        for other in np.flatnonzero((meets != 0) & (carriers[:j] != carriers[j])):
            b = int(own[other])
            if (b, a) not in known and is_free(int(bodies[j]), int(bodies[other])):
                yield b, a, *_law(model, a, b)


def _law(model: Any, a: int, b: int) -> tuple[int, NDArray[np.float64]]:
    """Return dimensions and coefficients of friction of a pair that is not listed itself."""
    first, second = int(model.geom_priority[a]), int(model.geom_priority[b])
    rows = [a, b] if first == second else [a if first > second else b]
    friction = model.geom_friction[rows].max(axis=0)
    return int(model.geom_condim[rows].max()), np.array([friction[0], friction[0]])
