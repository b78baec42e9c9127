"""Models from files: MJCF and URDF against MuJoCo's own numbers.

One file, since both formats are read by one compiler, and compared by the same helpers.
"""

import sys

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.bodies import rotations as rot
from liouville.bodies.files import _compiled
from liouville.bodies.reading import Reader

mujoco = pytest.importorskip("mujoco")
mjcf, urdf = lv.bodies.from_mjcf, lv.bodies.from_urdf

#: All kinds of joints, several on a body, rotors, springs, actuators and a body without joint.
TREE = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0.4 -0.3 -9.1"/>
  <default><geom contype="0" conaffinity="0" density="700"/></default>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="0.3 -0.2 0.5">
      <freejoint name="flight"/>
      <geom type="box" size="0.3 0.2 0.1" pos="0.05 0 0.02"/>
      <body name="mast" pos="0 0 0.4" euler="0.2 0.1 0">
        <geom type="capsule" size="0.05 0.2"/>
        <body name="wheel" pos="0.3 0 0">
          <joint name="wheel" axis="1 2 0" pos="0.02 0 0.01" damping="0.2" armature="0.03"/>
          <geom type="cylinder" size="0.1 0.03" euler="0.4 0 0"/>
        </body>
      </body>
      <body name="thigh" pos="0 0.3 -0.2" euler="0 0.7 0">
        <joint name="out" axis="1 0 0" pos="0 0 0.1" ref="0.4" stiffness="3" springref="0.1"/>
        <joint name="up" type="slide" axis="0 1 1" damping="0.7" armature="0.4" stiffness="11"/>
        <joint name="round" axis="0 0.3 1" pos="0.05 0 0" actuatorfrcrange="-1 1"/>
        <geom type="ellipsoid" size="0.1 0.06 0.2" pos="0 0 -0.1"/>
        <body name="shin" pos="0 0 -0.4">
          <joint name="knee" axis="0 1 0" stiffness="5" springref="0.3" damping="0.4"/>
          <geom type="capsule" size="0.04 0.15"/>
          <body pos="0.1 0 -0.2">
            <joint name="ankle" type="ball" stiffness="3" damping="0.05" armature="0.02"/>
            <geom type="box" size="0.1 0.05 0.02"/>
          </body>
        </body>
      </body>
    </body>
    <body name="cart" pos="2 0 0">
      <joint name="rail" type="slide" axis="1 0 0" damping="0.3"/>
      <geom size="0.1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="drive" joint="wheel" gear="7" armature="0.002"/>
    <damper name="brake" joint="round" kv="2" ctrlrange="0 1"/>
    <position name="hold knee" joint="knee" kp="20" kv="0.5" gear="1.5"/>
    <general name="up" joint="up" gainprm="3" biastype="affine" biasprm="0.2 -4 -0.1"/>
    <motor name="out" joint="out" gear="-2" forcelimited="true" forcerange="-0.3 0.4"/>
    <motor name="push" joint="rail" gear="3" ctrllimited="true" ctrlrange="-0.1 0.2"/>
  </actuator>
