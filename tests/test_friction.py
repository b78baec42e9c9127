"""Friction in joints: closed forms, its normal force, its order, and what is refused."""

import casadi as ca
import numpy as np
import pytest
from ordinary import solved

import liouville as lv
from liouville.bodies import Coulomb, Stribeck

g = 9.81
MASS, MU, RADIUS, TILT = 2.0, 0.2, 0.3, 0.4
SLOPE = (np.cos(TILT), 0, -np.sin(TILT))
AT = {"at": (0, 0, 0)}


def block(joint, inertia, friction, gravity=(0, 0, -g), **more):
    """Place a body at the origin in one joint of the ground, called J."""
    m = lv.bodies.Assembly(gravity=gravity)
    m.body("block", mass=MASS, inertia=inertia, at=(0, 0, 0))
    getattr(m, joint)("J", m.ground, "block", friction=friction, **more)
    return m


def run(m, rates, t=1.0, h=0.01, stages=3, **more):
    start = m.start(rates=rates, **more)
    return lv.integrate(m.system(), lv.Spark(stages), t=(0, t), h=h, **start)


def falling(t, speed, decay):
    """Return the part of a velocity that is left, where the speed falls at a constant rate."""
    return 1 - decay * t / speed


# kind, inertia, has a radius, more of the joint, rates at first, the part of them that is left
SLIDING = {
    "incline": (
        ("prismatic", (0.1, 0.1, 0.1), False, {"axis": SLOPE}, (1.0,)),
        lambda t: 1 + g * (np.sin(TILT) - MU * np.cos(TILT)) * t,
    ),
    "bearing": (
        ("revolute", (0.3, 0.5, 0.3), True, {**AT, "axis": (0, 1, 0)}, (5.0,)),
        lambda t: falling(t, 5.0, MU * RADIUS * MASS * g / 0.5),
    ),
    "bush": (
        ("cylindrical", (0.2, MASS * RADIUS**2, 0.2), True, {**AT, "axis": (0, 1, 0)}, (8.0, 1.6)),
        lambda t: falling(t, np.hypot(8.0 * RADIUS, 1.6), MU * g),
    ),
    "ball": (
        ("spherical", (0.6, 0.6, 0.6), True, AT, (1.0, 2.0, 2.0)),
        lambda t: falling(t, 3.0, MU * RADIUS * MASS * g / 0.6),
    ),
    "pin of a cross": (
        ("universal", (0.3, 0.5, 0.3), True, {**AT, "axes": ((0, 1, 0), (1, 0, 0))}, (5.0, 0.0)),
        lambda t: falling(t, 5.0, MU * RADIUS * MASS * g / 0.5),
    ),
    "axis of a chain": (
        ("compound", (0.3, 0.5, 0.3), True, {"axes": [("turn", (0, 1, 0), (0, 0, 0))]}, (5.0,)),
        lambda t: falling(t, 5.0, MU * RADIUS * MASS * g / 0.5),
    ),
    "slide of a chain": (
        ("compound", (0.1, 0.1, 0.1), False, {"axes": [("slide", SLOPE)]}, (1.0,)),
        lambda t: 1 + g * (np.sin(TILT) - MU * np.cos(TILT)) * t,
    ),
    "surface": (
        (
            "guide",
            (0.1, 0.2, 0.3),
            False,
            {"equations": lambda position, params: position[2]},
            (3.0, 4.0, 0.0),
        ),
        lambda t: falling(t, 5.0, MU * g),
    ),
    "table": (
        ("planar", (0.1, 0.2, 0.3), False, {**AT, "normal": (0, 0, 1)}, (0.0, 3.0, 4.0)),
        lambda t: falling(t, 5.0, MU * g),
    ),
}


