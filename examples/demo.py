"""Integrate two mechanisms of the literature and compare them with their references.

Andrews' squeezing mechanism, seven bodies in three closed loops, and the car axis, whose right foot
follows a bumpy road; both are index-3 problems of the IVP Test Set. The script prints the distance
of the end state from the quadruple-precision reference; the figure shows the motion and the
residuals of the conserved quantities, and a page beside it has the first mechanism in motion.

Run as ``python examples/demo.py [figure]``; the figure goes to build/demo.png by default.
"""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

import liouville as lv
from liouville import plot, problems

METHOD = lv.Spark(stages=4)
LABELS = {"constraint": "constraints", "hidden": "their time derivatives"}
TITLES = {"andrews": "Andrews' squeezing mechanism", "car_axis": "car axis"}


def integrate(problem):
    """Integrate a problem and return the solution and its errors at the end."""
    solution = lv.integrate(
        problem.system, METHOD, t=problem.interval, h=problem.h, **problem.start
    )
    reference = problem.reference[problem.interval[1]]
    errors = {
        state: np.max(np.abs(getattr(solution, state)[-1] - values))
        / np.max(np.abs(values))
        for state, values in reference.items()
    }
    return solution, errors


def draw_motion(ax, problem, solution, frames=12):
    """Draw the mechanism at a few times, from light to dark."""
    params = SimpleNamespace(**solution.params)
    at = np.linspace(0, len(solution.t) - 1, frames).round().astype(int)
    for i, shade in zip(
        at, colormaps["Blues"](np.linspace(0.25, 1, frames)), strict=True
    ):
        for line in problem.outline(solution.q[i], params):
            ax.plot(*line.T, color=shade, lw=1.2, solid_capstyle="round")
    ax.set_aspect("equal", adjustable="datalim")


def draw_kept(ax, solution, conserved):
    """Draw the residuals of the constraints and the drift of the conserved quantities."""
    sizes = {
        name: np.abs(values).max(axis=1) for name, values in solution.residuals.items()
    }
    sizes |= {name: solution.invariant_drift(name) for name in conserved}
    for (name, size), colour in zip(sizes.items(), plot.COLOURS, strict=False):
        label = LABELS.get(name, name)
        ax.semilogy(
            solution.t, np.maximum(size, plot.FLOOR), ".", ms=2, color=colour, label=label
        )
    ax.set_ylim(plot.FLOOR / 3, 1e-9)
    ax.set_xlabel("time $t$", fontsize=9)
    ax.set_ylabel("deviation (energy: relative)", fontsize=9)
    ax.legend(loc="upper left", markerscale=5, frameon=False, fontsize=8)


def main(path):
    figure = Figure(figsize=(10.5, 5.8), layout="constrained")
    rows = figure.subplots(2, 3)
    print(
        f"{METHOD}\n{'':12}{'h':>9}{'steps':>7}{'error in q':>12}{'error in v':>12}{'ms':>8}"
    )
    page = Path(path).with_suffix(".html")
    page.parent.mkdir(parents=True, exist_ok=True)
    for name, row in zip(TITLES, rows, strict=True):
        problem = problems.load(name)
        solution, errors = integrate(problem)
        if name == "andrews":
            plot.view(solution, outline=problem.outline, path=page)
        steps, seconds = solution.stats["steps"], solution.stats["seconds"]
        print(
            f"{name:12}{solution.h:9.2g}{steps:7}{errors['q']:12.1e}{errors['v']:12.1e}"
            f"{1e3 * seconds:8.1f}"
        )
        draw_motion(row[0], problem, solution)
        plot.trajectories(solution, ax=row[1])
        draw_kept(row[2], solution, problem.conserved)
        for ax, title in ((row[0], TITLES[name]), (row[2], "conserved quantities")):
            ax.set_title(title, loc="left", fontsize=10)
            ax.tick_params(labelsize=8)
            ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)
    print(f"figure: {path}\nthe mechanism in motion, for a browser: {page}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="?", default="build/demo.png", help="the figure")
    main(parser.parse_args().path)
