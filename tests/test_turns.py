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
    with pytest.raises(ValueError, match=r"over one\nhint: nothing depends.*, in radians"):
        m.start(values={"A": 7.0})
    whole = lv.integrate(system, lv.Spark(3), t=(0, 2), steps=200, **m.start())
    assert whole.joint("A").angle[-1] == pytest.approx(80, abs=1e-3)
    few = lv.integrate(system, lv.Spark(3), t=(0, 2), steps=200, every=100, **m.start()).joint("A")
    assert few.force.shape == (3, 3)
    assert few.angle == pytest.approx([0, 5, 80], abs=1e-3)
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


def spun():
    """Return a free hinge with its start, turning once a second."""
    m = lv.bodies.Assembly()
    m.body("b", mass=1, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    m.revolute("A", "ground", "b", at=(0, 0, 0), axis=(0, 0, 1))
    return m.system(), m.start(rates={"A": 2 * np.pi})


METHODS = (lv.Spark(4), lv.LobattoPair(2), lv.HHT(-0.1), lv.ArnoldBruls(0.9))


@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__)
def test_turns_are_counted_from_the_start_of_the_run_whatever_is_kept(method, tmp_path):
    system, start = spun()

    def turns(solution):
        return solution.joint("A").angle / (2 * np.pi)

    def right(solution):
        assert turns(solution) == pytest.approx(solution.t, abs=2e-3)

    run = {"t": (0, 5), "h": 0.01, **start}
    whole = lv.integrate(system, method, **run)
    right(whole)
    right(whole.sel(time=slice(4.2, 4.8)))
    right(lv.integrate(system, method, every=300, **run))
    late = [
        lv.integrate(system, method, t_eval=t, **run)
        for t in ([1.25], [0.7513, 4.6], np.r_[4:5:9j])
    ]
    for solution in late:
        right(solution)
    late[1].save(tmp_path / "run.npz")
    right(lv.load(tmp_path / "run.npz", system=system))
    back = lv.integrate(system, method, t=(5, 0), h=0.01, t_eval=[1.25], **start)
    assert turns(back)[0] == pytest.approx(-3.75, abs=2e-3)
    v = start["v"] * np.array([[1.0], [2.0], [-1.0]])
    for kept in ({"t_eval": [1.25, 4.6]}, {"every": 230}):
        many = lv.ensemble(system, method, t=(0, 5), h=0.01, q=start["q"], v=v, **kept)
        for k, factor in enumerate((1, 2, -1)):
            member = many.member(k)
            assert turns(member) == pytest.approx(factor * member.t, abs=2e-2)


def test_turns_are_counted_by_controlled_steps_past_resets_with_tangents_and_in_stores(tmp_path):
    system, start = spun()
    kick = lv.Event(lambda t, *_: t - 1.1, reset=lambda t, q, v, *_: {"v": 2 * v})
    run = {"t": (0, 5), "t_eval": [1.6, 4.6], "events": {"kick": kick}, **start}
    right = np.array([1.1 + 2 * 0.5, 1.1 + 2 * 3.5])
    for more in ({"rtol": 1e-8}, {"h": 0.01}, {"h": 0.01, "tangents": {"v": start["v"]}}):
        found = lv.integrate(system, lv.Spark(4), **run, **more).joint("A").angle
        assert found / (2 * np.pi) == pytest.approx(right, abs=1e-5)
    kept = lv.integrate(
        system, lv.Spark(4), t=(0, 5), h=0.01, every=230, store=tmp_path / "run.zarr", **start
    )
    loaded = lv.load(tmp_path / "run.zarr", system=system)
    assert loaded.joint("A").angle / (2 * np.pi) == pytest.approx(loaded.t, abs=1e-5)
    assert kept.path is not None


@pytest.mark.parametrize("kept", [{"every": 90}, {"t_eval": [1.25, 1.6]}])
def test_turns_are_counted_through_hits(kept):
    m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
    m.body("b", mass=1, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    m.revolute("A", "ground", "b", at=(0, 0, 0), axis=(0, 0, 1))
    m.body("s", mass=1, inertia=(0.1, 0.1, 0.1), at=(1, 0, 0))
    limits = lv.bodies.Limits(-0.5, 2, restitution=0.5)
    m.prismatic("S", "ground", "s", at=(1, 0, 0), axis=(0, 0, 1), limits=limits)
    run = {"t": (0, 2), "h": 0.01, **m.start(rates={"A": 2 * np.pi})}
    solution = lv.integrate(m.system(), lv.Spark(3), **run, **kept)
    assert len(solution.contacts["S.slide.low"].changes) > 3
    assert solution.joint("A").angle / (2 * np.pi) == pytest.approx(solution.t, abs=1e-5)


def test_a_reset_that_turns_a_joint_leaves_its_turns_unknown():
    system, start = spun()
    turned = np.array([0, 0, 0, np.cos(1), 0, 0, np.sin(1)])
    turn = lv.Event(lambda t, *_: t - 1.0, reset=lambda *_: {"q": turned})
    run = {"t": (0, 2), "h": 0.01, "events": {"turn": turn}, **start}
    motion = lv.integrate(system, lv.Spark(2), **run, every=40).joint("A")
    with pytest.raises(ValueError, match=r"no continuous angle: after t = 0\.8 it turned in one"):
        _ = motion.angle
    assert np.isfinite(motion.values["angle"]).all()
    motion = lv.integrate(system, lv.Spark(2), **run, t_eval=[1.5]).joint("A")
    with pytest.raises(ValueError, match=r"before t = 1\.5 it turned in one step, or by a reset"):
        _ = motion.angle