@pytest.mark.parametrize("name", SLIDING)
def test_what_slides_and_turns_is_slowed_at_its_constant_rate(name):
    (kind, inertia, turns, more, rates), wanted = SLIDING[name]
    friction = Coulomb(mu=MU, v_s=1e-4, radius=RADIUS if turns else None)
    solution = run(block(kind, inertia, friction, **more), {"J": rates})
    joint = solution.joint("J")
    for rate, first in zip(joint.rates.values(), rates, strict=True):
        assert np.abs(rate - first * wanted(solution.t)).max() < 1e-12
    assert max(np.abs(x).max() for x in solution.residuals.values()) < 1e-14


def test_a_bead_on_a_ring_that_turns_is_slowed_by_its_velocity_along_it():
    speed, radius, turning = 2.0, 0.8, 1.5

    def ring(position, params):
        return [position[2], ca.norm_2(position) - radius]

    m = lv.bodies.Assembly()
    m.body("ring", mass=1e6, inertia=(1e6, 1e6, 1e6), at=(0, 0, 0))
    m.revolute("axle", m.ground, "ring", **AT, axis=(0, 0, 1), motion=lambda t, p: turning * t)
    m.point_mass("bead", mass=MASS, at=(radius, 0, 0))
    m.guide("J", "ring", "bead", ring, friction=Coulomb(mu=MU, v_s=1e-4))
    solution = run(m, {"J": (0.0, speed, 0.0)}, t=0.5)
    joint = solution.joint("J")
    # N = m (v + Omega R)^2 / R of the velocity v along the ring
    wanted = (speed + turning * radius) / (
        1 + MU * (speed + turning * radius) / radius * solution.t
    ) - turning * radius
    found = np.linalg.norm(np.stack([*joint.rates.values()]), axis=0)
    assert np.abs(found - wanted).max() < 1e-11


@pytest.mark.parametrize("rate", [-5.0, 5.0])
def test_a_nut_with_friction_turns_as_on_an_incline(rate):
    inertia, lead, weight = 0.02, 0.3, MASS * g
    friction = Coulomb(mu=MU, v_s=1e-4, radius=RADIUS)
    m = block("screw", (1, 1, inertia), friction, **AT, axis=(0, 0, 1), lead=lead)
    solution = run(m, {"J": (rate, None)}, t=0.03)
    pitch = lead / (2 * np.pi)
    up = np.sign(rate)
    # m p w' = -W + F (1 - up mu p / r),  I w' = -F (p + up mu r), F along the axis
    share = (1 - up * MU * pitch / RADIUS) / (pitch + up * MU * RADIUS)
    wanted = -weight / (MASS * pitch + inertia * share)
    assert np.abs(solution.joint("J").rates["angle"] - rate - wanted * solution.t).max() < 1e-9


def test_each_axis_of_a_compound_joint_is_pressed_by_the_force_across_it():
    dry = Stribeck(mu=0.4, mu_static=0.6, v_stribeck=0.2, v_s=0.1, radius=0.2)
    axes = [("turn", (0, 1, 0), (0, 0, 0)), ("turn", (1, 0, 0), (0, 0, 0))]
    m = lv.bodies.Assembly(gravity=(0, 0, -g))
    m.body("arm", mass=MASS, inertia=(0.2, 0.3, 0.1), at=(0.1, 0.2, -0.6))
    names = ("pitch", "roll")
    m.compound("J", m.ground, "arm", axes, names=names, friction=(dry, dry), armature=(0.1, 0.1))
    solution = run(m, {"J": (1.0, 2.0)}, t=0.3)
    joint = solution.joint("J")
    pitch = joint.coordinates["pitch"]
    carried = np.stack([np.cos(pitch), 0 * pitch, -np.sin(pitch)], axis=1)
    for name, axis in (("pitch", np.array([[0.0, 1.0, 0.0]])), ("roll", carried)):
        along = (joint.force * axis).sum(axis=1, keepdims=True)
        normal = np.linalg.norm(joint.force - along * axis, axis=1)
        slip = dry.radius * joint.rates[name]
        mu = dry.mu + (dry.mu_static - dry.mu) * np.exp(-((slip / dry.v_stribeck) ** 2))
        wanted = -mu * dry.radius * normal * np.tanh(slip / dry.v_s)
        assert np.abs(joint.efforts[name] - wanted).max() < 1e-12


