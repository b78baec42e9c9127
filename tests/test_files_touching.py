"""Limits and contacts of MJCF and URDF files, beside MuJoCo with its contacts made stiff."""

import numpy as np
import pytest

import liouville as lv

mujoco = pytest.importorskip("mujoco")

G = 9.81
HOPPER = """<mujoco><compiler angle="degree"/><option gravity="0 0 -9.81" {option}/>
<default><joint damping="0.2" armature="0.01" {joint}/>
<geom conaffinity="0" condim="3" friction="0.7 .1 .1" {geom}/></default>
<worldbody><geom name="floor" type="plane" size="10 10 1" conaffinity="1"/>
<body name="torso" pos="0 0 1.25"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="z" type="slide" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/>
<geom name="torso" type="capsule" fromto="0 0 .2 0 0 -.2" size=".05"/>
<body name="thigh" pos="0 0 -.2"><joint name="hip" axis="0 -1 0" range="-150 0"/>
<geom name="thigh" type="capsule" fromto="0 0 0 0 0 -.45" size=".05"/>
<body name="leg" pos="0 0 -.45"><joint name="knee" axis="0 -1 0" range="-60 0"/>
<geom name="leg" type="capsule" fromto="0 0 0 0 0 -.5" size=".04"/>
<body name="foot" pos="0 0 -.5"><joint name="ankle" axis="0 -1 0" range="-45 45"/>
<geom name="foot" type="capsule" fromto="-.13 0 -.04 .26 0 -.04" size=".06"/>
</body></body></body></body></worldbody></mujoco>"""
#: Contacts and limits of a time constant of ten steps, nearly without give.
HARD = '="0.0002 1"', '=".9999 .9999 .001"'
STIFF = {
    "option": 'timestep="2e-5" cone="elliptic" impratio="100" noslip_iterations="10" '
    'iterations="100" tolerance="1e-12"',
    "joint": f"solreflimit{HARD[0]} solimplimit{HARD[1]}",
    "geom": f"solref{HARD[0]} solimp{HARD[1]}",
}


def test_a_leg_falls_on_its_foot_and_bends_to_its_stop_as_that_of_mujoco():
    text = HOPPER.format(option="", joint="", geom="")
    m = lv.bodies.from_mjcf(text)
    system = m.system()
    angles = {"hip": -0.4, "knee": -0.9, "ankle": -0.3}
    start = m.start(values={"torso.joints": (0, -0.02, 0), **angles})
    run = lv.integrate(system, lv.Spark(3), t=(0, 0.28), h=0.01, **start)
    kinds = {name: [c.kind for c in x.changes] for name, x in run.contacts.items() if x.changes}
    assert "stick" in kinds["foot.floor.0"]
    assert kinds["knee.angle.low"][0] == "hit"
    model = mujoco.MjModel.from_xml_string(HOPPER.format(**STIFF))
    data = mujoco.MjData(model)
    data.qpos[:] = [0, -0.02, 0, *angles.values()]
    for _ in range(14_000):
        mujoco.mj_step(model, data)
    torso = run.joint("torso.joints").coordinates
    found = [torso[x][-1] for x in ("x", "z", "tilt")]
    found += [run.joint(x).angle[-1] for x in angles]
    # at the stop of the knee the foot is hit too, which soft contacts share out in their own way
    np.testing.assert_allclose(found[:5], data.qpos[:5], atol=3e-4)
    np.testing.assert_allclose(found[5], data.qpos[5], atol=2e-2)
    assert abs(data.qpos - [0, -0.02, 0, *angles.values()]).max() > 0.1


def falling(geom="", world="", body="", more=""):
    return f"""<mujoco><option gravity="0 0 -9.81"/><worldbody>
      <geom name="floor" type="plane" size="1 1 1" {world}/>
      <body pos="0 0 1"><freejoint/><geom name="ball" size="0.1 0.1 0.1" {geom}/></body>
      {body}</worldbody>{more}</mujoco>"""


def dropped(text, **more):
    m = lv.bodies.from_mjcf(text, **more)
    return lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.05, **m.start())


