"""Draw docs/_static/film.gif: a mechanism, a stirred fluid and a wave, side by side.

Run as ``python tools/film.py [path]``. Left is Andrews' squeezing mechanism; the middle is a disc
of dye in a vortex that is shaken, the area of which every step preserves; right is a packet
on a lattice that meets a wall with two slits.
"""

import sys
from types import SimpleNamespace

import casadi as ca
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import liouville as lv
from liouville.plot import COLOURS
from liouville.problems import andrews

FRAMES, SECONDS = 64, 6.0
SITES = 120


def mechanism():
    """Return the polylines of the mechanism at each frame."""
    start, end = andrews.interval
    solution = lv.integrate(
        andrews.system,
        lv.Spark(stages=4),
        t=(start, end),
        h=andrews.h,
        t_eval=np.linspace(start, end, FRAMES),
        **andrews.start,
    )
    params = SimpleNamespace(**solution.params)
    return [andrews.outline(q, params) for q in solution.q]


def dye():
    """Return the edge of the disc at each frame, (frames, points, 2)."""
    field = lv.PolynomialField(
        lambda t, x, params: [ca.sin(x[1]) + 0.2 * ca.cos(t), -ca.sin(x[0])], x=("x", "y")
    )
    angle = np.linspace(0, 2 * np.pi, 4000)
    disc = np.column_stack([0.8 + 0.8 * np.cos(angle), 0.8 * np.sin(angle)])
    every = 6
    return lv.ensemble(
        field, lv.VolumeSplitting(), t=(0, 30), steps=(FRAMES - 1) * every, every=every, x=disc
    ).x


def wave():
    """Return the density of the packet at each frame, and where the wall is."""
    i, j = np.indices((SITES, SITES))
    slits = (abs(j - SITES / 2 + 8) < 3) | (abs(j - SITES / 2 - 8) < 3)
    wall = (abs(i - 55) < 2) & ~slits
    packet = np.exp(-((i - 30) ** 2) / 120 - (j - SITES / 2) ** 2 / 500 + 0.9j * i)
    lattice = lv.Schrodinger(lv.Lattice((SITES, SITES), potential=20.0 * wall))
    solution = lv.integrate(
        lattice, lv.SchrodingerSplitting(tol=1e-4), t=np.linspace(0, 38, FRAMES), psi=packet
    )
    return np.abs(solution.psi.reshape(FRAMES, SITES, SITES)) ** 2, wall


def main(path="docs/_static/film.gif"):
    """Draw all frames and write them to a file."""
    bodies, edges, (density, wall) = mechanism(), dye(), wave()
    figure = Figure(figsize=(8.4, 3.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    left, middle, right = (figure.add_axes((x, 0.02, 0.325, 0.87)) for x in (0.005, 0.337, 0.67))
    levels = density[0].max() * np.geomspace(0.003, 0.7, 8)
    corners = np.concatenate([line for shape in bodies for line in shape])
    images = []
    for k in range(FRAMES):
        for ax, title in ((left, "mechanisms"), (middle, "flows"), (right, "waves")):
            ax.clear()
            ax.set(xticks=[], yticks=[], aspect="equal")
            ax.set_title(title, fontsize=12, color="0.25")
            ax.spines[:].set_color("0.8")
        for line, colour in zip(bodies[k], COLOURS, strict=False):
            left.plot(*np.transpose(line), color=colour, lw=3, marker="o", ms=4, mfc="white")
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle_of, half = (low + high) / 2, 0.56 * (high - low).max()
        left.set(
            xlim=(middle_of[0] - half, middle_of[0] + half),
            ylim=(middle_of[1] - half, middle_of[1] + half),
        )
        middle.fill(*edges[k].T, facecolor=COLOURS[0], edgecolor=COLOURS[0], lw=0.4)
        middle.set(xlim=(-3.2, 3.2), ylim=(-3.2, 3.2))
        right.contourf(density[k].T, levels=levels, cmap="Blues", extend="max")
        right.contourf(wall.T, levels=[0.5, 2], colors=["0.3"])
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    palette = images[FRAMES // 2].quantize(28, dither=Image.Dither.NONE)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * SECONDS / FRAMES),
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