def test_a_block_that_friction_holds_creeps_below_its_velocity():
    friction = Stribeck(mu=0.3, mu_static=lambda p: p.mu, v_stribeck=10.0, v_s=0.01)
    m = block("prismatic", (0.1, 0.1, 0.1), friction, axis=SLOPE)
    system = m.system({"mu": 0.5})
    solution = lv.integrate(system, lv.Spark(2), t=(0, 0.2), h=2e-3, **m.start())
    rate = solution.joint("J").rate[-1]
    mu = 0.3 + 0.2 * np.exp(-((rate / 10.0) ** 2))
    assert rate == pytest.approx(0.01 * np.arctanh(np.tan(TILT) / mu), rel=1e-9)


def rods(count, friction, planar=True):
    """Rods hinged to one another and to the ground, drawn along x."""
    m = lv.bodies.Assembly(gravity=(0, -g, 0))
    before = m.ground
    for k in range(count):
        add = m.planar_body if planar else m.body
        at = (k + 0.5, 0) if planar else (k + 0.5, 0, 0)
        before_name, own = before, 0.1 if planar else (0.1, 0.1, 0.1)
        add(f"rod{k}", mass=1.0, inertia=own, at=at)
        m.revolute(f"J{k}", before_name, f"rod{k}", at=(k, 0, 0), axis=(0, 0, 1), friction=friction)
        before = f"rod{k}"
    return m


def exerted(friction, joint):
    """Return the torque of friction by the reaction that a run found."""
    slip, normal = friction.radius * joint.rate, np.hypot(*joint.force[:, :2].T)
    mu = friction.mu + (friction.mu_static - friction.mu) * np.exp(
        -((slip / friction.v_stribeck) ** 2)
    )
    return -mu * friction.radius * normal * np.tanh(slip / friction.v_s)


@pytest.mark.parametrize(("count", "planar"), [(3, True), (1, False)])
def test_the_normal_force_is_the_reaction_that_the_method_finds(count, planar):
    friction = Stribeck(mu=0.4, mu_static=0.6, v_stribeck=0.2, v_s=0.1, radius=0.4)
    solution = run(rods(count, friction, planar), {"J0": 1.0}, t=0.4)
    for k in range(count):
        joint = solution.joint(f"J{k}")
        assert np.abs(joint.effort).max() > 0.5
        assert np.abs(joint.effort - exerted(friction, joint)).max() < 1e-12


def test_friction_keeps_the_order_and_the_constraints():
    m = rods(1, Coulomb(mu=0.3, v_s=0.5, radius=0.2))
    runs = [
        run(m, {}, t=0.4, h=h, stages=stages, values={"J0": 0.3})
        for h, stages in ((0.04, 2), (0.02, 2), (0.01, 3))
    ]
    coarse, fine, wanted = (x.joint("J0").angle[-1] for x in runs)
    assert np.log2(abs(coarse - wanted) / abs(fine - wanted)) == pytest.approx(4, abs=0.2)
    for solution in runs:
        assert max(np.abs(x).max() for x in solution.residuals.values()) < 1e-14


