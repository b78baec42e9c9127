"""Scenes: the shapes of a mechanism and where they are at each frame, for films and views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._solution.solution import Array, Solution
from liouville._systems.tracing.trace import Namespace
from liouville.bodies import Mechanism
from liouville.bodies import rotations as rot
from liouville.bodies.body import spot
from liouville.plot.curves import check_solution, of_chosen
from liouville.plot.parts import Part
from liouville.plot.shapes import parts_of, planar, poses_of, springs_of
from liouville.plot.thinning import thinned

Outline = Callable[[Array, Any], Sequence[ArrayLike]]
Trace = str | Sequence[str] | Mapping[str, ArrayLike]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class Scene:
    """The shapes of a mechanism, of bodies that move or of lines that change.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Times of the frames.
    names : tuple of str
        Of the bodies, or of the polylines.
    parts : tuple of Part
        The shapes of bodies, each in the axes of its body.
    poses : ndarray, shape (k, bodies, 7)
        Places and unit quaternions of the bodies.
    springs : tuple of (int, array, int, array)
        Bodies and points in their axes that springs and rods without mass join.
    lines : list of ndarray, shape (k, points, 3)
        Polylines in the world.
    traces : list of ndarray, shape (k, 3)
        Paths of points.
    up : tuple of float
        The direction that is up.
    is_planar : bool
        Whether all moves in planes across z.
    """

    t: Array
    names: tuple[str, ...]
    parts: tuple[Part, ...]
    poses: Array
    springs: tuple[tuple[int, Array, int, Array], ...]
    lines: list[Array]
    traces: list[Array]
    up: tuple[float, ...]
    is_planar: bool

    def placed(self, body: int, points: ArrayLike) -> Array:
        """Return points at rest in the axes of a body, (m, 3), in the world: (k, m, 3)."""
        own = np.asarray(points, dtype=float)
        if body == len(self.names):
            return np.broadcast_to(own, (len(self.t), *own.shape))
        pose = self.poses[:, body, :, None]
        turned = rot.rotate(pose[:, 3:].swapaxes(0, 1), own.T[:, None])
        return np.stack(turned, axis=-1) + pose[:, None, :3, 0]

    @property
    def corners(self) -> Array:
        """Points that bound what is drawn, shape (m, 3)."""
        own = [self.placed(part.body, part.corners) for part in self.parts]
        return np.concatenate([x.reshape(-1, 3) for x in [*own, *self.lines, *self.traces]])


def scene_of(
    solution: Solution,
    outline: Outline | None,
    member: int,
    most: int,
    trace: Trace | None = None,
    up: str | None = None,
) -> Scene:
    """Return the scene of a run or of a member of an ensemble, of at most so many states.

    Raises
    ------
    TypeError
        What is to be shown is no solution; there is no outline, and the system is no assembly of
        bodies.
    ValueError
        There is no such member, body or direction; an outline has no such lines.
    """
    check_solution("a motion", solution)
    if up is not None and up not in AXES:
        raise ValueError(f"up must be 'x', 'y' or 'z', not {up!r}")
    positions = solution.y if "y" in solution.states else solution.q
    q = of_chosen(solution, positions, member)
    whole = np.flatnonzero(np.isfinite(q).all(axis=1))
    rows = whole[thinned(len(whole), most)]
    params = params_of(solution, member)
    if outline is not None:
        return _drawn(solution.t[rows], q[rows], params, outline, up)
    if not isinstance(solution.system, Mechanism):
        raise TypeError(
            "bodies are not known, as the system was not made by lv.bodies.Assembly\n"
            "hint: give outline(q, params), the polylines of the bodies; a problem of the library "
            "may have it: problems.load(name).outline"
        )
    return _assembled(solution.system, solution.t[rows], q[rows], params, trace, up)


def _drawn(
    t: Array, q: Array, params: Mapping[str, Any], outline: Outline, up: str | None
) -> Scene:
    """Return the scene of polylines, in the plane or in space."""
    known = Namespace(params)
    frames = [[np.asarray(line, dtype=float) for line in outline(row, known)] for row in q]
    shapes = {tuple(line.shape for line in lines) for lines in frames}
    sizes = {shape[1:] for shape in next(iter(shapes))}
    if len(shapes) > 1 or not frames[0] or not sizes <= {(2,), (3,)} or len(sizes) != 1:
        raise ValueError(
            "outline(q, params) must return polylines of shape (k, 2) or (k, 3), the same at all "
            f"times, not {sorted(shapes)[:2]}"
        )
    is_planar = sizes == {(2,)}
    wide = ((0, 0), (0, 0), (0, 1 if is_planar else 0))
    lines = [np.pad(np.array([frame[k] for frame in frames]), wide) for k in range(len(frames[0]))]
    return Scene(
        t=t,
        names=tuple(f"line {k + 1}" for k in range(len(lines))),
        parts=(),
        poses=np.empty((len(t), 0, 7)),
        springs=(),
        lines=lines,
        traces=[lines[0][:, -1]],
        up=AXES[up or ("y" if is_planar else "z")],
        is_planar=is_planar,
    )


def _assembled(
    system: Mechanism,
    t: Array,
    q: Array,
    params: Mapping[str, Any],
    trace: Trace | None,
    up: str | None,
) -> Scene:
    """Return the scene of an assembly of bodies."""
    values = system.values(params)
    at = t[:1], q[:1], np.zeros((1, q.shape[1]))
    poses = poses_of(system, q)
    traced = _points(system, trace)
    scene = Scene(
        t=t,
        names=system.bodies,
        parts=parts_of(system, values, at, poses, traced),
        poses=poses,
        springs=springs_of(system, values, at),
        lines=[],
        traces=[],
        up=_up(system.output("gravity", values, *at)[0], up, planar(system)),
        is_planar=planar(system),
    )
    scene.traces.extend(scene.placed(body, point[None])[:, 0] for body, point in traced)
    return scene


def _points(system: Mechanism, trace: Trace | None) -> list[tuple[int, Array]]:
    """Return bodies and points on them, their centres where none is given."""
    names: Any = () if trace is None else [trace] if isinstance(trace, str) else trace
    given = names if isinstance(names, Mapping) else dict.fromkeys(names, (0.0, 0.0, 0.0))
    kinds = system.body_layout.kinds
    bodies = {name: system.body(name) for name in given}
    return [
        (k, spot(f"trace of body '{name}'", given[name], kinds[k] == "planar"))
        for name, k in bodies.items()
    ]


def _up(gravity: NDArray[np.float64], up: str | None, is_planar: bool) -> tuple[float, ...]:
    """Return the axis against gravity, if it is one."""
    if up is not None:
        return AXES[up]
    size = float(np.linalg.norm(gravity))
    if size == 0:
        return AXES["y" if is_planar else "z"]
    return tuple((-gravity / size).tolist())


def params_of(solution: Solution, member: int) -> dict[str, Any]:
    """Return the parameters of a run or of a member, as numbers and arrays."""
    found = {name: np.asarray(value)[()] for name, value in solution.params.items()}
    count = solution.members
    if count is None:
        return found
    # of a loaded solution the shapes of the defaults are not known
    defaults = dict.fromkeys(found, 0.0) if solution.system is None else solution.system.params
    own = {name for name, x in found.items() if np.ndim(x) > np.ndim(defaults[name])}
    return {name: x[member] if name in own and len(x) == count else x for name, x in found.items()}