</mujoco>
"""


def read(text):
    return Reader(*_compiled(text), None)


def functions(system):
    """Return mass, bias and slopes of constraints as a function of (t, q, v, params)."""
    s, m = system.symbols, system.model
    bias = ca.jtimes(m.p, s.y, s.z) - m.f
    found = [ca.jacobian(m.p, s.z), bias, ca.jacobian(m.g, s.y), m.g]
    return ca.Function("f", [s.t, s.y, s.z, s.params.vector], [ca.densify(x) for x in found])


def absolute(reader, system, data):
    """Return q, its slopes by MuJoCo's velocities, and q'' where those do not change."""
    model, layout = reader.model, system.body_layout
    nv, nb, n = model.nv, len(system.bodies), len(system.coordinates)
    x, e = np.zeros((3, nb)), np.zeros((4, nb))
    velocity, omega = np.zeros((nb, 3, nv)), np.zeros((nb, 3, nv))
    q, slopes, second = np.zeros(n), np.zeros((n, nv)), np.zeros(n)
    data.qacc[:] = 0
    mujoco.mj_rnePostConstraint(model, data)
    for own, body in reader.bodies.items():
        if own:
            k = system.bodies.index(body.name)
            back = rot.conjugate(reader.data.xquat[own])
            centre = np.array(rot.rotate(back, body.at - reader.data.xpos[own]))
            x[:, k] = data.xpos[own] + data.xmat[own].reshape(3, 3) @ centre
            e[:, k] = rot.product(data.xquat[own], rot.product(back, body.rotation))
            mujoco.mj_jac(model, data, velocity[k], omega[k], x[:, k], own)
    slopes[: 7 * nb] = layout.rates((x, e), *(np.moveaxis(j, 0, 1) for j in (velocity, omega)))
    q[: 7 * nb] = layout.gathered((x, e))
    for joint, (name, coordinate) in reader.places.items():
        if name in layout.own or (name, coordinate) in layout.counted:
            row = system.coordinates.index(f"{name}.{coordinate}")
            slopes[row, model.jnt_dofadr[joint]] = 1
            at = model.jnt_qposadr[joint]
            q[row] = data.qpos[at] - model.qpos0[at]
    v = slopes @ data.qvel
    for own, body in reader.bodies.items():
        if own:
            k, found = system.bodies.index(body.name), np.zeros(6)
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_BODY, own, found, 0)
            turning, spin = found[:3], omega[k] @ data.qvel
            arm = x[:, k] - data.xipos[own]
            more = np.cross(turning, arm) + np.cross(spin, np.cross(spin, arm))
            second[7 * k : 7 * k + 3] = found[3:] + model.opt.gravity + more
            first = rot.rate_of(e[:, k], turning)
            second[7 * k + 3 : 7 * k + 7] = rot.plus(
                first, rot.rate_of(v[7 * k + 3 : 7 * k + 7], spin)
            )
    return q, slopes, second


def states(reader, count, seed=1):
    """Yield MuJoCo's data at random states and controls."""
    model, rng = reader.model, np.random.default_rng(seed)
    for _ in range(count):
        data = mujoco.MjData(model)
        q = model.qpos0.copy()
        mujoco.mj_integratePos(model, q, rng.standard_normal(model.nv), 1.0)
        data.qpos, data.qvel = q, rng.standard_normal(model.nv)
        data.ctrl = rng.uniform(-1, 1, model.nu)
        mujoco.mj_forward(model, data)
        yield data


def test_mass_bias_and_slopes_of_joints_are_those_of_mujoco():
    reader = read(TREE)
    system = reader.assembly.system()
    assert system.bodies == ("base", "wheel", "thigh", "shin", "body6", "cart")
    assert set(system.params) == {"drive", "brake", "hold_knee", "up", "out", "push"}
    assert system.place("thigh.joints").coordinates == ("out", "up", "round")
    known, model = functions(system), reader.model
    for data in states(reader, 5):
        mass, force = np.zeros((model.nv, model.nv)), data.qfrc_passive + data.qfrc_actuator
        mujoco.mj_fullM(model, data, mass)
        q, slopes, second = absolute(reader, system, data)
        own, bias, g_q, g = (np.array(x) for x in known(0, q, slopes @ data.qvel, data.ctrl))
        assert np.abs(slopes.T @ own @ slopes - mass).max() < 1e-13 * np.abs(mass).max()
        wanted = data.qfrc_bias - force
        found = slopes.T @ (own @ second + bias.ravel())
        assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()
        assert np.abs(g).max() < 1e-14
        assert np.abs(g_q @ slopes).max() < 1e-13
        assert len(q) - np.linalg.matrix_rank(g_q) == model.nv


