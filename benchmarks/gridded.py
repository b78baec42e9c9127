"""Gridded fields beside the classical Runge-Kutta method on the same spline.

In the plane: a steady stream function of 12 waves on 64^2 nodes, with RK4 in Numba.
Short runs: root mean square errors of tracers in a field of 40 waves on 32^3 nodes, and what they
cost in microseconds a tracer. A step of RK4 is four evaluations of the velocity by the same core,
of two contractions each: what a potential without its third component would take.
Long runs: how far the stream function of a steady gyre has drifted in the first, the middle and the
last twentieth of the time.
"""

import argparse
import time

import numpy as np
from peers import spline
from report import publish

import liouville as lv

V = lv.VolumeSplitting


def waves(points, count=40, seed=0):
    """Return a vector potential of waves, and its curl, with a speed of 1.5."""
    rng = np.random.default_rng(seed)
    a, v = np.zeros((2, 3, *points.shape[1:]))
    square = 0.0
    for _ in range(count):
        k, phase, b = rng.integers(-3, 4, 3), rng.uniform(0, 2 * np.pi), rng.normal(size=3)
        angle = np.tensordot(k, points, 1) + phase
        a += np.multiply.outer(b, np.cos(angle))
        v -= np.multiply.outer(np.cross(k, b), np.sin(angle))
        square += np.sum(np.cross(k, b) ** 2) / 2
    return 1.5 / np.sqrt(square) * a, 1.5 / np.sqrt(square) * v


def rk4(velocity, x, h, steps):
    for _ in range(steps):
        k1 = velocity(x)
        k2 = velocity(x + h / 2 * k1)
        k3 = velocity(x + h / 2 * k2)
        k4 = velocity(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def least(call, repeats):
    """Return the least processor time of a call in microseconds, and its value."""
    times = []
    for _ in range(repeats):
        begun = time.process_time()
        value = call()
        times.append(time.process_time() - begun)
    return min(times) * 1e6, value


def short(repeats):
    nodes = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    potential, _ = waves(np.array(np.meshgrid(nodes, nodes, nodes, indexing="ij")))
    field = lv.GriddedField(
        nodes, nodes, nodes, potential=potential, periodic=("x", "y", "z"), degree=5
    )
    x, t = np.random.default_rng(1).uniform(0, 6, (64, 3)), 5.0
    plane, order = field.planes[0]
    rows = np.ascontiguousarray(np.tile(x, (200, 1))[:, order])
    each = least(lambda: plane.sample(rows), repeats)[0] / len(rows)
    exact = lv.ensemble(field, V(composition="BM6"), t=(0, t), steps=1600, every=1600, x=x).x[-1]
    print("64 tracers, T = 5, p = 5, gauge of Coulomb")
    rows = []

    def kept(method, steps, error, cost):
        cells = {"error": f"{error:.1e}", "µs a tracer": round(cost)}
        rows.append({"method": method, "steps": steps, **cells})

    for steps in (50, 100, 200, 400, 800):
        end = rk4(field.velocity, x, t / steps, steps)
        error = np.sqrt(np.mean(np.sum((end - exact) ** 2, axis=1)))
        kept("RK4", steps, error, 4 * 2 * each * steps)
    for scheme in ("BM4", "BM6"):
        for steps in (50, 100, 200):
            method = V(composition=scheme)
            cost, run = least(
                lambda m=method, n=steps: lv.ensemble(
                    field, m, t=(0, t), steps=n, every=n, x=x, threads=1
                ),
                repeats,
            )
            error = np.sqrt(np.mean(np.sum((run.x[-1] - exact) ** 2, axis=1)))
            kept(scheme, steps, error, cost / len(x))
    publish("gridded", rows)


def plane(repeats):
    nodes = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rng, psi, square = np.random.default_rng(0), np.zeros((64, 64)), 0.0
    for _ in range(12):
        k, phase, b = rng.integers(-3, 4, 2), rng.uniform(0, 2 * np.pi), rng.normal()
        psi += b * np.cos(np.add.outer(k[0] * nodes, k[1] * nodes) + phase)
        square += b**2 * (k @ k) / 2
    psi /= np.sqrt(square)
    field = lv.GriddedField(nodes, nodes, potential=psi, periodic=("x", "y"))
    c, t = spline.coefficients(psi), 5.0
    x = rng.uniform(0, 2 * np.pi, (512, 2))
    exact = spline.rk4(c, x, t, 20000)
    print("method steps error microseconds (512 tracers in the plane, T = 5, p = 3)")

    def told(name, steps, run):
        cost, end = least(run, repeats)
        error = np.sqrt(np.mean(np.sum((end - exact) ** 2, axis=1)))
        print(f"{name} {steps:5d} {error:8.1e} {cost / len(x):8.1f}", flush=True)

    for steps in (100, 200, 400, 800):
        told("RK4 in Numba", steps, lambda n=steps: spline.rk4(c, x, t, n))
    for scheme, each in (("BM4", (60, 120, 240)), ("BM6", (60, 120, 240))):
        for steps in each:
            given = {"t": (0, t), "steps": steps, "every": steps, "x": x, "threads": 1}
            told(
                scheme,
                steps,
                lambda s=scheme, g=given: lv.ensemble(field, V(composition=s), **g).x[-1],
            )


def long(end):
    x, y = np.linspace(0, 2, 65), np.linspace(0, 1, 33)
    psi = -0.1 * np.sin(np.pi * x)[:, None] * np.sin(np.pi * y)
    field = lv.GriddedField(x, y, potential=psi, walls=("x", "y"))
    start = np.array([[0.3, 0.4], [1.2, 0.7], [0.5, 0.2], [1.7, 0.5]])
    print(
        f"steady gyre, T = {end:g}: largest change of psi in the first, middle and last twentieth"
    )

    def told(name, drift):
        cut = len(drift) // 20
        middle = slice(len(drift) // 2 - cut // 2, len(drift) // 2 + cut // 2)
        parts = drift[:cut], drift[middle], drift[-cut:]
        print(name, *(f"{part.max():.1e}" for part in parts), flush=True)

    for scheme in ("BM4", "S2"):
        run = lv.ensemble(field, V(composition=scheme), t=(0, end), h=0.5, every=10, x=start)
        told(scheme, abs(field.potential(run.x) - field.potential(start)))
    now, drift = start, []
    for _ in range(int(end / 5)):
        now = rk4(field.velocity, now, 0.125, 40)
        drift.append(abs(field.potential(now) - field.potential(start)))
    told("RK4, h / 4", np.array(drift))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--end", type=float, default=5e3)
    given = parser.parse_args()
    plane(given.repeats)
    short(given.repeats)
    long(given.end)
