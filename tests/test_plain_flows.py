"""Plain flows by every method: no field at all, constant ones, and starts where nothing moves."""

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest

import liouville as lv

METHODS = (
    lv.VolumeSplitting(),
    lv.VolumeSplitting(composition="S2"),
    lv.VolumeSplitting(composition="BM4", diagonal="exponentials"),
    lv.VolumeSplitting(composition="BM6"),
)
AXIS = np.linspace(0, 1, 6)
ONE = np.ones((6, 6))
CELL = np.arange(0, 1, 0.2)


class Plain(NamedTuple):
    """A field, a start, and the state that it comes to at t = 1, which splittings have exactly."""

    make: Callable[[], Any]
    start: Any
    end: Any


def polynomial(field, n, **more):
    return lambda: lv.PolynomialField(field, x=n, **more)


def gridded(n=2, **more):
    return lambda: lv.GriddedField(*[AXIS] * n, **more)


def turning(t, x, p):
    return [p.a * x[1], -p.a * x[0]]


MODELS = {
    "one coordinate at rest": Plain(polynomial(lambda t, x, p: [0.0], 1), [1.0], [1.0]),
    "one coordinate": Plain(polynomial(lambda t, x, p: [1.0], 1), [0.0], [1.0]),
    "zero": Plain(polynomial(lambda t, x, p: [0.0, 0.0], 2), [1.0, 2.0], [1.0, 2.0]),
    "zero times t": Plain(polynomial(lambda t, x, p: [0 * t, 0 * t], 2), [1.0, 2.0], [1.0, 2.0]),
    "zero by a parameter": Plain(polynomial(turning, 2, params={"a": 0.0}), [1.0, 2.0], [1.0, 2.0]),
    "zero by a parameter, driven": Plain(
        polynomial(lambda t, x, p: [p.a * t * x[1], 0.0], 2, params={"a": 0.0}), [1.0, 2], [1.0, 2]
    ),
    "constant": Plain(polynomial(lambda t, x, p: [1.0, 2.0], 2), [0.0, 0.0], [1.0, 2.0]),
    "shear": Plain(polynomial(lambda t, x, p: [x[1], 0.0], 2), [0.0, 1.0], [1.0, 1.0]),
    "shear of 1e9": Plain(polynomial(lambda t, x, p: [1e9 * x[1], 0.0], 2), [0.0, 1.0], [1e9, 1]),
    "shears in turn of 1e6": Plain(
        polynomial(lambda t, x, p: [1e6 * x[1], 1e6 * x[2], 0.0], 3), [0.0, 0, 2], [1e12, 2e6, 2]
    ),
    "starts beside 0": Plain(
        polynomial(lambda t, x, p: [1.0, x[0]], 2), [1e-9, 0.0], [1 + 1e-9, 0.5 + 1e-9]
    ),
    "turning about the start": Plain(
        polynomial(turning, 2, params={"a": 1.0}), [0.0, 0.0], [0.0, 0.0]
    ),
    "saddle at the start": Plain(polynomial(lambda t, x, p: [x[0], -x[1]], 2), [0.0, 0], [0.0, 0]),
    "squares at the start": Plain(
        polynomial(lambda t, x, p: [x[1] ** 2, x[0] ** 2], 2), [0.0, 0.0], [0.0, 0.0]
    ),
    "waves at the start": Plain(
        polynomial(lambda t, x, p: [ca.sin(x[1]), ca.sin(x[0])], 2), [0.0, 0.0], [0.0, 0.0]
    ),
    "no potential": Plain(
        lambda: lv.PotentialField(lambda t, x, p: 0.0, x=2), [1.0, 2.0], [1.0, 2.0]
    ),
    "the same potential everywhere": Plain(
        lambda: lv.PotentialField(lambda t, x, p: t, x=2), [1.0, 2.0], [1.0, 2.0]
    ),
    "no potential in space": Plain(
        lambda: lv.PotentialField(lambda t, x, p: [0.0, 0.0, 0.0], x=3), [1.0, 2, 3], [1.0, 2, 3]
    ),
    "no potential by a parameter": Plain(
        lambda: lv.PotentialField(lambda t, x, p: p.a * x[0] * x[1], x=2, params={"a": 0.0}),
        [1.0, 2.0],
        [1.0, 2.0],
    ),
    "sea at rest": Plain(gridded(velocity=(0 * ONE, 0 * ONE)), [0.5, 0.5], [0.5, 0.5]),
    "sea at rest by a potential": Plain(gridded(potential=ONE), [0.5, 0.5], [0.5, 0.5]),
    "sea at rest in walls": Plain(
        gridded(velocity=np.zeros((2, 6, 6)), walls=("x", "y")), [0.5, 0.5], [0.5, 0.5]
    ),
    "sea at rest in space": Plain(
        gridded(3, velocity=np.zeros((3, 6, 6, 6))), [0.5, 0.5, 0.5], [0.5, 0.5, 0.5]
    ),
    "sea at rest in time": Plain(
        gridded(velocity=np.zeros((2, 2, 6, 6)), t=[0.0, 1.0]), [0.5, 0.5], [0.5, 0.5]
    ),
    "uniform current": Plain(gridded(velocity=(ONE / 4, 0 * ONE)), [0.5, 0.5], [0.75, 0.5]),
    "uniform current round a torus": Plain(
        lambda: lv.GriddedField(
            CELL, CELL, velocity=(ONE[1:, 1:] / 4, ONE[1:, 1:]), periodic={"x": 1.0, "y": 1.0}
        ),
        [0.0, 0.0],
        [0.25, 1.0],
    ),
    "no fields": Plain(lv.ChargedParticles, [0, 0, 0, 1.0, 0, 0], [1.0, 0, 0, 1, 0, 0]),
    "no magnetic field": Plain(
        lambda: lv.ChargedParticles(B=lambda t, x, p: [0.0, 0.0, 0.0]), [0.0] * 6, [0.0] * 6
    ),
    "electric field alone": Plain(
        lambda: lv.ChargedParticles(E=(1.0, 0, 0)), [0.0] * 6, [0.5, 0, 0, 1.0, 0, 0]
    ),
    "no charge": Plain(
        lambda: lv.ChargedParticles(B=(0, 0, 1.0), E=(1.0, 0, 0), charge=0.0),
        [0, 0, 0, 0, 2.0, 0],
        [0, 2.0, 0, 0, 2, 0],
    ),
    "at rest in a magnetic field": Plain(
        lambda: lv.ChargedParticles(B=(0, 0, 1.0)), [0.0] * 6, [0.0] * 6
    ),
}
RUNS = {
    "steps": {"steps": 8},
    "one step": {"steps": 1},
    "rtol": {"rtol": 1e-8},
    "t_eval": {"h": 0.125, "t_eval": [0.0, 0.3, 1.0]},
    "backwards": {"steps": 8, "t": (1, 0)},
}


