"""What tolerances of fields come to: errors, steps, and the trial runs that find them.

For each field and tolerance the error at the end against steps of order eight that are far
shorter, in units of the tolerance, the equal steps that were chosen, and those of all trial runs
over them. Then how far members with parameters of their own are from runs alone by the same plan,
products of stretchings over a finite time from one, and points of a section at times from states.
"""

import casadi as ca
import numpy as np
from report import publish

import liouville as lv
from liouville import problems

#: Fields of the library, and over how much time.
SPANS = {"abc_flow": 20.0, "euler_top": 50.0, "hill_vortex": 20.0, "lorenz96": 5.0}
TOLERANCES = (1e-4, 1e-8)


def gyre():
    """Return a steady gyre between walls, on a grid, and a start."""
    x, y = np.linspace(0, 2, 65), np.linspace(0, 1, 33)
    psi = -0.1 * np.outer(np.sin(np.pi * x), np.sin(np.pi * y))
    return lv.GriddedField(x, y, potential=psi, walls=("x", "y"), degree=5), [0.3, 0.4]


def pulse():
    """Return an oscillator that a wave in time drives, and a start."""
    return lv.PolynomialField(lambda t, x, p: [x[1], -x[0] + 0.2 * ca.cos(2 * t)], x=2), [1.0, 0.0]


def row(name, field, x, span):
    """Return the errors, steps and trial runs of each tolerance."""
    finest = lv.VolumeSplitting(composition="BM6" if name == "gyre" else "SS8s21")
    count = 4000
    wanted = lv.integrate(field, finest, t=(0.0, span), steps=count, every=count, x=x).x[-1]
    cells = {"field": name.replace("_", " ")}
    for rtol in TOLERANCES:
        run = {"t": (0.0, span), "every": 10**6, "x": x}
        found = lv.integrate(field, lv.VolumeSplitting(), rtol=rtol, **run)
        off = (found.x[-1] - wanted) / (rtol / 1000 + rtol * np.abs(wanted))
        steps = found.stats["steps"]
        made = int(found.message.split("trial runs of ")[1].split()[0])
        cells[f"error / {rtol:.0e}"] = f"{np.sqrt(np.mean(off**2)):.2f}"
        cells |= {f"steps to {rtol:.0e}": steps, f"trials to {rtol:.0e}": f"{made / steps:.1f}"}
    return cells


def members():
    """Print how far members with parameters of their own are from their runs alone."""
    flow, rng = problems.load("abc_flow"), np.random.default_rng(0)
    x, a = rng.uniform(0, 6, (8, 3)), np.linspace(0.5, 1.5, 8)
    run = {"t": (0.0, 20.0), "h": 0.1}
    method = lv.plan(flow.system, lv.VolumeSplitting(), h=0.1, **flow.start)
    many = lv.ensemble(flow.system, method, x=x, params={"A": a}, **run)
    far = 0.0
    for k in range(8):
        one = lv.integrate(flow.system, method, x=x[k], params={"A": a[k]}, **run)
        far = max(far, float(np.abs(one.x - many.x[:, k]).max()))
    print(f"eight members of the ABC flow, each with its A: {far:.1e} from runs alone")


def stretchings():
    """Print by how much the product of stretchings over a finite time is off one."""
    flow, rng = problems.load("abc_flow"), np.random.default_rng(0)
    found = lv.ensemble(
        flow.system, lv.VolumeSplitting(composition="BM4"), t=(0.0, 8.0), h=0.1, every=80,
        x=rng.uniform(0, 6, (200, 3)), tangents={"x": np.eye(3)},
    )  # fmt: skip
    derivative = found.tangents["x"].x[-1]
    values = np.linalg.svd(derivative, compute_uv=False)
    print(
        f"200 finite-time exponents from {np.log(values[:, 0]).min() / 8:.3f} to "
        f"{np.log(values[:, 0]).max() / 8:.3f}; products of stretchings are "
        f"{np.abs(values.prod(axis=1) - 1).max():.0e} from 1"
    )


def section():
    """Print how far the points of a section at times are from the states of steps to there."""
    flow, rng = problems.load("abc_flow"), np.random.default_rng(0)
    method, x, end = lv.VolumeSplitting(composition="BM4"), rng.uniform(0, 6, (8, 3)), 40 * np.pi
    found = lv.section(flow.system, method, t=(0.0, end), h=0.1, plane="t", period=2 * np.pi, x=x)
    kept = lv.ensemble(flow.system, method, t=(0.0, end), steps=1260, every=63, x=x)
    far = max(
        float(np.abs(found.x[found.member == k][-20:] - kept.x[1:, k]).max()) for k in range(8)
    )
    print(f"a section of eight trajectories at 20 times: {far:.1e} from states kept there")


if __name__ == "__main__":
    rows = [
        row(name, problems.load(name).system, problems.load(name).start["x"], span)
        for name, span in SPANS.items()
    ]
    rows += [row("gyre", *gyre(), 50.0), row("driven oscillator", *pulse(), 50.0)]
    publish("field_tolerance", rows)
    members()
    stretchings()
    section()
