"""Numerical damping of the alpha methods: one step's amplification matrix, measured and known.

On q'' = -omega^2 q a step maps (q, h v, h^2 a) by a 3 by 3 matrix that depends on W = omega h
alone. It is measured by steps from three starts. Printed are the spectral radius at W = 1000 beside
its limit, and the damping ratio at W = 0.1 beside its leading term; the figure shows both over all
frequencies, lines for what is known, dotted the leading term, and dots for what is measured.

Run as ``python benchmarks/damping.py [figure]``; the figure goes to build/measured by default.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from report import FOLDER, show

import liouville as lv
from liouville.plot import STYLE

METHODS = [
    *(lv.HHT(alpha) for alpha in (0.0, -0.05, -0.1, -0.2, -0.3, -1 / 3)),
    *(lv.GeneralizedAlpha(rho) for rho in (0.9, 0.8, 0.5, 0.0)),
]
DRAWN = [METHODS[k] for k in (1, 2, 4, 7, 8, 9)]
SLOW, FAST = 0.1, 1e3

OSCILLATOR = lv.Lagrangian(
    lambda t, q, v, params: (ca.dot(v, v) - params.w**2 * ca.dot(q, q)) / 2,
    q=("x",),
    params={"w": 1.0},
)


def measured(method, w):
    """Return the matrix whose columns are steps of size 1 from unit starts."""
    columns = []
    for q, v, a in np.eye(3):
        start = {"q": [q], "v": [v], "a": [a]}
        end = lv.integrate(OSCILLATOR, method, t=(0.0, 1.0), steps=1, params={"w": w}, **start)
        columns.append([end.q[-1, 0], end.v[-1, 0], end.a[-1, 0]])
    return np.array(columns).T


def known(method, w):
    """Return the matrix by its definition."""
    am, af, gamma, beta = method.coefficients
    left = [[1, 0, -beta], [0, 1, -gamma], [(1 - af) * w**2, 0, 1 - am]]
    right = [[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-af * w**2, 0, -am]]
    return np.linalg.solve(left, right)


def radius(matrix):
    return np.abs(np.linalg.eigvals(matrix)).max()


def damping_ratio(matrix):
    """Return the damping ratio of an oscillator that decays as the step's oscillation does."""
    value = max(np.linalg.eigvals(matrix), key=np.imag)
    return -np.log(np.abs(value)) / np.abs(np.log(value))


def limit(method):
    """Return the spectral radius at infinite frequency."""
    if isinstance(method, lv.GeneralizedAlpha):
        return float(method.rho)
    return (1 + method.alpha) / (1 - method.alpha)


def leading(method):
    """Return the factor of W^3 in the damping ratio of slow oscillations."""
    am, af, *_ = method.coefficients
    return (af - am) * (1 - am - af) ** 2 / 8


def name(method):
    if isinstance(method, lv.GeneralizedAlpha):
        return f"GeneralizedAlpha({method.rho:g})"
    return f"HHT({method.alpha:.3g})"


def row(method):
    return {
        "method": name(method),
        "radius": round(float(radius(measured(method, FAST))), 4),
        "its limit": round(limit(method), 4),
        "damping ratio": round(float(damping_ratio(measured(method, SLOW))), 8),
        "leading term": round(leading(method) * SLOW**3, 8),
    }


def draw(path):
    style.use(STYLE)
    figure = Figure(figsize=(8, 3.8))
    left, right = figure.subplots(1, 2)
    lines, dots = np.logspace(-1.5, 3, 400), np.logspace(-1.5, 3, 28)
    slow, slow_dots = lines[lines < 2], dots[dots < 2]
    for method in DRAWN:
        (line,) = left.semilogx(lines, [radius(known(method, w)) for w in lines], lw=1)
        left.plot(
            dots, [radius(measured(method, w)) for w in dots], ".", ms=4, color=line.get_color()
        )
        color = {"color": line.get_color()}
        right.loglog(slow, [damping_ratio(known(method, w)) for w in slow], lw=1, **color)
        right.plot(slow, leading(method) * slow**3, ":", lw=0.8, **color)
        ratios = [damping_ratio(measured(method, w)) for w in slow_dots]
        right.plot(slow_dots, ratios, ".", ms=4, label=name(method), **color)
    left.set(xlabel=r"$\omega h$", ylabel="spectral radius", ylim=(0, 1.05))
    right.set(xlabel=r"$\omega h$", ylabel="damping ratio")
    figure.legend(ncols=3, loc="outside upper left")
    figure.savefig(path, dpi=150)


def main():
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER / "damping.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    show([row(method) for method in METHODS])
    draw(path)
    print(f"figure in {path}")


if __name__ == "__main__":
    main()