def test_limits_are_from_the_pose_that_is_drawn():
    text = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>
      <body name="arm"><joint name="pin" axis="0 1 0" ref="0.5" range="0.3 0.9" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.05" contype="0" conaffinity="0"/>
      </body></worldbody></mujoco>"""
    m = lv.bodies.from_mjcf(text)
    assert m._joints["pin"].limits["angle"].low_and_high == pytest.approx((-0.2, 0.4))
    run = lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.05, **m.start())
    assert run.joint("pin").angle[-1] == pytest.approx(0.4, abs=1e-14)
    free = lv.bodies.from_mjcf(text, without=["limits"]).system()
    assert free.contacts is None


def test_contacts_without_friction_are_read_in_space():
    run = dropped(falling('condim="1"', 'condim="1"'), restitution=0.5)
    (name,) = run.contacts
    assert name == "ball.floor"
    assert run.contacts[name].changes[0].t == pytest.approx(np.sqrt(1.8 / G), abs=1e-13)
    assert run.contacts[name].changes[0].normal == pytest.approx(
        1.5 * np.sqrt(1.8 * G) * run.system.output("masses", run.system.values(None), 0.0,
                                                   run.q[0], run.v[0])[0, 0]
    )  # fmt: skip
    by_name = dropped(falling('condim="1"', 'condim="1"'), restitution={"ball.floor": 0.5})
    assert by_name.q.tobytes() == run.q.tobytes()
    left = dropped(falling(), without=["friction of contacts"])
    assert left.contacts["ball.floor"].mode[-1].name == "CLOSED"
    assert dropped(falling(), without=["contact"]).contacts == {}
    assert dropped(falling('friction="0 0 0"', 'friction="0 0 0"')).contacts["ball.floor"].changes


BOX = '<body pos="1 0 1"><freejoint/><geom name="crate" type="box" size=".1 .2 .3"/></body>'
MET = {
    "bits": (falling('contype="2"', body=BOX), {"ball.floor", "crate.floor", "ball.crate"}),
    "other bits": (
        falling('contype="2" conaffinity="2"', body=BOX),
        {"crate.floor"},
    ),
    "excluded": (
        falling(body=BOX, more='<contact><exclude body1="a" body2="b"/></contact>')
        .replace('<body pos="0 ', '<body name="a" pos="0 ')
        .replace('<body pos="1 ', '<body name="b" pos="1 '),
        {"ball.floor", "crate.floor"},
    ),
    "pairs alone": (
        falling(
            'contype="0" conaffinity="0"',
            more='<contact><pair geom1="floor" geom2="ball" condim="1"/></contact>',
        ),
        {"ball.floor"},
    ),
}


@pytest.mark.parametrize("case", MET)
def test_shapes_that_mujoco_looks_at_touch(case):
    text, wanted = MET[case]
    m = lv.bodies.from_mjcf(text, without=["friction of contacts"])
    assert set(m._touches) == wanted
    run = lv.integrate(m.system(), lv.Spark(2), t=(0, 0.6), h=0.05, **m.start())
    points = {name.removesuffix(f".{name.rpartition('.')[2]}") for name in run.contacts}
    assert {x for x in wanted if "crate" in x} <= points | set(run.contacts)
    assert all(record.gap.min() > -1e-13 for record in run.contacts.values())


def planar(geom, pair=""):
    """Return a block on a slide and a hinge over a floor, which move in the plane of x and z."""
    return f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" friction="0.2 0 0"/>
      <body name="b" pos="0 0 .5"><joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/>
      <joint axis="0 1 0"/><geom name="block" type="sphere" size=".1" {geom}/></body></worldbody>
      <contact>{pair}</contact></mujoco>"""


FRICTION = {
    "the larger": ('friction="0.5 0 0"', "", 0.5),
    "the larger of the other": ('friction="0.1 0 0"', "", 0.2),
    "of higher priority": ('friction="0.1 0 0" priority="1"', "", 0.1),
    "torsion does not act in a plane": ('friction="0.5 0.1 0" condim="4"', "", 0.5),
    "of a pair": ("", '<pair geom1="block" geom2="floor" condim="3" friction="0.7 0.7"/>', 0.7),
}


@pytest.mark.parametrize("case", FRICTION)
def test_friction_in_a_plane_is_that_of_the_file(case):
    geom, pair, wanted = FRICTION[case]
    m = lv.bodies.from_mjcf(planar(geom, pair))
    (touch,) = m._touches.values()
    assert touch.laws["friction"] == wanted


def test_what_contacts_have_not_is_refused_by_name():
    def refused(text, **more):
        with pytest.raises((TypeError, ValueError)) as raised:
            lv.bodies.from_mjcf(text, **more)
        return str(raised.value)

    spinning = falling('friction="1 0.1 0.1" condim="4"')
    assert "friction of contacts (shapes 'ball.floor')" in refused(spinning)
    rolling = planar('friction="0.5 0.1 0.1" condim="6"')
    assert "friction of contacts (shapes 'block.floor')" in refused(rolling)
    uneven = planar("", '<pair geom1="block" geom2="floor" condim="4" friction="0.7 0.6"/>')
    assert "friction of contacts (shapes 'block.floor')" in refused(uneven)
    egg = falling('type="ellipsoid" condim="1"', 'condim="1"')
    assert "contact shapes (shapes 'ball.floor')" in refused(egg)
    smooth = falling('condim="1"', 'condim="1"')
    unknown = "restitution= has 'floor', which is no contact\nhint: contacts are ball.floor"
    assert unknown in refused(smooth, restitution={"floor": 0.5})
    assert "restitution must be from 0 to 1, not 2" in refused(smooth, restitution=2)
    many = '<body><freejoint/><replicate count="50" offset=".3 0 0"><body><freejoint/>'
    many = '<replicate count="50" offset=".3 0 0"><body><freejoint/><geom size=".1"/></body>'
    text = f"<mujoco><worldbody>{many}</replicate></worldbody></mujoco>"
    assert "more than 1000 pairs of shapes can touch in the file" in refused(text)


def test_limits_of_urdf_are_read():
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    text = f"""<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -1"/>
      <mass value="1"/>{inertia}</inertial></link>
      <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
      <limit lower="-0.2" upper="0.3" effort="1" velocity="1"/></joint></robot>"""
    m = lv.bodies.from_urdf(text, restitution=0.0)
    start = m.start(rates={"j": 2.0})
    run = lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.05, **start)
    assert run.joint("j").angle.max() == pytest.approx(0.3, abs=1e-13)
