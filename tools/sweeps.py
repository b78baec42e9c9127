"""Write the pages behind the sliders of docs/sliders.md: runs made beforehand, one for each value.

Run as ``python tools/sweeps.py FOLDER``; the documentation does so when it is built. A page needs
nothing else: it has the runs of one problem in 16-bit numbers, and plays the run of its slider.
"""

import base64
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

import liouville as lv

PAGE = Path(__file__).with_name("sweep.html")
FRAMES = 48


@dataclass(frozen=True)
class Sweep:
    """Runs of one problem, a run for each value of a parameter.

    Attributes
    ----------
    title, slider, unit : str
        Words of the page: the problem, the parameter and its unit.
    draw : {"rod", "area", "curve"}
        A polyline from the origin, a filled outline, or a curve.
    box : float
        The largest coordinate that is seen.
    values : ndarray, shape (V,)
        The values of the parameter.
    points : ndarray, shape (V, F, P, 2)
        The drawing at each frame.
    notes : list of str
        A sentence on each run.
    """

    title: str
    slider: str
    unit: str
    draw: str
    box: float
    values: np.ndarray
    points: np.ndarray
    notes: list[str]


def pendulum():
    """Return swings of a pendulum from several angles."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - 1},
        q=("x", "y"),
    )

    def spin(t, q, v, lam, params):
        return q[0] * v[1] - q[1] * v[0]

    values = np.arange(10, 180, 10)
    points, notes = [], []
    for angle in np.radians(values):
        start = {"q": [np.sin(angle), -np.cos(angle)], "v": [0, 0]}
        events = {"turn": lv.Event(spin, terminal=2)}
        swing = lv.integrate(system, lv.Spark(6), t=(0, 20), h=0.02, events=events, **start)
        run = lv.integrate(system, lv.Spark(6), t=(0, 6), steps=240, **start)
        points.append(np.stack([np.zeros_like(run.q), run.q], axis=1))
        drift = np.ptp(run.invariants["energy"])
        notes.append(
            f"There and back takes {swing.t[-1]:.4f} s; the energy changes by {drift:.0e} J."
        )
    return Sweep("A pendulum", "start angle", "°", "rod", 1.1, values, np.array(points), notes)


def flow():
    """Return discs of dye in a vortex that is shaken by several amounts."""
    field = lv.PolynomialField(
        lambda t, x, params: [ca.sin(x[1]) + params.a * ca.cos(t), -ca.sin(x[0])],
        x=("x", "y"),
        params={"a": 0.2},
    )
    angle = np.linspace(0, 2 * np.pi, 320, endpoint=False)
    disc = np.column_stack([1.5 + 0.8 * np.cos(angle), 0.8 * np.sin(angle)])
    values = np.round(np.linspace(0, 0.3, 7), 2)
    points, notes = [], []
    for a in values:
        run = lv.ensemble(
            field,
            lv.VolumeSplitting(),
            t=(0, 10),
            steps=6 * (FRAMES - 1),
            every=6,
            params={"a": a},
            x=disc,
        )
        edge = np.linalg.norm(run.x - np.roll(run.x, 1, axis=1), axis=2).sum(axis=1)
        points.append(run.x)
        notes.append(
            f"The edge becomes {edge[-1] / edge[0]:.1f} times as long; the area stays the same."
        )
    return Sweep("Dye in a vortex", "shaking", "", "area", 3.0, values, np.array(points), notes)


def wave():
    """Return packets that meet barriers of several heights."""
    grid = lv.Grid(-40, 40, 256, potential=lambda t, x, params: params.V * ca.exp(-(x**2) / 2))
    system = lv.Schrodinger(grid, params={"V": 1.0})
    x = grid.points[:, 0]
    psi = np.exp(-((x + 14) ** 2) / 32 + 1.5j * x)
    psi /= np.linalg.norm(psi)
    values = np.round(np.linspace(0, 2.25, 10), 2)
    points, notes = [], []
    for height in values:
        run = lv.integrate(
            system,
            lv.SchrodingerSplitting(tol=1e-6),
            t=np.linspace(0, 20, FRAMES),
            psi=psi,
            params={"V": height},
            observe={"beyond": (x > 0).astype(float)},
        )
        density = np.abs(run.psi) ** 2 / grid.cell
        curve = np.stack([np.broadcast_to(x / 40, density.shape), 5.5 * density - 0.9], axis=2)
        points.append(curve[:, ::2])
        passed = 100 * run.observed["beyond"][-1]
        notes.append(f"{passed:.1f} % of the packet, whose energy is about 1.1, passes.")
    return Sweep("A wave at a barrier", "height", "", "curve", 1.0, values, np.array(points), notes)


SWEEPS = {"pendulum": pendulum, "flow": flow, "wave": wave}


def page_of(sweep):
    """Return the page of a sweep, in HTML."""
    size = np.abs(sweep.points).max()
    numbers = np.rint(sweep.points / size * 32767).astype("<i2")
    words = {name: getattr(sweep, name) for name in ("title", "slider", "unit", "draw", "notes")}
    data = words | {
        "values": sweep.values.tolist(),
        "shape": numbers.shape,
        "scale": float(size / sweep.box),
        "points": base64.b64encode(numbers.tobytes()).decode(),
    }
    page = PAGE.read_text(encoding="utf-8").replace("TITLE", sweep.title)
    return page.replace("DATA", json.dumps(data, ensure_ascii=False))


def main(folder):
    """Write the page of each sweep to a folder."""
    for name, make in SWEEPS.items():
        Path(folder, f"sweep_{name}.html").write_text(page_of(make()), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
