"""What volume-preserving splitting keeps in long runs, beside a method that does not."""

import numpy as np
import pytest

import liouville as lv
from liouville.problems import load


def runge_kutta(field, x, h, steps, every):
    """Return every so-many-th state of the classical method of order 4, in plain numbers."""
    states = [x]
    for n in range(1, steps + 1):
        k1 = field(*x)
        k2 = field(*(a + h / 2 * k for a, k in zip(x, k1, strict=True)))
        k3 = field(*(a + h / 2 * k for a, k in zip(x, k2, strict=True)))
        k4 = field(*(a + h * k for a, k in zip(x, k3, strict=True)))
        slopes = zip(x, k1, k2, k3, k4, strict=True)
        x = tuple(a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in slopes)
        if n % every == 0:
            states.append(x)
    return np.array(states)


def hill(x, y, z):
    omega = (1 - (x * x + y * y + z * z)) / 2
    return x * z - omega * y, y * z + omega * x, 1 - 2 * (x * x + y * y) - z * z


def stream(x):
    rho = x[..., 0] ** 2 + x[..., 1] ** 2
    return rho * (1 - (x**2).sum(axis=-1)) / 2


@pytest.mark.parametrize("steps", [200_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_many_steps_of_hills_vortex_keep_the_stream_function(steps):
    problem = load("hill_vortex")
    solution = lv.integrate(
        problem.system,
        lv.VolumeSplitting(composition="BM4"),
        t=(0.0, 0.05 * steps),
        steps=steps,
        every=100,
        **problem.start,
    )
    drift = solution.invariant_drift("stream")
    assert solution.stats["steps"] == steps
    assert drift.max() <= 1e-7
    assert drift.max() <= 1.1 * drift[: len(drift) // 10].max()

    # The control: four evaluations a step, so a third of the step costs as much as BM4's twelve.
    states = runge_kutta(hill, problem.start["x"], 0.05 / 3, 60_000, 300)
    control = np.abs(stream(states) / stream(states[0]) - 1)
    assert control.max() > 5 * control[:20].max()  # it grows like the time ...
    assert control.max() * steps / 20_000 > 10 * 1e-7  # ... and T is longer than its 1000


@pytest.mark.parametrize("name", ["volterra_lattice", "euler_top"])
def test_energy_does_not_drift(name):
    problem = load(name)
    method = lv.VolumeSplitting(composition="BM4", compensated=True)
    energy = next(iter(problem.conserved))
    solution = lv.integrate(
        problem.system, method, t=(0.0, 20_000 * problem.h), h=problem.h, every=20, **problem.start
    )
    drift = solution.invariant_drift(energy)
    assert drift.max() <= 1.5 * drift[: len(drift) // 10].max(), energy


def test_compensated_sums_lose_less():
    problem = load("euler_top")
    lost = {}
    for compensated in (False, True):
        method = lv.VolumeSplitting(
            "exponentials", "natural", "SS10s35", "split", compensated=compensated
        )
        solution = lv.integrate(
            problem.system, method, t=(0.0, 20_000.0), h=0.1, every=100, **problem.start
        )
        lost[compensated] = np.std(solution.invariants["energy"] / solution.invariants["energy"][0])
    assert lost[True] < lost[False] / 10