AXES = [("turn", (0, 1, 0), (0, 0, 0)), ("slide", (1, 0, 0))]
BOTH = (Coulomb(mu=0.1, v_s=0.1, radius=1),) * 2
BAD = {
    "friction= of joint 'J0' must be a Dry, Coulomb or Stribeck, not 0.2": lambda: rods(1, 0.2),
    "joint 'J0': the joint wants the radius": lambda: rods(1, Coulomb(mu=0.1, v_s=0.1)),
    "slides, and has no radius": lambda: block(
        "prismatic", (1, 1, 1), Coulomb(mu=0.1, v_s=0.1, radius=1), axis=SLOPE
    ),
    "mu= of friction must be zero or positive, not -1": lambda: Coulomb(mu=-1, v_s=0.1),
    "a friction or None for each of turn 1, slide 2": lambda: block(
        "compound", (1, 1, 1), BOTH[0], axes=AXES
    ),
    "friction= of 'slide 2' of joint 'J': the joint slides, and has no radius": lambda: block(
        "compound", (1, 1, 1), BOTH, axes=AXES
    ),
    "v_s= of friction must be positive, not 0": lambda: Coulomb(mu=1, v_s=0),
    "mu_static - mu of friction must be zero or positive, not -0.2": lambda: Stribeck(
        mu=0.3, mu_static=0.1, v_stribeck=0.1, v_s=1e-3
    ),
}


