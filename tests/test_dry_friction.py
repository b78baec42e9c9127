"""Dry friction of joints that sticks, beside closed forms and MuJoCo."""

import numpy as np
import pytest
from scipy.optimize import brentq

import liouville as lv
from liouville.bodies import Assembly, Coulomb, Dry

G = 9.81
LENGTH, MASS = 1.5, 2.0


def pendulum(friction, *, kind="revolute", params=None):
    """Return a pendulum in the plane, or one in space that swings about y."""
    m = Assembly(gravity=(0, -G, 0) if kind == "planar" else (0, 0, -G))
    if kind == "planar":
        bob = m.planar_body("bob", mass=MASS, inertia=0.3, at=(0, -LENGTH))
        m.revolute("pin", "ground", bob, at=(0, 0), friction=friction)
        return m
    bob = m.body("bob", mass=MASS, inertia=(0.3, 0.3, 0.3), at=(0, 0, -LENGTH))
    if kind == "compound":
        axes = [("turn", (0, 1, 0), (0, 0, 0))]
        m.compound("pin", "ground", bob, axes, friction=friction)
    else:
        m.revolute("pin", "ground", bob, at=(0, 0, 0), axis=(0, 1, 0), friction=friction)
    return m


def turns(angle, effort, static):
    """Return where a pendulum turns, until it stays: m g l (cos - cos) is the work of friction."""
    found, weight = [angle], MASS * G * LENGTH
    while weight * np.sin(found[-1]) > static:
        last = found[-1]
        lost = lambda x, last=last: weight * (np.cos(x) - np.cos(last)) - effort * (x + last)  # noqa: E731
        found.append(brentq(lost, 0, last, xtol=1e-15))
    return np.array(found)


@pytest.mark.parametrize("kind", ["planar", "revolute", "compound"])
@pytest.mark.parametrize("static", [None, 1.8])
def test_a_pendulum_loses_as_much_each_swing_and_stays(kind, static):
    m = pendulum(Dry(1.2, static), kind=kind)
    run = lv.integrate(m.system(), lv.Spark(4), t=(0, 30), h=0.02, **m.start(values={"pin": 1.5}))
    record = run.contacts["pin.angle.friction"]
    wanted = turns(1.5, 1.2, static or 1.2)
    assert [x.kind for x in record.changes] == ["slip"] * (len(wanted) - 2) + ["stick"]
    angle = run.joint("pin").angle
    met = [angle[np.flatnonzero(run.t == x.t)[0]] for x in record.changes]
    np.testing.assert_allclose(np.abs(met), wanted[1:], atol=1e-8)
    assert np.abs(angle[-1]) == pytest.approx(wanted[-1], abs=1e-8)
    assert (np.diff(angle[run.t > record.changes[-1].t]) == 0).all()
    assert (np.abs(record.friction) <= (static or 1.2) * (1 + 1e-12)).all()
    assert np.abs(lv.analysis.power_balance(run).defect).max() < 1e-8


def test_a_slide_stays_until_the_force_tears_it_off():
    m = Assembly(gravity=(0, 0, 0))
    block = m.body("block", mass=2.0, inertia=(1, 1, 1))
    m.prismatic(
        "rail", "ground", block, at=(0, 0, 0), axis=(1, 0, 0),
        force=lambda t, slide, rate, params: t, friction=Dry(1.0, lambda params: params.most),
    )  # fmt: skip
    m.params = {"most": 1.5}
    run = lv.integrate(m.system(), lv.Spark(2), t=(0, 2), h=0.1, **m.start())
    (tear,) = [x for x in run.contacts["rail.slide.friction"].changes if x.kind == "slip"]
    assert tear.t == pytest.approx(1.5, abs=1e-13)
    # x'' = (t - 1) / 2
    assert run.joint("rail").slide[-1] == pytest.approx((0.5 * 0.25 / 4 + 0.125 / 12), abs=1e-13)