LOOPS = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" type="capsule" size="0.03"/></default>
  <worldbody>
    <body name="a"><joint name="a" axis="0 0 1"/><geom fromto="0 0 0 1 0 0"/>
      <body name="b" pos="1 0 0"><joint name="b" axis="0 1 1"/><geom fromto="0 0 0 0 1 0"/>
        <body name="c" pos="0 1 0"><joint name="c" type="ball"/><geom fromto="0 0 0 0 1 1"/></body>
      </body></body>
    <body name="d" pos="3 0 0"><freejoint/><geom fromto="0 0 0 0 1 0"/></body>
    <body name="e" pos="4 0 0" euler="0.2 0.3 0"><freejoint/><geom fromto="0 0 0 1 1 0"/></body>
  </worldbody>
  <equality>
    <connect name="tie" body1="c" body2="a" anchor="0 1 1"/>
    <weld name="glue" body1="d" body2="e" anchor="0.1 0.2 0.3"/>
    <joint name="follow" joint1="a" joint2="b" polycoef="0.1 0.5 -0.3 0.2 0.05"/>
    <joint name="off" joint1="a" active="false"/>
  </equality>
</mujoco>
"""


def test_equality_constraints_are_those_of_mujoco():
    reader = read(LOOPS)
    reader.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    system = reader.assembly.system()
    names = system.constraints
    known, data = functions(system), mujoco.MjData(reader.model)
    mujoco.mj_forward(reader.model, data)
    theirs = data.efc_J.reshape(-1, reader.model.nv)
    q, slopes, _ = absolute(reader, system, data)
    _, _, g_q, g = (np.array(x) for x in known(0, q, 0 * q, []))
    first = 0
    for name, count in (("tie", 3), ("glue", 6), ("follow", 1)):
        own = [k for k, x in enumerate(names) if x.split(".")[0] == name]
        rows, other = g_q[own] @ slopes, theirs[first : first + count]
        assert len(own) == count
        assert np.linalg.matrix_rank(rows) == np.linalg.matrix_rank(other)
        assert np.abs(other - other @ np.linalg.pinv(rows) @ rows).max() < 1e-14
        first += count
    assert first == len(theirs)
    wanted = 0.7 - np.polyval([0.05, 0.2, -0.3, 0.5, 0.1], 2.0)
    q[[system.coordinates.index(x) for x in ("a.hinge.angle", "b.hinge.angle")]] = 0.7, 2.0
    g = np.array(known(0, q, 0 * q, [])[3]).ravel()
    assert abs(g[names.index("follow")] - wanted) < 1e-15


FOURBAR = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" type="capsule" size="0.02"/></default>
  <option gravity="0 -9.81 0"/>
  <worldbody>
    <body name="crank"><joint name="A" axis="0 0 1"/><geom fromto="0 0 0 0 0.5 0"/>
      <body name="coupler" pos="0 0.5 0"><joint name="B" axis="0 0 1" armature="0.01"/>
        <geom fromto="0 0 0 0.9 0.4 0"/>
      </body>
    </body>
    <body name="rocker" pos="1.1 0 0"><joint name="D" axis="0 0 1"/>
      <geom fromto="0 0 0 -0.2 0.9 0"/>
    </body>
  </worldbody>
  <equality><connect name="C" body1="coupler" body2="rocker" anchor="0.9 0.4 0"/></equality>
  <actuator><motor name="M" joint="A"/></actuator>
</mujoco>
"""


def test_a_loop_of_a_file_starts_and_runs():
    controls = {"M": lambda t, angle, rate, params: 0.2 * ca.sin(angle)}
    m = mjcf(FOURBAR, controls=controls)
    system = m.system()
    start = m.start(values={"A": -0.6}, rates={"A": 5.0})
    solution = lv.integrate(system, lv.Spark(4), t=(0, 0.5), h=0.005, **start)
    assert max(np.abs(x).max() for x in solution.residuals.values()) < 1e-13
    crank, coupler, rocker = (solution.body(x) for x in ("crank", "coupler", "rocker"))
    assert abs(solution.joint("A").angle[0] + 0.6) < 1e-14
    # MuJoCo's own places at the angles of the run
    reader = read(FOURBAR)
    data = mujoco.MjData(reader.model)
    data.qpos = [solution.joint(x).angle[-1] for x in "ABD"]
    mujoco.mj_kinematics(reader.model, data)
    for k, body in enumerate((crank, coupler, rocker)):
        assert np.abs(data.xipos[k + 1] - body.position[-1]).max() < 1e-13
    # power of the motor is what the energy gains
    work = 0.2 * (np.cos(solution.joint("A").angle[0]) - np.cos(solution.joint("A").angle))
    energy = solution.invariants["energy"]
    assert np.abs(energy - energy[0] - work).max() < 1e-9


