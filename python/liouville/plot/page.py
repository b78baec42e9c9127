"""Pages with a moving mechanism that turns under the mouse."""

from __future__ import annotations

import base64
import json
import os
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from liouville._solution.solution import Array, Solution
from liouville.plot.parts import Part
from liouville.plot.scene import Outline, Scene, Trace, scene_of
from liouville.plot.shapes import LEAST, LINE
from liouville.plot.thinning import thinned

#: A page has no more frames than this, and no more numbers in all of them.
FRAMES, NUMBERS = 2000, 300_000

#: The height of a view in a notebook, in pixels.
HEIGHT = 420

#: A motion that takes longer or shorter than this in its own seconds is played in so many.
LONGEST, SHORTEST, PLAYED = 30.0, 2.0, 8.0

#: Azimuth and elevation in radians from which it is seen first, in the plane and in space.
VIEWS = {True: (-np.pi / 2, 0.0), False: (-np.pi / 3, 0.35)}

VIEWER = Path(__file__).with_name("viewer")


@dataclass(frozen=True, eq=False)
class View:
    """A page with a moving mechanism, by :func:`view`; a notebook shows it.

    Attributes
    ----------
    page : str
        The page, in HTML.
    """

    page: str

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file, which needs nothing else.

        Raises
        ------
        ValueError
            The name does not end in ``.html``.
        """
        if Path(path).suffix != ".html":
            raise ValueError(f"cannot write a page to {str(path)!r}\nhint: end its name in .html")
        Path(path).write_text(self.page, encoding="utf-8")

    def __repr__(self) -> str:
        """Say how large it is."""
        return f"<View of {len(self.page) / 1e6:.2f} MB; save('motion.html') writes it>"

    def _repr_html_(self) -> str:
        """Show the page in a notebook, in a frame."""
        style = f"width:100%;height:{HEIGHT}px;border:1px solid #8884;box-sizing:border-box"
        return (
            f'<iframe srcdoc="{escape(self.page)}" style="{style}" '
            'sandbox="allow-scripts" title="a moving mechanism"></iframe>'
        )


def view(
    solution: Solution,
    outline: Outline | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    seconds: float | None = None,
    member: int = 0,
    trace: Trace | None = None,
    up: str | None = None,
) -> View:
    """Show a moving mechanism in space, on a page that turns under the mouse.

    The page is one file without links, which needs neither a server nor a network. Dragging turns
    the view, with the right button or shift it shifts it, the wheel or two fingers zoom, a double
    click goes back. A body of an assembly shows the box that has its mass and inertia if it is
    uniform, its centre of mass and lines between its joints; joints show their axes, and what
    touches its shapes.

    Parameters
    ----------
    solution : Solution
        The motion; it must have stored its states. Between the kept steps, of which very many are
        thinned, places are interpolated linearly.
    outline : callable, optional
        ``outline(q, params)`` gives the bodies at one configuration, q of shape (n,), as a list of
        polylines of shape (k, 2) or (k, 3), as that of :func:`animation`. Assemblies of
        :mod:`liouville.bodies` need none.
    path : path, optional
        Where to write the page, as ``.html``; not written by default.
    seconds : float, optional
        How long the motion plays at speed 1; as long as it takes by default, in seconds, and 8 if
        that is shorter than 2 or longer than 30.
    member : int, default 0
        Which member of an ensemble.
    trace : str, sequence of str or mapping, optional
        Bodies of an assembly whose centres leave a trace, or points in their axes by body. Of an
        outline it is the last vertex of the first polyline.
    up : str, optional
        The axis that is up, ``"x"``, ``"y"`` or ``"z"``; by default against the gravity of an
        assembly, y in the plane and z in space.

    Returns
    -------
    View
        A notebook shows it; `save` writes it.

    Raises
    ------
    AttributeError
        The solution has no positions.
    TypeError
        There is no outline, and the system is no assembly of bodies.
    ValueError
        There is no such member or body, or no motion; an outline has no such lines.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville import plot
    >>> from liouville.problems import pendulum
    >>> swing = lv.integrate(pendulum.system, lv.Spark(3), t=(0, 4), h=0.05, **pendulum.start)
    >>> plot.view(swing, pendulum.outline)
    <View of 0.03 MB; save('motion.html') writes it>
    """
    scene = scene_of(solution, outline, member, FRAMES, trace, up)
    motion = _motion(scene, seconds, solution.units.get("t", ""))
    found = View(_page(motion, "a moving mechanism"))
    if path is not None:
        found.save(path)
    return found


def _motion(scene: Scene, seconds: float | None, unit: str) -> dict[str, Any]:
    """Return the data of a motion for the page."""
    points = np.concatenate([np.empty((len(scene.t), 0, 3)), *scene.lines], axis=1)
    width = scene.poses[0].size + points[0].size + 3 * len(scene.traces)
    rows = thinned(len(scene.t), max(2, NUMBERS // width))
    sizes = [line.shape[1] for line in scene.lines]
    starts = np.cumsum([0, *sizes])[:-1].tolist()
    t, corners = scene.t[rows], scene.corners
    low, high = corners.min(axis=0), corners.max(axis=0)
    span = float(abs(t[-1] - t[0]))
    lasting = span if SHORTEST <= span <= LONGEST else PLAYED
    radius = max(float(np.linalg.norm(high - low)) / 2, LEAST)
    return {
        "names": scene.names if not scene.lines else (),
        "t": _packed(t, "<f8"),
        "poses": _packed(scene.poses[rows], "<f4"),
        "points": _packed(points[rows], "<f4"),
        "count": points.shape[1],
        "lines": list(zip(starts, sizes, strict=True)),
        "traces": [_packed(path[rows], "<f4") for path in scene.traces],
        "parts": [_plain(part) for part in scene.parts],
        "springs": [(a, _row(x), b, _row(y)) for a, x, b, y in scene.springs],
        "thick": 2 * LINE * radius,
        "up": scene.up,
        "centre": _row((low + high) / 2),
        "radius": radius,
        "floor": float((corners @ np.array(scene.up)).min()),
        "view": VIEWS[scene.is_planar],
        "seconds": lasting if seconds is None else float(seconds),
        "digits": max(0, 2 - int(np.floor(np.log10(span or 1.0)))),
        "unit": f" {unit}" if unit else "",
    }


def _packed(values: Array, kind: str) -> str:
    """Return numbers in base 64, the first byte of each the lowest."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def _row(values: Array) -> list[float]:
    """Return numbers in as many digits as are seen."""
    return [float(f"{x:.7g}") for x in values]


def _plain(part: Part) -> dict[str, Any]:
    rows = {name: _row(getattr(part, name)) for name in ("at", "turn", "size")}
    return {"role": part.role, "mesh": part.mesh, "body": part.body, **rows}


@cache
def _template() -> str:
    """Return the page with its code and without its motion."""
    page = (VIEWER / "page.html").read_text(encoding="utf-8")
    files = (VIEWER / f"{name}.js" for name in ("motion", "painter", "controls"))
    return page.replace("CODE\n", "\n".join(file.read_text(encoding="utf-8") for file in files))


def _page(motion: dict[str, Any], title: str) -> str:
    data = json.dumps(motion, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return _template().replace("TITLE", escape(title)).replace("MOTION", data)
