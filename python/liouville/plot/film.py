"""Films of mechanisms in the plane and in space, drawn in two dimensions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._solution.solution import Array, Solution
from liouville.bodies import rotations as rot
from liouville.plot.canvas import ANIMATIONS, GREY, blank, check, colours, matplotlib
from liouville.plot.scene import Outline, Scene, Trace, scene_of

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

# More poses than this do not show.
POSES = 4000

#: Pixels of a written film an inch.
DPI = 100

#: Azimuth and elevation in degrees from which a mechanism in space is seen.
VIEW = (-60.0, 20.0)


def animation(
    solution: Solution,
    outline: Outline | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    seconds: float = 6.0,
    fps: int = 25,
    member: int = 0,
    trace: Trace | None = None,
    up: str | None = None,
    view: tuple[float, float] = VIEW,
) -> FuncAnimation:
    """Animate a mechanism in the plane or in space.

    Parameters
    ----------
    solution : Solution
        The motion; it must have stored its states. A frame shows the kept step nearest in time.
    outline : callable, optional
        ``outline(q, params)`` gives the bodies at one configuration, q of shape (n,), as a list of
        polylines of shape (k, 2) or (k, 3); it sees ``params.name`` as a model's functions do. The
        last vertex of the first polyline leaves a trace of a second. Assemblies of
        :mod:`liouville.bodies` need none.
    path : path, optional
        Where to write the animation: ``.gif``, ``.mp4`` where ffmpeg is on the path, or ``.html``,
        the page of :func:`view`; not written by default.
    seconds : float, default 6
        How long the animation plays, in seconds.
    fps : int, default 25
        Frames per second.
    member : int, default 0
        Which member of an ensemble; a film of one that failed ends before.
    trace, up
        As those of :func:`view`.
    view : tuple of two float, default (-60, 20)
        Azimuth and elevation in degrees from which a mechanism in space is seen, without
        perspective.

    Returns
    -------
    FuncAnimation
        ``to_jshtml()`` shows it in a notebook.

    Raises
    ------
    AttributeError
        The solution has no positions.
    TypeError
        There is no outline, and the system is no assembly of bodies.
    ValueError
        There is no such member or body, or as :func:`check` does.
    FileNotFoundError, ImportError, RuntimeError
        As :func:`check` does, or ffmpeg fails.
    """
    if path is not None:
        check(path, ANIMATIONS)
    mpl = matplotlib("animation")
    scene = scene_of(solution, outline, member, POSES, trace, up)
    film = _Film(scene, max(2, round(seconds * fps)), fps, view)
    if path is not None and Path(path).suffix == ".html":
        from liouville.plot.page import view as page_of

        page_of(solution, outline, path, seconds=seconds, member=member, trace=trace, up=up)
    elif path is not None:
        # imported here, as it imports Pillow
        from liouville.plot.writing import write

        write(film.pictures, len(film.frames), Path(path), fps)
    shown: FuncAnimation = mpl.FuncAnimation(
        film.figure, film.draw, frames=len(film.frames), interval=1000 / fps, blit=False
    )
    if path is not None:
        vars(shown)["_draw_was_started"] = True  # it need not be shown as well
    return shown


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Lines of one colour, with gaps where a row is NaN.

    Attributes
    ----------
    points : ndarray, shape (k, m, 2)
        Places on the picture.
    depth : ndarray, shape (k,)
        How near they are.
    style : dict
        How they look.
    """

    points: Array
    depth: Array
    style: dict[str, Any]