ROBOT = """
<robot name="crane">
  <link name="foot"/>
  <link name="tower"><inertial><origin xyz="0.1 0 0.5" rpy="0.2 0.1 0"/><mass value="4"/>
    <inertia ixx="0.5" iyy="0.6" izz="0.2" ixy="0.02" ixz="0.01" iyz="0.03"/></inertial></link>
  <link name="lamp"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="stay"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="foot"/><child link="tower"/>
    <axis xyz="0 0 1"/><dynamics damping="0.3"/></joint>
  <joint name="screwed" type="fixed"><origin xyz="0 0.2 1"/><parent link="tower"/>
    <child link="lamp"/></joint>
  <joint name="lift" type="continuous"><origin xyz="0 0 1"/><parent link="tower"/>
    <child link="arm"/><axis xyz="0 1 0"/></joint>
  <joint name="lean" type="continuous"><origin xyz="1 0 0"/><parent link="tower"/>
    <child link="stay"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def test_a_robot_has_loops_that_its_file_cannot_have(tmp_path):
    path = tmp_path / "crane.urdf"
    path.write_text(ROBOT, encoding="utf-8")
    # the ends of arm and stay are both at (1, 0, 1)
    loops = {"pin": ("arm", "stay", (1, 0, 0)), "hook": ("lamp", "arm", (0, -0.2, 0), (0, 1, 0))}
    m = urdf(path, loops={"pin": loops["pin"]})
    system = m.system()
    assert system.bodies == ("tower", "arm", "stay")
    start = m.start(rates={"turn": 1.0})
    assert abs(np.linalg.norm(start["v"][:2]) - np.hypot(0.08, 0.04)) < 1e-14
    solution = lv.integrate(system, lv.Spark(3), t=(0, 0.2), h=0.01, **start)
    turn = solution.joint("turn")
    assert np.abs(turn.effort + 0.3 * turn.rate).max() < 1e-14
    hooked = urdf(ROBOT, loops=loops).system()
    assert hooked.place("hook").kind == "revolute"
    mimic = ROBOT.replace(
        '<joint name="lean" type="continuous">',
        '<joint name="lean" type="continuous"><mimic joint="lift" multiplier="2" offset="0.1"/>',
    )
    system = urdf(mimic).system()
    row = functions(system)(0, np.arange(len(system.coordinates)), np.zeros(23), [])[3]
    lift, lean = (system.coordinates.index(f"{x}.angle") for x in ("lift", "lean"))
    assert float(row[-1]) == lean - 2 * lift - 0.1


# --- what is refused --------------------------------------------------------------------

PENDULUM = """<mujoco><option {option}/><compiler autolimits="true"/><worldbody>{world}
<body name="arm" {body}><joint name="pin" {joint}/><geom name="rod" size="0.1" {geom}/></body>
<body name="ball" pos="2 0 0"><joint name="socket" type="ball" {ball}/><geom size="0.1" {geom}/>
</body></worldbody>{more}</mujoco>"""
QUIET = 'contype="0" conaffinity="0"'
ACTUATOR = "<actuator>{}</actuator>"
REFUSED = {
    "contact shapes": (
        {"world": '<geom name="edge" type="cylinder" size="1 1"/>', "geom": 'condim="1"'},
        "shapes 'edge.rod' and 'edge.geom2'",
    ),
    "friction of contacts": ({"geom": ""}, "shapes 'rod.geom1'"),
    "limits": ({"ball": 'range="0 1"'}, "ball joints 'socket'"),
    "friction loss": ({"ball": 'frictionloss="0.1"'}, "ball joints 'socket'"),
    "tendons": (
        {"more": '<tendon><fixed name="cord"><joint joint="pin" coef="1"/></fixed></tendon>'},
        "tendons 'cord'",
    ),
    "muscles": (
        {"more": ACTUATOR.format('<muscle name="m" joint="pin" lengthrange="0 1"/>')},
        "actuators 'm'",
    ),
    "activation": (
        {"more": ACTUATOR.format('<intvelocity name="m" joint="pin" actrange="-1 1"/>')},
        "actuators 'm'",
    ),
    "transmissions": (
        {"more": ACTUATOR.format('<motor name="m" joint="socket"/>')},
        "actuators 'm'",
    ),
    "actuator models": (
        {"more": ACTUATOR.format('<motor name="m" joint="pin" damping="0.1"/>')},
        "actuators 'm'",
    ),
    "nonlinear springs": ({"joint": 'stiffness="1 2"'}, "joints 'pin'"),
    "nonlinear damping": ({"joint": 'damping="1 2"'}, "joints 'pin'"),
    "springs of free bodies": (
        {
            "world": '<body><joint name="f" type="free" stiffness="1"/>'
            f'<geom size="1" {QUIET}/></body>'
        },
        "joints 'f'",
    ),
    "fluid": ({"option": 'density="1.2"'}, "fluid"),
    "gravity compensation": ({"body": 'gravcomp="1"'}, "bodies 'arm'"),
    "mocap": ({"world": '<body name="hand" mocap="true"/>'}, "bodies 'hand'"),
}


def pendulum(change):
    parts = dict.fromkeys(("option", "world", "body", "joint", "ball", "more"), "")
    return PENDULUM.format(**{"geom": QUIET, **parts, **change})


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_modelled_is_refused_by_name_or_left_out(name):
    change, where = REFUSED[name]
    text = pendulum(change)
    with pytest.raises(ValueError, match=name) as raised:
        mjcf(text)
    assert where in str(raised.value)
    assert f"hint: leave it out: without=('{name}',)" in str(raised.value)
    m = mjcf(text, without=[name])
    assert m.system().bodies[-2:] == ("arm", "ball")


def test_all_that_is_not_modelled_is_named_at_once():
    cord = '<tendon><fixed name="cord"><joint joint="pin" coef="1"/></fixed></tendon>'
    more = cord + '<equality><tendon name="taut" tendon1="cord"/></equality>'
    text = pendulum({"more": more, "ball": 'range="0 1"'})
    with pytest.raises(ValueError, match="equality constraints \\(constraints 'taut'\\)") as raised:
        mjcf(text, without=["limits"])
    left = "without=('limits', 'tendons', 'equality constraints')"
    assert str(raised.value).endswith(left)


def test_what_the_file_switches_off_is_not_refused():
    parts = {"geom": "", "joint": 'range="-1 1" frictionloss="1" stiffness="1 2"'}
    flags = 'contact="disable" limit="disable" frictionloss="disable" spring="disable"'
    option = f'gravity="0 0 -9"/><option><flag {flags} gravity="disable"/></option><option'
    m = mjcf(pendulum({**parts, "option": option}))
    system = m.system()
    start = m.start(rates={"pin": 1.0, "socket": (0.3, 0, 0)})
    solution = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.1, **start)
    assert np.abs(solution.joint("pin").rate - 1).max() < 1e-14


BAD = {
    "must be a path or its text, not 3": lambda: mjcf(3),
    "MuJoCo does not read 'no.xml'": lambda: mjcf("no.xml"),
    "a file must be a path or its text, not ' '": lambda: mjcf(" "),
    "MuJoCo does not read the text": lambda: mjcf("<mujoco><bad/></mujoco>"),
    "without= has 'contacts', which is": lambda: mjcf(pendulum({}), without=["contacts"]),
    "sequence of names, not 'contact'": lambda: mjcf(pendulum({}), without="contact"),
    "'M', which is no actuator\nhint: actuators are none": lambda: mjcf(
        pendulum({}), controls={"M": 1.0}
    ),
    "control of 'M' must be a finite number": lambda: mjcf(FOURBAR, controls={"M": "a"}),
    "the assembly has no bodies": lambda: mjcf(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", without=["contact"]
    ).system(),
    "loop 'P' has no link 'leg'\nhint: links are world, foot, tower": lambda: urdf(
        ROBOT, loops={"P": ("leg", "arm", (0, 0, 0))}
    ),
    "loop 'P' must be two links and a point, not 'arm'\nhint: write": lambda: urdf(
        ROBOT, loops={"P": "arm"}
    ),
    "point of loop 'P' must be 3 finite numbers": lambda: urdf(
        ROBOT, loops={"P": ("stay", "arm", (0, 0))}
    ),
}


@pytest.mark.parametrize("sentence", BAD)
def test_bad_files_are_refused_with_a_sentence(sentence):
    with pytest.raises((TypeError, ValueError)) as raised:
        BAD[sentence]()
    assert sentence in str(raised.value)


def test_a_missing_mujoco_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"pip install 'liouville\[robots\]'"):
        mjcf(FOURBAR)


def floating(root, child="trunk"):
    """Return a robot of one moving body, on a chain of fixed links, with a link fixed to it."""
    turning = '<inertia ixx=".1" ixy="0" ixz="0" iyy=".2" iyz="0" izz=".25"/>'
    mass = f'<inertial><mass value="{{}}"/>{turning}</inertial>'
    return f"""<robot name="r"><link name="{root}"/><link name="base"/>