@pytest.mark.parametrize("sentence", BAD)
def test_friction_that_is_none_is_refused(sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        BAD[sentence]()


def test_friction_that_jams_or_has_no_normal_force_is_refused():
    m = rods(1, Coulomb(mu=2.0, v_s=0.1, radius=1.0))
    with pytest.raises(lv.IntegrationError, match="friction in joint 'J0' may jam there"):
        run(m, {"J0": 3.0})
    m = rods(1, Coulomb(mu=0.2, v_s=0.1, radius=0.1), planar=False)
    m.revolute("again", m.ground, "rod0", **AT, axis=(0, 0, 1))
    with pytest.raises(ValueError, match=r"friction in joint 'J0' has no normal force: .* 'again"):
        run(m, {"J0": 1.0})


def test_controlled_steps_end_where_two_slips_reverse_together():
    speed = np.array([1.6, 1.2])
    common = {"at": (0, 0, 0), "friction": Coulomb(mu=0.3, v_s=1e-3)}
    flat = block("planar", (0.1, 0.1, 0.1), normal=(0, 0, 1), spring=(0.0, 200.0, 200.0), **common)
    rail = block("prismatic", (0.1, 0.1, 0.1), axis=(*speed, 0), spring=200.0, **common)
    runs = []
    for m, rate in ((flat, (0.0, *speed)), (rail, np.linalg.norm(speed))):
        start = m.start(rates={"J": rate})
        runs.append(lv.integrate(m.system(), lv.Spark(3), t=(0, 0.5), rtol=1e-7, **start))
    two, one = runs
    assert two.stats["steps"] == pytest.approx(one.stats["steps"], rel=0.1)
    assert np.abs(two.q[-1] - one.q[-1]).max() < 1e-7  # 4e-5 without switches
    slips = [f"slip {k} v_s of J" for k in (1, 3, 8)]
    assert sorted(flat.system().switch_tapes) == ["normal force of J.slide_x", *slips]


def crossed_rails():
    """Return a block that slides across another with friction, and its start."""
    m = lv.bodies.Assembly(gravity=(0, 0, -g))
    m.body("a", mass=2.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    m.body("b", mass=1.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 1))
    dry = Coulomb(mu=0.3, v_s=1e-3)
    m.prismatic("J", m.ground, "a", axis=(1, 0, 0), spring=200.0, friction=dry)
    m.prismatic("K", "a", "b", axis=(0, 1, 0), spring=100.0, friction=dry)
    return m.system(), m.start(rates={"J": 1.0, "K": 0.5})


@pytest.mark.parametrize("rtol", [1e-11, 1e-12])
def test_roundoff_of_what_joints_hold_is_no_kink_of_friction(rtol):
    """Velocities of shorter steps have more of it, and the run asked for steps of 1e-14 s."""
    system, start = crossed_rails()
    found = lv.integrate(system, lv.Spark(5), t=(0, 1), rtol=rtol, **start)
    assert found.status == "done"
    assert found.stats["steps"] < 1000


def test_a_tolerance_near_roundoff_is_named_where_steps_become_too_short():
    system, start = crossed_rails()
    call = {"t": (0, 1), "control": lv.Adaptive(h_min=1e-3), **start}
    hint = "coordinates near zero are held to atol = rtol / 1000 = 1e-14"
    with pytest.raises(lv.IntegrationError, match=f"less than h_min\nhint: .*{hint}"):
        lv.integrate(system, lv.Spark(3), rtol=1e-11, **call)
    for more in ({"rtol": 1e-6}, {"rtol": 1e-11, "atol": 1e-9}):
        with pytest.raises(lv.IntegrationError, match="less than h_min") as caught:
            lv.integrate(system, lv.Spark(3), **more, **call)
        assert "roundoff" not in str(caught.value)


@pytest.mark.parametrize("is_planar", [True, False])
def test_controlled_steps_end_where_a_normal_force_turns(is_planar):
    """A pendulum that swings over lifts its cart: the size of N has a kink at zero."""
    m = lv.bodies.Assembly(gravity=(0, -g, 0))
    if is_planar:
        m.planar_body("cart", mass=1.0, inertia=0.1, at=(0, 0))
        m.planar_body("bob", mass=2.0, inertia=0.02, at=(0, -0.5))
    else:
        m.body("cart", mass=1.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
        m.body("bob", mass=2.0, inertia=(0.01, 0.01, 0.02), at=(0, -0.5, 0))
    m.prismatic("J", m.ground, "cart", axis=(1, 0, 0), friction=Coulomb(mu=0.3, v_s=1e-2))
    m.revolute("P", "cart", "bob", at=(0, 0, 0), axis=(0, 0, 1))
    system, start = m.system(), m.start(rates={"J": 0.5, "P": 14.0})
    fine = lv.integrate(system, lv.Spark(4), t=(0, 1), h=5e-5, every=20000, **start)
    found = lv.integrate(system, lv.Spark(3), t=(0, 1), rtol=1e-9, **start)
    sides = np.sign(found.joint("J").force[:, 1])
    assert sides.min() < 0 < sides.max()
    assert np.abs(found.q[-1] - fine.q[-1]).max() < 1e-7  # 5e-5 without that switch
    assert "normal force of J.slide" in system.switch_tapes


@pytest.mark.parametrize(("mass", "length", "time"), [(1e-9, 1.0, 1.0), (1e6, 1e3, 10.0)])
def test_small_and_large_blocks_slide_as_others(mass, length, time):
    fall = 9.81 * length / time**2
    m = lv.bodies.Assembly(gravity=(0, 0, -fall))
    inertia = (1e-7 * mass * length**2,) * 3
    m.body("block", mass=mass, inertia=inertia, at=(0, 0, 0))
    dry = Coulomb(mu=0.2, v_s=1e-4 * length / time)
    m.prismatic("J", m.ground, "block", axis=(1, 0, 0), friction=dry)
    speed = 0.01 * length / time
    solution = run(m, {"J": speed}, t=1e-4 * time, h=1e-5 * time)
    joint = solution.joint("J")
    assert joint.rate[-1] == pytest.approx(speed - 0.2 * fall * 1e-4 * time, rel=1e-9)
    assert joint.effort == pytest.approx(-0.2 * mass * fall, rel=1e-9)


@pytest.mark.parametrize(("mu", "jams"), [(0.7, False), (1.3, True)])
def test_near_jamming_the_law_holds_or_the_run_ends(mu, jams):
    dry, pin = Coulomb(mu=mu, v_s=0.01, radius=0.05), {"axis": (0, 0, 1)}
    crank = 0.1 * np.array([np.cos(1.6), np.sin(1.6)])
    tilt = np.arcsin(crank[1] / 0.35)
    end = crank[0] + 0.35 * np.cos(tilt)
    m = lv.bodies.Assembly(gravity=(0, -g, 0))
    m.planar_body("c", mass=1.2, inertia=0.001, at=crank / 2, angle=1.6)
    middle = ((crank[0] + end) / 2, crank[1] / 2)
    m.planar_body("d", mass=0.8, inertia=0.008167, at=middle, angle=-tilt)
    m.planar_body("s", mass=0.5, inertia=0.01, at=(end, 0))
    motor = {"torque": lambda t, angle, rate, params: 3.0}
    m.revolute("O", m.ground, "c", at=(0, 0, 0), friction=dry, **pin, **motor)
    m.revolute("P", "c", "d", at=(*crank, 0), friction=dry, **pin)
    m.revolute("Q", "d", "s", at=(end, 0, 0), friction=dry, **pin)
    slide = Coulomb(mu=mu, v_s=0.01)
    m.prismatic("S", m.ground, "s", axis=(1, 0, 0), friction=slide)
    if jams:
        with pytest.raises(lv.IntegrationError, match="'Q' and 'S' may jam there") as failed:
            run(m, {"O": 3.0}, t=0.25, h=0.0005, stages=2)
        solution = failed.value.solution
    else:
        solution = run(m, {"O": 3.0}, t=0.25, h=0.0005, stages=2)
    joint = solution.joint("Q")
    wanted = -mu * 0.05 * np.linalg.norm(joint.force, axis=1) * np.tanh(0.05 * joint.rate / 0.01)
    assert np.abs(joint.effort - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_a_zero_is_looked_for_in_a_shorter_step_where_a_part_cannot_be_made():
    """A block that friction stops, with a force that turns within 1e-7 m/s: x = v^2 / (2 mu g)."""
    width, force = 1e-7, 1.962
    edges = {f"{k}": lambda t, q, v, params, k=k: v[0] - k * width for k in (-8, -3, -1, 1, 3, 8)}
    block = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=("x",),
        force=lambda t, q, v, params: -force * ca.tanh(v[0] / width),
        switches=edges,
    )
    run = lv.integrate(block, lv.Spark(3), t=(0, 0.1), rtol=1e-4, q=[0.0], v=[0.01])
    np.testing.assert_allclose(run.q[-1], 0.01**2 / (2 * force), rtol=1e-4)
    assert run.stats["steps"] < 100


@pytest.mark.parametrize("kind", ["prismatic", "planar", "revolute"])
def test_friction_that_a_force_across_the_plane_presses_is_refused(kind):
    def start(gravity):
        m = lv.bodies.Assembly(gravity=gravity)
        m.planar_body("b", mass=MASS, inertia=0.1, at=(0, 0))
        friction = Coulomb(mu=MU, v_s=1e-3, radius=RADIUS if kind == "revolute" else None)
        axis = {"planar": {"normal": (0, 0, 1)}, "prismatic": {"axis": (1, 0, 0)}}
        more = axis.get(kind, {"axis": (0, 0, 1)})
        getattr(m, kind)("J", m.ground, "b", **AT, friction=friction, **more)
        return m.start()

    across, along = (0, 0, -g), (0, -g, 0)
    if kind == "revolute":  # what acts along a pin does not press it
        assert start(across)["q"] == pytest.approx(0)
    else:
        with pytest.raises(ValueError, match="joint 'J': planar bodies do not know the force"):
            start(across)
    if kind == "prismatic":
        assert start(along)["q"] == pytest.approx(0)


def test_steps_to_a_loose_tolerance_stick_and_slip_on_a_belt():
    """Steps that only continuation would solve, in minutes each, are shortened."""
    m = lv.bodies.Assembly(gravity=(0, 0, -g))
    m.body("b", mass=1, inertia=(0.1,) * 3, at=(0, 0, 0))
    m.body("belt", mass=5, inertia=(1,) * 3, at=(0, 0, -0.5))
    m.prismatic("drive", m.ground, "belt", axis=(1, 0, 0), motion=lambda t, p: 0.2 * t)
    rough = Stribeck(mu=0.2, mu_static=0.4, v_stribeck=0.05, v_s=1e-3)
    m.prismatic("rub", "belt", "b", axis=(1, 0, 0), friction=rough)
    m.spring("s", m.ground, "b", at=((-1, 0, 0), (0, 0, 0)), stiffness=30.0)
    call = {"t": (0, 2), **m.start(rates={"rub": 0.0})}
    fine = lv.integrate(m.system(), lv.Spark(2), h=0.002, every=1000, **call)
    loose = lv.integrate(m.system(), lv.Spark(3), rtol=1e-4, **call)
    assert loose.stats["steps"] < 80
    assert np.abs(loose.q[-1] - fine.q[-1]).max() < 1e-3


@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
@pytest.mark.parametrize(
    "method", [lv.ArnoldBruls(), lv.HHT(), lv.GeneralizedAlpha(), lv.Spark(2), lv.Spark(3)]
)
def test_controlled_steps_of_a_block_that_sticks_and_slips(method, rtol):
    """Steps that a switch has cut short leave no roundoff of theirs to the next ones."""
    m = lv.bodies.Assembly(gravity=(0, -g, 0))
    m.planar_body("belt", mass=5.0, inertia=1.0, at=(0, 0))
    m.planar_body("block", mass=1.0, inertia=0.01, at=(0, 0.1))
    dry = Stribeck(mu=0.2, mu_static=0.4, v_stribeck=0.1, v_s=2e-3)
    m.prismatic("drive", m.ground, "belt", axis=(1, 0, 0), motion=lambda t, params: 0.2 * t)
    m.prismatic("contact", "belt", "block", at=(0, 0, 0), axis=(1, 0, 0), friction=dry)
    m.spring("spring", m.ground, "block", at=((-0.5, -0.1, 0), (0, 0.1, 0)), stiffness=100.0)
    solution = lv.integrate(m.system(), method, t=(0, 4), rtol=rtol, **m.start())
    assert solution.status == "done"
    # by Spark(4) at rtol=1e-10
    assert solution.body("block").position[-1, 0] == pytest.approx(0.036646063, abs=60 * rtol**0.75)
    assert np.abs(solution.body("belt").velocity[:, 1]).max() < 1e-14


def test_controlled_steps_see_friction_fall_with_the_slip():
    """Over v_stribeck friction changes faster than a motion at metres a second lets expect."""
    m = lv.bodies.Assembly(gravity=(0, -g, 0))
    m.planar_body("cart", mass=2.0, inertia=0.1, at=(0, 0))
    m.planar_body("block", mass=1.0, inertia=0.1, at=(0, 0.5))
    dry = Stribeck(mu=0.2, mu_static=0.35, v_stribeck=0.1, v_s=1e-3)
    m.prismatic("drive", m.ground, "cart", axis=(1, 0, 0), force=lambda t, *_: 40 * ca.sin(3 * t))
    m.prismatic("top", "cart", "block", axis=(1, 0, 0), friction=dry)
    start = m.start(rates={"drive": 0.3, "top": -0.2})
    found = lv.integrate(m.system(), lv.Spark(3), t=(0, 3), rtol=1e-9, **start)

    def law(t, y):
        slip = y[3]
        mu = 0.2 + 0.15 * np.exp(-((slip / 0.1) ** 2))
        rub = -mu * g * np.tanh(slip / 1e-3)
        push = (40 * np.sin(3 * t) - rub) / 2
        return [y[2], slip, push, rub - push]

    exact = solved(law, (0, 3), [0, 0, 0.3, -0.2])[-1]
    motion = [found.joint(name).coordinates["slide"][-1] for name in ("drive", "top")]
    assert np.abs(motion - exact[:2]).max() < 3e-8  # 4e-6 where steps pass over its fall
    assert found.stats["steps"] < 500


def driven(kinds, planar, **motions):
    """Return two rods with friction whose joints are driven, or free without motions."""
    dry = {
        "revolute": Coulomb(mu=0.3, v_s=0.01, radius=0.1),
        "prismatic": Coulomb(mu=0.3, v_s=0.01),
    }
    m = lv.bodies.Assembly(gravity=(0, -g, 0))
    before = m.ground
    for k, kind in enumerate(kinds):
        name, at = f"rod{k}", (k + 0.5, 0.3 * k)
        if planar:
            m.planar_body(name, mass=1.0, inertia=0.1, at=at)
        else:
            m.body(name, mass=1.0, inertia=(0.1, 0.1, 0.1), at=(*at, 0))
        where = {"at": (k, 0, 0), "motion": motions.get(f"J{k}")}
        if kind == "compound":
            axes = [("turn", (0, 0, 1), (k, 0, 0))]
            where = {"motion": [where["motion"]], "names": ["J"]}
            m.compound(f"J{k}", before, name, axes, friction=[dry["revolute"]], **where)
        else:
            axis = (0, 0, 1) if kind == "revolute" else (1, 0, 0)
            getattr(m, kind)(f"J{k}", before, name, axis=axis, friction=dry[kind], **where)
        before = name
    return m


@pytest.mark.parametrize(
    ("kinds", "planar"),
    [
        (("revolute", "revolute"), True),
        (("revolute", "prismatic"), False),
        (("prismatic", "revolute"), True),
        (("compound", "revolute"), False),
    ],
)
def test_inverse_dynamics_presses_friction_by_the_efforts_that_it_finds(kinds, planar):
    """Normal forces without efforts would leave the torques of two hinges off by up to 0.25."""
    ways = {"J0": lambda t, p: ca.sin(3 * t) / 4, "J1": lambda t, p: ca.cos(4 * t) / 8}
    m = driven(kinds, planar, **ways)
    motion = lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.02, **m.start())
    system = driven(kinds, planar).system()
    found = lv.analysis.inverse_dynamics(system, motion, ["J0", "J1"])
    for name, kind in zip(("J0", "J1"), kinds, strict=True):
        joint = motion.joint(name)
        wanted = joint.force[:, 0] if kind == "prismatic" else joint.torque[:, 2]
        if kind == "prismatic":  # along an axis that turns with the first rod
            e0, e3 = motion.body("rod0").rotation[:, [0, 3]].T
            x, y = 1 - 2 * e3**2, 2 * e0 * e3
            wanted = joint.force[:, 0] * x + joint.force[:, 1] * y if name == "J1" else wanted
        if kind == "compound":
            wanted = wanted - joint.effort
        assert np.abs(joint.effort).max() > 0.1
        assert found.efforts[name] == pytest.approx(wanted, abs=1e-11)


def test_inverse_dynamics_refuses_friction_that_jams_or_has_no_normal_force():
    tight = rods(1, Coulomb(mu=2.0, v_s=0.1, radius=1.0)).system()
    angle = np.linspace(0, 1, 5)
    x, y, zero, one = np.cos(angle) / 2, np.sin(angle) / 2, np.zeros(5), np.ones(5)
    turn = {  # three radians per second
        "t": angle / 3,
        "q": np.column_stack([x, y, angle]),
        "v": 3 * np.column_stack([-y, x, one]),
        "acceleration": -9 * np.column_stack([x, y, zero]),
    }
    # a motor in the joint presses nothing, a push at the rod presses more than it overcomes
    lv.analysis.inverse_dynamics(tight, turn, ["J0"])
    with pytest.raises(ValueError, match="friction jams at t = 0: no efforts make this motion"):
        lv.analysis.inverse_dynamics(tight, turn, ["rod0.y"])
    m = rods(1, Coulomb(mu=0.2, v_s=0.1, radius=0.1), planar=False)
    m.revolute("again", m.ground, "rod0", **AT, axis=(0, 0, 1))
    state = {name: x[None] for name, x in m.start().items()}
    still = {"t": [0.0], **state, "acceleration": np.zeros((1, 7))}
    with pytest.raises(ValueError, match=r"friction in joint 'J0' has no normal force: .* 'again"):
        lv.analysis.inverse_dynamics(m.system(), still, ["J0"])