class _Film:
    """A figure whose artists are made once and moved by each frame."""

    def __init__(self, scene: Scene, count: int, fps: int, view: tuple[float, float]) -> None:
        t, self.fps = scene.t, fps
        way = np.sign(t[-1] - t[0])
        times = np.linspace(t[0], t[-1], count)
        self.frames = np.searchsorted(way * (t[1:] + t[:-1]) / 2, way * times)
        self.t = t
        self.digits = max(0, 2 - int(np.floor(np.log10(abs(t[-1] - t[0]) or 1.0))))
        camera = _camera(scene, view)
        self.drawn = _drawn(scene, camera)
        self.traces = [path @ camera[:2].T for path in scene.traces]
        corners = scene.corners @ camera[:2].T
        self._layout(corners[np.isfinite(corners).all(axis=1)])

    def _layout(self, corners: Array) -> None:
        """Make the figure and its artists."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = 0.06 * max(*(high - low), 1e-12)
        width, height = high - low + 2 * margin
        scale = 5.0 / max(width, height)
        self.figure = blank(max(2.5, scale * width), max(2.5, scale * height) + 0.3)
        axes = self.figure.add_subplot(
            aspect="equal",
            xlim=(low[0] - margin, high[0] + margin),
            ylim=(low[1] - margin, high[1] + margin),
            xticks=[],
            yticks=[],
        )
        axes.axis("off")
        shown = colours(max(len(self.traces), 2))
        self.tails = [
            axes.plot([], [], color=shown[(k + 1) % len(shown)], lw=1.2, alpha=0.7)[0]
            for k in range(len(self.traces))
        ]
        self.lines = [axes.plot([], [], **own.style)[0] for own in self.drawn]
        self.clock = axes.text(0, 1.01, "t", transform=axes.transAxes, fontsize=9, color=GREY)
        self.draw(0)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # all frames have the layout of the first

    def draw(self, i: int) -> list[Any]:
        """Move the artists to a frame."""
        row = self.frames[i]
        for line, own in zip(self.lines, self.drawn, strict=True):
            line.set_data(own.points[row, :, 0], own.points[row, :, 1])
            line.set_zorder(2 + own.depth[row])
        recent = slice(self.frames[max(0, i - self.fps)], row + 1)
        for tail, path in zip(self.tails, self.traces, strict=True):
            tail.set_data(path[recent, 0], path[recent, 1])
        self.clock.set_text(f"t = {self.t[row]:.{self.digits}f}")
        return [*self.lines, *self.tails, self.clock]

    def pictures(self, rows: Sequence[int] | None = None) -> Iterator[Any]:
        """Yield all frames or some, each of shape (height, width, 4), until the next one is drawn.

        What stands still is drawn once.
        """
        agg = matplotlib("backends.backend_agg")
        self.figure.dpi = DPI
        canvas = agg.FigureCanvasAgg(self.figure)
        artists = self.draw(0)
        for artist in artists:
            artist.set_visible(False)
        canvas.draw()
        still = canvas.copy_from_bbox(self.figure.bbox)
        for artist in artists:
            artist.set_visible(True)
        for i in range(len(self.frames)) if rows is None else rows:
            canvas.restore_region(still)
            for artist in sorted(self.draw(i), key=lambda artist: artist.get_zorder()):
                artist.draw(canvas.renderer)
            yield np.asarray(canvas.buffer_rgba())


def _camera(scene: Scene, view: tuple[float, float]) -> Array:
    """Return the directions to the right, up and towards the eye, as rows."""
    if scene.is_planar:
        return np.eye(3)
    azimuth, elevation = np.radians(view)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    eye = np.array([*(np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])), 0.0])
    eye[2] = np.sin(elevation)
    own = np.array([right, np.cross(eye, right), eye])
    back = rot.conjugate(rot.between(np.array(scene.up), np.array([0.0, 0.0, 1.0])))
    return np.stack(rot.rotate(back, own.T), axis=1)


def _drawn(scene: Scene, camera: Array) -> list[_Drawn]:
    """Return the curves of a scene, each body once."""
    found = []
    main = {"lw": 2.5, "ms": 4, "mfc": "white", "mew": 1.2}
    for line, colour in zip(scene.lines, colours(len(scene.lines)), strict=True):
        found.append(_seen([line], camera, {**main, "color": colour, "marker": "o"}))
    bodies = len(scene.names) if not scene.lines else 0
    shades = [*colours(bodies), GREY] if bodies else []
    for body, colour in enumerate(shades):
        own = [part for part in scene.parts if part.body == body]
        for role, style in (
            ("inertia", {"lw": 0.7, "alpha": 0.55}),
            ("line", {"lw": 2.5}),
            ("wheel", {"lw": 2.0}),
            ("shape", {"lw": 1.5}),
            ("plane", {"lw": 1.0}),
            ("joint", {"ls": "", "marker": "o", "ms": 4, "mfc": "white", "mew": 1.2}),
        ):
            parts = [scene.placed(body, part.corners) for part in own if part.role == role]
            if parts:
                found.append(_seen(parts, camera, {**style, "color": colour}))
    for a, first, b, second in scene.springs:
        ends = np.concatenate([scene.placed(a, [first]), scene.placed(b, [second])], axis=1)
        found.append(_seen([ends], camera, {"color": GREY, "lw": 1.2}))
    return found


def _seen(parts: list[Array], camera: Array, style: dict[str, Any]) -> _Drawn:
    """Return polylines, each of shape (k, m, 3), as one with gaps on the picture."""
    gap = np.full((len(parts[0]), 1, 3), np.nan)
    joined = np.concatenate([x for part in parts for x in (part, gap)][:-1], axis=1) @ camera.T
    depth = np.nanmean(joined[..., 2], axis=1)
    span = np.ptp(depth) or 1.0
    return _Drawn(joined[..., :2], (depth - depth.min()) / span, style)