<link name="{child}">{mass.format(3)}</link><link name="tip">{mass.format(1)}</link>
<joint name="on" type="fixed"><parent link="{root}"/><child link="base"/></joint>
<joint name="at" type="fixed"><origin xyz="0 0 1"/><parent link="{child}"/><child link="tip"/>
</joint>
<joint name="root" type="floating"><origin xyz="0 1 2"/><parent link="base"/><child link="{child}"/>
</joint></robot>"""


@pytest.mark.parametrize("root", ["world", "base_footprint"])
def test_a_robot_floats_under_any_root(root):
    system = urdf(floating(root)).system()
    assert system.bodies == ("trunk",)
    start = system.assemble()
    np.testing.assert_allclose(start["q"][:3], [0, 1, 2.25], atol=1e-15)
    # its links are known by name all the same, those that moved into others too
    held = urdf(floating(root), loops={"ball": ("tip", "base", (0, 0, 0))})
    start = held.start(rates={"root": (None, None, None, 1.0, 0, 0)})
    end = lv.integrate(held.system(), lv.Spark(3), t=(0, 0.2), h=0.05, **start)
    centre = end.body("trunk").position  # it turns about its tip, which the ground holds
    np.testing.assert_allclose(np.linalg.norm(centre - [0, 1, 3], axis=1), 0.75, rtol=1e-12)
    assert np.abs(centre - centre[0]).max() > 0.01


REPEATED = """<mujoco><worldbody><replicate count="{count}" offset="1 0 0">
<replicate count='{count}'><body><joint/><geom size=".1" contype="0" conaffinity="0"/></body>
</replicate></replicate></worldbody></mujoco>"""


def test_a_file_that_repeats_without_end_is_refused_by_its_size_before_it_is_read(tmp_path):
    def refused(source):
        with pytest.raises(ValueError, match=r"stands for \d+ elements or more, of which 100000"):
            mjcf(source)

    refused(REPEATED.format(count=10_000))
    refused(REPEATED.format(count="&#49;000"))
    refused(f"<mujoco><!-- </replicate> -->{REPEATED.format(count=99_999)}</mujoco>")
    (tmp_path / "inner.xml").write_text(REPEATED.format(count=1000))
    (tmp_path / "outer.xml").write_text("<mujoco><include file='inner.xml'/></mujoco>")
    refused(tmp_path / "outer.xml")
    # each file attaches the one before twice
    (tmp_path / "0.xml").write_text("<mujoco><worldbody><body/></worldbody></mujoco>")
    for k in range(1, 20):
        attached = "".join(f"<attach model='m' prefix='{x}'/>" for x in "ab")
        (tmp_path / f"{k}.xml").write_text(
            f"<mujoco><asset><model name='m' file='{k - 1}.xml'/></asset>"
            f"<worldbody>{attached}</worldbody></mujoco>"
        )
    refused(tmp_path / "19.xml")
    assert len(mjcf(REPEATED.format(count=2)).system().bodies) == 4


def test_text_that_is_no_text_is_refused_with_a_sentence():
    with pytest.raises(ValueError, match=r"MuJoCo does not read .* is no character"):
        mjcf("<mujoco model='\ud800'/>")