def test_a_friction_of_zero_is_none():
    m = pendulum(Dry(0.0))
    assert m.system().contacts is None
    run = lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.1, **m.start(values={"pin": 1.0}))
    assert not run.contacts


FILE = """<mujoco><option timestep="{dt}" integrator="RK4"/><worldbody><body name="arm">
<joint name="pin" axis="0 1 0" frictionloss="1.2" solreffriction="{soft} 1"
solimpfriction="0.9999 0.9999 0.001"/>
<geom type="capsule" fromto="0 0 0 0 0 -1" size="0.05" density="200"/>
<body name="slider" pos="0 0 -1"><joint name="rail" type="slide" axis="0 0 1" stiffness="200"
frictionloss="3" solreffriction="{soft} 1" solimpfriction="0.9999 0.9999 0.001"/>
<geom size="0.1" density="300"/></body></body></worldbody></mujoco>"""


def test_friction_loss_of_files_is_that_of_mujoco_made_stiff():
    mujoco = pytest.importorskip("mujoco")
    m = lv.bodies.from_mjcf(FILE.format(dt=1e-3, soft=0.02))
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 3), h=0.01, **m.start(values={"pin": 1.0}))
    kinds = [x.kind for x in run.contacts["rail.slide.friction"].changes]
    assert kinds.count("stick") == 4
    own, errors = [run.joint("pin").angle[-1], run.joint("rail").slide[-1]], []
    for dt in (1e-3, 2e-4):
        model = mujoco.MjModel.from_xml_string(FILE.format(dt=dt, soft=2.02 * dt))
        data = mujoco.MjData(model)
        data.qpos[0] = 1.0
        for _ in range(round(3 / dt)):
            mujoco.mj_step(model, data)
        errors.append(np.abs(data.qpos - own).max())
    assert errors[0] < 2e-4  # of first order in its softness
    assert errors[1] < errors[0] / 4


URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<origin xyz="0 0 -1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<dynamics friction="0.7" damping="0.1"/></joint></robot>"""


def test_friction_of_urdf_is_dry():
    m = lv.bodies.from_urdf(URDF)
    assert m.system().contacts.names == ("pin.angle.friction",)
    rest = lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.1, **m.start(values={"pin": 0.07}))
    np.testing.assert_allclose(rest.joint("pin").angle, 0.07, atol=1e-15)  # .7 > g sin(.07)
    smooth = lv.bodies.from_urdf(URDF, without=("friction loss",))
    assert smooth.system().contacts is None


BAD = {
    "effort of dry friction must be zero or positive, not -1": lambda: Dry(-1),
    "static of dry friction must be at least effort = 2, not 1": lambda: Dry(2, 1),
    "friction= of joint 'J': a cylindrical joint slips along angle, slide at once": lambda: (
        Assembly().cylindrical(
            "J", "ground", "ground", at=(0, 0, 0), axis=(0, 0, 1), friction=Dry(1)
        )
    ),
    "friction in joint 'pin' knows nothing of what contacts press": lambda: both_kinds(),
}  # fmt: skip


def both_kinds():
    m = pendulum(Coulomb(mu=0.1, v_s=0.1, radius=0.1))
    other = m.body("other", mass=1.0, inertia=(1, 1, 1), at=(0, 0, -2 * LENGTH))
    m.revolute("elbow", "bob", other, at=(0, 0, -LENGTH), axis=(0, 1, 0), friction=Dry(0.1))
    return m.system()


@pytest.mark.parametrize("sentence", BAD)
def test_dry_friction_that_is_none_is_refused(sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        BAD[sentence]()


def test_dry_friction_of_a_motion_that_is_given_is_refused():
    m = Assembly()
    arm = m.body("arm", mass=1.0, inertia=(1, 1, 1))
    with pytest.raises(ValueError, match="'angle' of joint 'pin' has both friction= and motion="):
        m.revolute(
            "pin", "ground", arm, at=(0, 0, 0), axis=(0, 0, 1),
            friction=Dry(1), motion=lambda t, params: t,
        )  # fmt: skip
