"""Brouwer's law: roundoff moves the energy like a random walk, and not by more.

How far the walk goes is told by many short runs that start along the motion: their spread after N0
steps, times the square root of N / N0.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import liouville as lv
from liouville.problems import load

CASES = {
    "spherical pendulum": ("spherical_pendulum", lv.Spark(4), 0.05),
    "Lobatto pair": ("spherical_pendulum", lv.LobattoPair(5), 0.05),
    "heavy top": ("heavy_top", lv.Spark(4), 1e-3),
}


def energy_error(case, steps, **start):
    name, method, h = case
    problem = load(name)
    found = lv.integrate(
        problem.system, method, t=(0.0, steps * h), steps=steps, every=steps, states=False,
        **(start or problem.start),
    )  # fmt: skip
    return np.diff(found.invariants["energy"])[0]


def starts(case, count, gap=997):
    """Return states along the motion."""
    name, method, h = case
    problem = load(name)
    found = lv.integrate(
        problem.system, method, t=(0.0, count * gap * h), steps=count * gap, every=gap,
        **problem.start,
    )  # fmt: skip
    return [{"q": q, "v": v} for q, v in zip(found.q[1:], found.v[1:], strict=True)]


def in_sigma(case, steps, short, members):
    """Return the energy error of a long run, in those that a random walk would have."""
    with ThreadPoolExecutor(2) as pool:
        long = pool.submit(energy_error, case, steps)
        runs = [pool.submit(energy_error, case, short, **start) for start in starts(case, members)]
        ends = [run.result() for run in runs]
        return abs(long.result()) / (np.std(ends) * np.sqrt(steps / short))


@pytest.mark.parametrize(
    ("name", "steps", "short"),
    [
        ("spherical pendulum", 150_000, 2_000),
        ("heavy top", 50_000, 2_000),
    ],
)
def test_the_energy_walks_at_random(name, steps, short):
    assert in_sigma(CASES[name], steps, short, 24) < 3


def test_the_mean_of_many_starts_stays():
    """A walk has no mean: the iteration leaves nothing of one sign, though g has few values."""
    name, method, h = CASES["Lobatto pair"]
    steps, members = 20_000, 32
    along = starts(CASES["Lobatto pair"], members)
    found = lv.ensemble(
        load(name).system, method, t=(0.0, steps * h), steps=steps, every=steps, states=False,
        **{key: np.array([start[key] for start in along]) for key in "qv"},
    )  # fmt: skip
    ends = np.diff(found.invariants["energy"], axis=0)[0]
    assert ends.shape == (members,)
    assert abs(ends.mean()) < 3.5 * ends.std(ddof=1) / np.sqrt(members)


def test_roundings_of_displacements_call_for_no_corrections():
    """They stay those of the first iterate: 3.1 corrections a step, with new ones for each 3.6."""
    problem, steps = load("spherical_pendulum"), 1_000
    found = lv.integrate(
        problem.system, lv.Spark(4, newton_tol=3e-7 * np.finfo(float).eps),
        t=(0.0, 0.03 * steps), steps=steps, every=steps, **problem.start,
    )  # fmt: skip
    assert found.stats["iterations"] < 3.35 * steps


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "steps"),
    [(name, 100_000_000) for name in CASES],
)
def test_the_energy_walks_at_random_for_a_long_time(name, steps):
    assert in_sigma(CASES[name], steps, 100_000, 40) < 3


def midpoint_energy_error(x, steps, tolerance):
    """Step x'' = -x by the midpoint rule, which keeps the energy; a fixed point is iterated."""
    h, begin = 0.1, x @ x / 2
    for _ in range(steps):
        moved, change = x, np.inf
        while change > tolerance:
            middle = (x + moved) / 2
            moved, last = x + h * np.array([middle[1], -middle[0]]), moved
            change = np.abs(moved - last).max()
        x = moved
    return x @ x / 2 - begin


def test_an_iteration_that_stops_early_breaks_the_law():
    steps, short = 5_000, 125
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ends = [midpoint_energy_error(np.array([np.cos(a), np.sin(a)]), short, 1e-13) for a in angles]
    long = midpoint_energy_error(np.array([1.0, 0.0]), steps, 1e-13)
    assert abs(long) > 10 * np.std(ends) * np.sqrt(steps / short)