@pytest.mark.parametrize("name", MODELS)
def test_plain_flows_run_by_every_method_and_have_nothing_to_say(name):
    make, start, end = MODELS[name]
    field, start, end = make(), np.array(start, float), np.array(end, float)
    close = 1e-13 * max(1, np.abs(end).max())
    for method in METHODS:
        if method.diagonal != "auto" and type(field) is not lv.PolynomialField:
            continue
        for run, options in RUNS.items():
            is_back = run == "backwards"
            x = end if is_back else start
            found = lv.integrate(field, method, **{"t": (0, 1), **options}, x=x)
            assert found.x[-1] == pytest.approx(start if is_back else end, abs=close), (method, run)
            assert not found.message or run == "rtol"
        both = lv.ensemble(field, method, t=(0, 1), steps=8, x=np.stack([start, start]))
        assert both.x[-1] == pytest.approx(np.stack([end, end]), abs=close)
        tangent = {"x": np.eye(len(start))}
        found = lv.integrate(field, method, t=(0, 1), steps=8, x=start, tangents=tangent)
        assert np.linalg.det(found.tangents["x"].x[-1]) == pytest.approx(1, abs=1e-12)
    assert str(lv.plan(field, METHODS[0], h=0.125, x=start))


@pytest.mark.parametrize("power", [0, 1])
def test_members_and_derivatives_pass_through_a_parameter_that_is_zero(power):
    field = lv.PolynomialField(
        lambda t, x, p: [p.a * t**power * x[1], -p.a * t**power * x[0]], x=2, params={"a": 0.0}
    )
    a = np.array([0.0, 1.0, -1.0])
    run = {"t": (0, 1), "steps": 50}
    members = lv.ensemble(field, METHODS[0], **run, x=[1.0, 0.0], params={"a": a})
    angle = a / (power + 1)
    assert members.x[-1] == pytest.approx(np.stack([np.cos(angle), -np.sin(angle)], 1), abs=1e-6)
    found = lv.integrate(field, METHODS[0], **run, x=[1.0, 0.0], tangents={"params.a": 1.0})
    assert found.tangents["params.a"].x[-1] == pytest.approx([0, -1 / (power + 1)], abs=1e-12)
