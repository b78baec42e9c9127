"""Turns of joints: laws that depend on an angle count them, and motions say what they know."""

from __future__ import annotations

import numpy as np
import pytest

import liouville as lv


def hinge(kind="spatial", params=None, **law):
    """Return a body of moment 1 on a hinge."""
    m = lv.bodies.Assembly()
    if kind == "planar":
        m.planar_body("b", mass=1, inertia=1, at=(0, 0), angle=0.7)
    else:
        m.body("b", mass=1, inertia=(1, 1, 1), at=(0, 0, 0), rotation=(1, 0.3, 0.2, 0.1))
    m.revolute("A", m.ground, "b", at=(0, 0, 0), axis=(0, 0, -1), **law)
    return m, m.system(params=params)


@pytest.mark.parametrize("kind", ["spatial", "planar"])
@pytest.mark.parametrize("law", ["spring", "torque"])
def test_a_torsion_spring_works_over_many_turns(kind, law):
    laws = {"spring": {"spring": 1.0}, "torque": {"torque": lambda t, a, w, p: -p.k * a}}
    # a default of zero must not hide that the torque depends on the angle
    m, system = hinge(kind, {"k": 0.0}, **laws[law])
    assert len(system.coordinates) == {"spatial": 8, "planar": 3}[kind]
    run = {"params": {"k": 1.0}, "tangents": {"v": m.start(rates={"A": 1.0})["v"]}}
    solution = lv.integrate(
        system, lv.Spark(3), t=(0, 6), h=0.01, **run, **m.start(rates={"A": 30.0})
    )
    motion = solution.joint("A")
    assert np.abs(motion.angle - 30 * np.sin(solution.t)).max() < 1e-7
    assert np.abs(motion.rate - 30 * np.cos(solution.t)).max() < 1e-7
    assert np.abs(motion.torque).max() < 1e-10  # the spring is no part of what the hinge holds
    if kind == "spatial":
        assert np.abs(solution.tangents["v"].q[:, 7] - np.sin(solution.t)).max() < 1e-7


def test_a_torque_that_no_angle_enters_takes_no_coordinate():
    m, system = hinge(torque=lambda t, a, w, p: 60 * t * t)
    assert len(system.coordinates) == 7
    with pytest.raises(ValueError, match="counts no turns, and 7 is over one\nhint: nothing"):
        m.start(values={"A": 7.0})
    whole = lv.integrate(system, lv.Spark(3), t=(0, 2), steps=200, **m.start())
    assert whole.joint("A").angle[-1] == pytest.approx(80, abs=1e-3)
    few = lv.integrate(system, lv.Spark(3), t=(0, 2), steps=200, every=100, **m.start()).joint("A")
    assert few.force.shape == (3, 3)
    with pytest.raises(ValueError, match="t = 0 and 1 are too far apart to count turns"):
        _ = few.angle
    planar, system = hinge("planar", torque=lambda t, a, w, p: 60 * t * t)
    few = lv.integrate(system, lv.Spark(3), t=(0, 2), steps=200, every=100, **planar.start())
    assert few.joint("A").angle[-1] == pytest.approx(80, abs=1e-9)


@pytest.mark.parametrize("kind", ["spatial", "planar"])
def test_starts_are_beyond_a_turn_as_given(kind):
    m, system = hinge(kind, spring=1.0)
    start = m.start(values={"A": 17.0})
    solution = lv.integrate(system, lv.Spark(2), t=(0, 1e-9), steps=1, **start)
    assert solution.joint("A").angle[0] == pytest.approx(17, abs=1e-12)


def test_both_angles_of_a_universal_joint_count():
    m = lv.bodies.Assembly()
    m.body("b", mass=1, inertia=(1, 2, 3), at=(0, 0, 0))
    m.universal("U", m.ground, "b", at=(0, 0, 0), axes=((1, 0, 0), (0, 1, 0)), spring=(1.0, 1.0))
    system = m.system()
    assert m.start(values={"U": (7.0, 8.0)})["q"][-2:] == pytest.approx([7, 8], abs=1e-9)
    start = m.start(rates={"U": (9.0, 11.0)})
    solution = lv.integrate(system, lv.Spark(4), t=(0, 6), h=0.005, **start)
    found = solution.joint("U").coordinates
    assert max(np.abs(x).max() for x in found.values()) > 7
    assert np.ptp(solution.invariants["energy"]) < 1e-8


def test_angles_of_a_universal_joint_that_counts_no_turns_are_continuous():
    runs = []
    for stiffness in (0.0, 1e-12):  # that of a spring counts in coordinates of its own
        m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
        m.body("b", mass=1, inertia=(1, 2, 3), at=(0, 0, -0.5))
        axes = ((1, 0, 0), (0, 1, 0))
        m.universal("U", m.ground, "b", at=(0, 0, 0), axes=axes, spring=(stiffness,) * 2)
        start = m.start(rates={"U": (5.0, 12.0)})
        runs.append(lv.integrate(m.system(), lv.Spark(4), t=(0, 3), h=0.01, **start))
    found, counted = (x.joint("U").coordinates for x in runs)
    assert np.ptp(counted["second angle"]) > 20
    assert np.abs(np.diff(runs[0].joint("U").values["angle"])).max() > 6  # both jump
    for name, angle in counted.items():
        assert np.abs(found[name] - angle).max() < 1e-6


def test_couplings_of_hinges_hold_over_many_turns():
    m = lv.bodies.Assembly()
    for name, x in (("a", 0), ("b", 1)):
        m.body(name, mass=1, inertia=(1, 1, 1), at=(x, 0, 0))
        m.revolute(name.upper(), m.ground, name, at=(x, 0, 0), axis=(0, 0, 1))
    m.couple("C", "B", "A", by=(0, 2.0))
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 5), h=0.01, **m.start(rates={"A": 3.0}))
    assert run.joint("B").angle[-1] == pytest.approx(30, abs=1e-10)
