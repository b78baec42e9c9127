"""Assemblies of bodies: against minimal coordinates, Newton and Euler, closed forms, references.

One file, since every kind of joint is held against several of them by the same helpers.
"""

import pickle
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import liouville as lv
from liouville.bodies import rotations as rot
from liouville.problems import (
    bricard,
    hinged_fourbar,
    rigid_chain,
    slider_crank,
    spatial_slider_crank,
)

G = np.array([0.0, 0.0, -9.81])
Z = (0, 0, 1)
CUBE = (0.1, 0.1, 0.1)


def run(system, start, t=1.0, h=0.01, stages=4, **more):
    return lv.integrate(system, lv.Spark(stages), t=(0, t), h=h, **start, **more)


def unit(rng, size=3):
    found = rng.standard_normal(size)
    return found / np.linalg.norm(found)


def off(values, wanted):
    return np.abs(np.asarray(values) - wanted).max()


# --- every kind of joint: Newton and Euler for each body --------------------------------

KINDS = {
    "spherical": lambda rng: {},
    "revolute": lambda rng: {"axis": unit(rng), "damping": 0.2, "spring": 0.5},
    "fixed": lambda rng: {},
    "prismatic": lambda rng: {"axis": unit(rng), "damping": 0.1},
    "cylindrical": lambda rng: {"axis": unit(rng), "damping": (0.1, 0.2)},
    "universal": lambda rng: {"axes": np.linalg.qr(rng.standard_normal((3, 2)))[0].T},
    "planar": lambda rng: {"normal": unit(rng)},
    "screw": lambda rng: {"axis": unit(rng), "lead": 0.7},
    "distance": lambda rng: {"at": (rng.standard_normal(3), rng.standard_normal(3))},
}
DATA = {"a": (1.3, (1.0, 1.5, 2.0)), "b": (0.7, (0.5, 0.7, 0.4))}


def pair(kind, seed=1):
    """Place a body in a ball joint and another on it at random."""
    rng = np.random.default_rng(seed)
    m = lv.bodies.Assembly(gravity=G)
    for name, (mass, inertia) in DATA.items():
        m.body(name, mass=mass, inertia=inertia, at=unit(rng), rotation=unit(rng, 4))
    at = unit(rng)
    m.spherical("S", m.ground, "a", at=at)
    getattr(m, kind)("J", "a", "b", **{"at": unit(rng), **KINDS[kind](rng)})
    system = m.system()
    own = system.place("J").coordinates
    rates = {"J": rng.standard_normal(len(own))} if own else {}
    if kind == "screw":
        rates = {"J": (1.0, None)}
    return system, m.start(rates={"S": unit(rng), **rates})


@pytest.mark.parametrize("kind", KINDS)
def test_forces_in_joints_satisfy_newton_and_euler(kind):
    system, start = pair(kind)
    assert np.linalg.matrix_rank(gradients(system, start)) == len(system.constraints)
    h, weights = 2e-3, np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5])
    solution = run(system, start, t=8 * h, h=h)
    weights = np.concatenate([weights, [0], -weights[::-1]]) / h
    points = system.output("points", system.values(None), 0.0, start["q"], start["v"])
    points = points.reshape(-1, 2, 3)
    wrenches = {name: [np.zeros(3), np.zeros(3)] for name in DATA}
    for k, name in enumerate(system.joints):
        joint, place = solution.joint(name), system.place(name)
        effort = 0.0
        if "angle" in joint.efforts:
            axis = np.array(rot.columns(frame_of(system, solution, place))[2])
            effort = (
                joint.efforts["angle"][4] - 0.5 * (kind == "revolute") * joint.angle[4]
            ) * axis
        push = 0.0
        if "slide" in joint.efforts and kind != "screw":
            axis = np.array(rot.columns(frame_of(system, solution, place, 0))[2])
            push = joint.efforts["slide"][4] * axis
        second = solution.body(system.bodies[place.bodies[1]])
        at = second.point(points[k, 1])[4]
        for side, sign in ((0, -1), (1, 1)):
            if place.bodies[side] < len(system.bodies):
                name = system.bodies[place.bodies[side]]
                force = sign * (joint.force[4] + push)
                arm = at - solution.body(name).position[4]
                wrenches[name][0] += force
                wrenches[name][1] += sign * (joint.torque[4] + effort) + np.cross(arm, force)
    for name, (mass, inertia) in DATA.items():
        body = solution.body(name)
        turns = np.array([np.array(rot.columns(e)).T for e in body.rotation])
        spin = np.einsum("kij,j,klj,kl->ki", turns, inertia, turns, body.angular_velocity)
        force, torque = wrenches[name]
        assert off(weights @ body.velocity * mass, force + mass * G) < 1e-11
        assert off(weights @ spin, torque) < 1e-11
    assert max(np.abs(x).max() for x in solution.residuals.values()) < 1e-14


@pytest.mark.parametrize("kind", ["spherical", "fixed", "revolute"])
def test_the_wrench_of_a_joint_is_read_where_all_of_it_is_known(kind):
    wrenches = []
    for pair in (("flat", "body"), ("body", "flat")):
        m = lv.bodies.Assembly(gravity=G)
        m.planar_body("flat", mass=1.0, inertia=0.1, at=(0, 0))
        m.body("body", mass=2.0, inertia=CUBE, at=(0.3, 0.2, -0.5))
        m.revolute("A", m.ground, "flat", at=(0, 0, 0), axis=Z)
        more = {"axis": Z} if kind == "revolute" else {}
        getattr(m, kind)("J", *pair, at=(0.3, 0, 0), **more)
        solution = run(m.system(), m.start(rates={"A": 2.0}), h=0.02, stages=3)
        joint = solution.joint("J")
        wrenches.append(np.hstack([joint.force, joint.torque]))
        assert joint.is_determined
        assert not solution.joint("A").is_determined  # it bears the weight, and does not know
        assert off(solution.joint("A").force[:, 2], 0) == 0
    assert kind == "spherical" or off(wrenches[0][:, 2], 2.0 * 9.81) < 1e-11  # else it swings
    assert wrenches[0][:, 2].min() > 10
    assert off(wrenches[1], -wrenches[0]) < 1e-10


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_point_mass_that_a_torque_does_not_turn_transmits_it(kind):
    m = lv.bodies.Assembly(gravity=G)
    if kind == "planar":
        m.planar_body("arm", mass=1.0, inertia=0.1, at=(0, 0))
    else:
        m.body("arm", mass=1.0, inertia=CUBE, at=(0, 0, 0))
    m.planar("A", m.ground, "arm", at=(0, 0, 0), normal=Z)
    m.point_mass("bead", mass=2.0, at=(0.5, 0, 0))
    m.prismatic("J", "arm", "bead", axis=(1, 0, 0))
    m.torque("T", "arm", lambda t, angular_velocity, params: (0, 0, 3.0))
    joint = run(m.system(), m.start(), t=0.1).joint("J")
    assert off(joint.force, (0, 0, 2 * 9.81)) < 1e-12
    assert off(joint.torque[:, 2], 3.0) < 1e-12


def gradients(system, start):
    from liouville._systems.mechanics.redundant import _gradients

    return _gradients(system, 0.0, start["q"], start["v"], system.values(None))


def frame_of(system, solution, place, side=1):
    """Return the quaternion of a joint's frame at the fourth step."""
    body = solution.body(system.bodies[place.bodies[side]])
    return rot.product(body.rotation[4], place.frames[side])


# --- trees against minimal coordinates --------------------------------------------------


def test_a_double_pendulum_moves_as_in_its_angles():
    masses, inertias, lengths = (1.0, 2.0), (0.1, 0.3), (1.0, 0.7)

    def lagrangian(t, q, v, params):
        x, y, energy, dx, dy = 0, 0, 0, 0, 0
        for k, (mass, inertia, length) in enumerate(zip(masses, inertias, lengths, strict=True)):
            turned, rate = ca.sum1(q[: k + 1]), ca.sum1(v[: k + 1])
            half = (length / 2 * ca.sin(turned), -length / 2 * ca.cos(turned))
            moving = (-half[1] * rate, half[0] * rate)
            cx, cy = dx + moving[0], dy + moving[1]
            energy += mass * (cx**2 + cy**2) / 2 + inertia * rate**2 / 2
            energy -= mass * 9.81 * (y + half[1])
            x, y, dx, dy = x + 2 * half[0], y + 2 * half[1], dx + 2 * moving[0], dy + 2 * moving[1]
        return energy

    minimal = lv.Lagrangian(lagrangian, q=("a", "b"))
    wanted = run(minimal, {"q": (0.5, 0.8), "v": (2.0, -1.0)})
    for spatial in (True, False):
        m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
        before, place = m.ground, 0.0
        for k, (mass, inertia, length) in enumerate(zip(masses, inertias, lengths, strict=True)):
            at = (0, place - length / 2, 0)
            add = m.body if spatial else m.planar_body
            own = (inertia,) * 3 if spatial else inertia
            body = add(f"rod{k}", mass=mass, inertia=own, at=at if spatial else at[:2])
            m.revolute(f"J{k}", before, body, at=(0, place, 0), axis=Z)
            before, place = body, place - length
        system = m.system()
        start = m.start(values={"J0": 0.5, "J1": 0.8}, rates={"J0": 2.0, "J1": -1.0})
        solution = run(system, start)
        for k in range(2):
            joint = solution.joint(f"J{k}")
            assert off(joint.angle, wanted.q[:, k]) < 1e-12
            assert off(joint.rate, wanted.v[:, k]) < 1e-11


def test_a_universal_joint_and_a_ball_joint_move_as_in_their_angles():
    mass, inertia, arm = 1.2, (0.3, 0.2, 0.1), np.array([0.1, -0.2, -0.6])

    def attitude(angles, axes):
        turned = ca.SX.eye(3)
        for axis, angle in zip(axes, angles, strict=True):
            k = ca.skew(axis)
            turned = turned @ (ca.SX.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * k @ k)
        return turned

    def lagrangian(axes):
        def energy(t, q, v, params):
            turned = attitude(ca.vertsplit(q), axes)
            rate = ca.reshape(ca.jtimes(ca.vec(turned), q, v), 3, 3)
            spin = ca.inv_skew(turned.T @ rate)
            moving = rate @ arm
            return (
                mass * ca.dot(moving, moving) / 2
                + ca.dot(spin, ca.DM(inertia) * spin) / 2
                + mass * ca.dot(G, turned @ arm)
            )

        return energy

    axes = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]], dtype=float)
    for kind, count in (("universal", 2), ("spherical", 3)):
        minimal = lv.Lagrangian(lagrangian(axes[:count]), q=count)
        v = (1.0, 2.0, 0.5)[:count]
        wanted = run(minimal, {"q": (0.0,) * count, "v": v})
        m = lv.bodies.Assembly(gravity=G)
        body = m.body("body", mass=mass, inertia=inertia, at=arm)
        more = {"axes": axes[:2]} if count == 2 else {}
        getattr(m, kind)("J", m.ground, body, at=(0, 0, 0), **more)
        system = m.system()
        rates = v if count == 2 else (v[1], v[0], v[2])
        solution = run(system, m.start(rates={"J": rates}))
        turns = ca.Function(
            "R", [q := ca.SX.sym("q", count)], [attitude(ca.vertsplit(q), axes[:count]) @ arm]
        )
        paths = np.array([np.array(turns(row)).ravel() for row in wanted.q])
        assert off(solution.body("body").position, paths) < 1e-12
        if count == 2:
            for k, name in enumerate(("angle", "second angle")):
                assert off(solution.joint("J").coordinates[name], wanted.q[:, k]) < 1e-12
                assert off(solution.joint("J").rates[name], wanted.v[:, k]) < 1e-11


# --- loops: the references of the library's problems ------------------------------------


def turned_to(axes):
    return rot.of_frame(axes[:, 0], axes[:, 2])


def bars(problem, m, count, mass, length):
    q = np.array(problem.start["q"]).reshape(count, 4, 3)
    r = problem.RADIUS
    for k, (x, *axes) in enumerate(q):
        along, across = r**2 / 2, length[k] ** 2 / 12 + r**2 / 4
        inertia = mass[k] * np.array([along, across, across])
        turned = turned_to(np.array(axes).T)
        m.body(f"bar{k}", mass=mass[k], inertia=inertia, at=x, rotation=turned)
    return q


def check_reference(problem, solution, count):
    for t, wanted in problem.reference.items():
        step = np.argmin(np.abs(solution.t - t))
        q, v = (np.array(wanted[x]).reshape(count, 4, 3) for x in "qv")
        for k in range(count):
            body = solution.body(f"bar{k}")
            assert off(body.position[step], q[k, 0]) < 1e-12
            assert off(body.velocity[step], v[k, 0]) < 1e-11
            assert off(np.array(rot.columns(body.rotation[step])), q[k, 1:]) < 1e-12


def fourbar(lengths=hinged_fourbar.LENGTHS):
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    q = bars(hinged_fourbar, m, 3, hinged_fourbar.MASSES, lengths)
    end = [x + length / 2 * a for (x, a, *_), length in zip(q, hinged_fourbar.LENGTHS, strict=True)]
    m.revolute("A", m.ground, "bar0", at=(0, 0, 0), axis=Z)
    m.revolute("B", "bar0", "bar1", at=end[0], axis=Z)
    m.revolute("C", "bar1", "bar2", at=end[1], axis=Z)
    m.revolute("D", m.ground, "bar2", at=hinged_fourbar.GROUND, axis=Z)
    return m


def test_a_four_bar_of_hinges_in_space_meets_its_reference():
    m = fourbar()
    system = m.system()
    solution = run(system, m.start(rates={"A": 6.0}), h=hinged_fourbar.h)
    check_reference(hinged_fourbar, solution, 3)
    joint = solution.joint("A")
    assert not joint.is_determined
    crank = solution.body("bar0").position
    turned = np.unwrap(np.arctan2(crank[:, 1], crank[:, 0])) - 1.0
    assert off(joint.angle, turned) < 1e-12
    assert joint.angle[-1] > 2 * np.pi


def test_bricards_mechanism_meets_its_reference():
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    q = bars(bricard, m, 5, (1.0,) * 5, (1.0,) * 5)
    before = m.ground
    for k, (x, a, _, c) in enumerate(q):
        m.revolute(f"J{k}", before, f"bar{k}", at=x - a / 2, axis=c)
        before = f"bar{k}"
    m.revolute("J5", before, m.ground, at=(0, 0, 0), axis=Z)
    system = m.system()
    solution = run(system, m.start(rates={"J0": 3.0}), t=0.4, h=bricard.h)
    check_reference(bricard, solution, 5)
    assert solution.invariant_drift("energy").max() < 1e-13


def crank(spatial):
    m = lv.bodies.Assembly(gravity=lambda p: (0, -p.g, 0))
    places = {
        "crank": ("m1", "j1", lambda p: (p.l1 / 2, 0, 0)),
        "rod": ("m2", "j2", lambda p: (p.l1 + p.l2 / 2, 0, 0)),
        "slider": ("m3", "j2", lambda p: (p.l1 + p.l2, 0, 0)),
    }
    for name, (mass, inertia, at) in places.items():
        add = m.body if spatial else m.planar_body
        moment = lambda p, j=inertia: (getattr(p, j),) * 3 if spatial else getattr(p, j)  # noqa: E731
        add(name, mass=lambda p, key=mass: getattr(p, key), inertia=moment, at=at)
    m.revolute("A", m.ground, "crank", at=(0, 0, 0), axis=Z)
    m.revolute("B", "crank", "rod", at=lambda p: (p.l1, 0, 0), axis=Z)
    m.revolute("C", "rod", "slider", at=lambda p: (p.l1 + p.l2, 0, 0), axis=Z)
    m.prismatic("D", m.ground, "slider", axis=(1, 0, 0))
    return m


@pytest.mark.parametrize("spatial", [True, False])
def test_a_slider_crank_with_parameters_meets_its_reference(spatial):
    m = crank(spatial)
    system = m.system(slider_crank.system.params)
    start = m.start(rates={"A": 150.0})
    solution = run(system, start, t=0.1, h=slider_crank.h / 2)
    for t, wanted in slider_crank.reference.items():
        step = np.argmin(np.abs(solution.t - t))
        assert off(solution.joint("A").angle[step], wanted["q"][0]) < 1e-12
        assert off(solution.joint("D").slide[step] + 0.459, wanted["q"][2]) < 1e-12
        assert off(solution.joint("A").rate[step], wanted["v"][0]) < 2e-12 * 150
    if not spatial:
        wanted = lv.integrate(
            slider_crank.system, lv.Spark(4), t=(0, 0.1), h=slider_crank.h / 2, **slider_crank.start
        )
        assert off(solution.joint("D").force[:, 1], guide(wanted)) < 1e-9


def guide(solution):
    """Return the force of the guide on a slider without weight of its own."""
    weight = slider_crank.system.params["m3"] * 9.81
    return weight - solution.lam[:, solution.names["constraints"].index("guide")]


# --- closed forms -----------------------------------------------------------------------


def test_a_slider_crank_in_space_moves_as_published():
    def moved(*rod):
        m = spatial_slider_crank.build(*rod)
        system = m.system(spatial_slider_crank.system.params)
        return run(system, m.start(rates={"A": 6.0}), t=5.0, h=0.005)

    solution = moved()
    slider = solution.body("slider").position[[100, 200, 400], 0]
    assert off(slider, (0.184952803, 0.211754668, 0.289063554)) < 4e-5
    solution = moved((4e-4, 4e-3, 4e-3))
    at = 0.501672241
    crank = solution(at).q[3:5]
    angle = 2 * np.arctan2(crank[1], crank[0])
    assert off(angle % (2 * np.pi), 5.278250602) < 3e-4
    assert off(solution.joint("A").angle[-1], 51.50682085) < 3e-4


def test_the_torque_of_a_prescribed_motion_is_that_of_its_inertia():
    m = lv.bodies.Assembly(gravity=G)
    m.body("rod", mass=1.5, inertia=(0.2, 0.3, 0.1), at=(0, 0, -0.8))
    motion = lambda t, params: params.a * ca.sin(2 * t)  # noqa: E731
    m.revolute("A", m.ground, "rod", at=(0, 0, 0), axis=(0, 1, 0), motion=motion)
    system = m.system({"a": 0.7})
    start = m.start()
    solution = run(system, start)
    joint = solution.joint("A", frame="joint")
    angle = 0.7 * np.sin(2 * solution.t)
    assert off(joint.angle, angle) < 1e-13
    wanted = -(0.3 + 1.5 * 0.8**2) * 4 * angle + 1.5 * 9.81 * 0.8 * np.sin(angle)
    assert off(joint.torque[:, 2], wanted) < 1e-11
    assert off(solution.body("rod").point((0, 0, 0.8)), 0) < 1e-14


def test_a_ball_on_a_turntable_turns_at_two_sevenths_of_its_rate():
    m = lv.bodies.Assembly(gravity=G)
    m.body("table", mass=1.0, inertia=CUBE, at=(0, 0, 0))
    m.body("ball", mass=0.3, inertia=(0.3 * 0.4 * 0.1**2,) * 3, at=(0.5, 0, 0.1))
    m.revolute("A", m.ground, "table", at=(0, 0, 0), axis=Z, motion=lambda t, params: 3.0 * t)
    m.rolling("R", "table", "ball", radius=0.1)
    system = m.system()
    start = m.start(rates={"R": (1.0, 2.0, -3.0)})
    solution = run(system, start, h=0.01, stages=6)
    velocity = solution.body("ball").velocity
    turned = np.exp(2j / 7 * 3.0 * solution.t) * (velocity[0, 0] + 1j * velocity[0, 1])
    assert np.abs(turned[0]) > 0.2
    assert off(velocity[:, 0] + 1j * velocity[:, 1], turned) < 1e-12
    assert off(solution.joint("R").force[:, 2], 0.3 * 9.81) < 1e-12
    assert off(solution.residuals["nonholonomic"], 0) < 1e-13


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_wheel_rolls_down_a_line_in_its_plane(kind):
    slope, mass, moment, radius = 0.3, 2.0, 0.02, 0.2
    up = np.array([-np.sin(slope), np.cos(slope), 0])
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    if kind == "planar":
        m.planar_body("wheel", mass=mass, inertia=moment, at=radius * up[:2])
    else:
        m.body("wheel", mass=mass, inertia=(moment,) * 3, at=radius * up)
    m.rolling("R", m.ground, "wheel", radius=radius, normal=up, axis=Z)
    solution = run(m.system(), m.start())
    down = -9.81 * np.sin(slope) / (1 + moment / (mass * radius**2))
    along = np.array([np.cos(slope), np.sin(slope), 0])
    way = solution.body("wheel").position - radius * up
    assert off(way, down * solution.t[:, None] ** 2 / 2 * along) < 1e-12
    held = mass * 9.81 * np.cos(slope) * up + mass * (down + 9.81 * np.sin(slope)) * along
    assert off(solution.joint("R").force, held) < 1e-11


@pytest.mark.parametrize("low", [0.0, 1e-3])
def test_a_cart_on_two_wheels_rolls_wherever_its_centre_is(low):
    m = lv.bodies.Assembly(gravity=(3.0, 0, -9.81))
    m.body("cart", mass=5.0, inertia=(1, 1, 1), at=(0, 0, 0.2 - low))
    for k, y in enumerate((-0.5, 0.5)):
        m.body(f"wheel{k}", mass=1.0, inertia=(0.01, 0.02, 0.01), at=(0, y, 0.2))
        m.revolute(f"A{k}", "cart", f"wheel{k}", at=(0, y, 0.2), axis=(0, 1, 0))
        m.rolling(f"R{k}", m.ground, f"wheel{k}", radius=0.2, axis=(0, 1, 0))
    solution = run(m.system(), m.start(), stages=3)
    wanted = 3.0 * 7 / (7 + 2 * 0.02 / 0.2**2) * solution.t**2 / 2
    assert off(solution.body("cart").position[:, 0], wanted) < 1e-12 + low**2


def test_eulers_disc_stays_where_it_is():
    tilt, radius, mass = 0.6, 0.2, 1.3
    m = lv.bodies.Assembly(gravity=G)
    thin = mass * radius**2 / 4
    m.body(
        "disc",
        mass=mass,
        inertia=(thin, thin, 2 * thin),
        at=(0, 0, radius * np.sin(tilt)),
        rotation=(np.cos(tilt / 2), 0, np.sin(tilt / 2), 0),
    )
    axis = np.array([np.sin(tilt), 0, np.cos(tilt)])
    m.rolling("R", m.ground, "disc", radius=radius, axis=axis)
    system = m.system()
    speed = np.sqrt(4 * 9.81 / radius / np.sin(tilt)) * np.sin(tilt)
    start = m.start(rates={"R": -speed * np.array([np.cos(tilt), 0, -np.sin(tilt)])})
    solution = run(system, start, t=0.5, h=0.0025)
    disc = solution.body("disc")
    assert off(disc.position, disc.position[0]) < 1e-11
    assert off(solution.joint("R").force, np.array([0, 0, 9.81 * mass])) < 1e-8


@pytest.mark.parametrize(("rate", "h"), [(0.01, 0.001), (3.0, 0.02)])
def test_a_wheel_that_falls_flat_ends_the_run_and_says_so(rate, h):
    m = lv.bodies.Assembly(gravity=G)
    m.body("coin", mass=1.0, inertia=(0.0025, 0.005, 0.0025), at=(0, 0, 0.1))
    m.rolling("R", m.ground, "coin", radius=0.1, axis=(0, 1, 0))
    start = m.start(rates={"R": (rate, 0, 0)})
    with pytest.raises(lv.IntegrationError, match=r"'R\..*\n.*has fallen flat on its plane"):
        lv.integrate(m.system(), lv.Spark(3), t=(0, 3), h=h, **start)


def test_a_bicycle_leans_and_steers_as_its_benchmark_does():
    """The bicycle of meijaard2007 and its linear equations, with the matrices printed there.

    Four bodies, three hinges and two sharp wheels; at 4.6 m/s, from a small rate of lean.
    """
    speed, rate, across = 4.6, 1e-5, (0, 1, 0)
    m = lv.bodies.Assembly(gravity=G)
    wheels = {"rear": (0.0, 0.3, 2.0, 0.0603, 0.12), "front": (1.02, 0.35, 3.0, 0.1405, 0.28)}
    for name, (x, radius, mass, thin, own) in wheels.items():
        m.body(name, mass=mass, inertia=(thin, own, thin), at=(x, 0, radius))
        m.rolling(f"{name} rim", m.ground, name, radius=radius, axis=across)
    frame = np.array([[9.2, 0, -2.4], [0, 11, 0], [-2.4, 0, 2.8]])
    fork = np.array([[0.05892, 0, 0.00756], [0, 0.06, 0], [0.00756, 0, 0.00708]])
    m.body("frame", mass=85.0, inertia=frame, at=(0.3, 0, 0.9))
    m.body("fork", mass=4.0, inertia=fork, at=(0.9, 0, 0.7))
    m.revolute("rear hub", "frame", "rear", at=(0, 0, 0.3), axis=across)
    m.revolute("front hub", "fork", "front", at=(1.02, 0, 0.35), axis=across)
    tilt = np.pi / 10
    m.revolute("steer", "frame", "fork", at=(1.1, 0, 0), axis=(np.sin(tilt), 0, -np.cos(tilt)))
    system = m.system()
    q, v = m.start()["q"], np.zeros(len(system.coordinates))
    for name in system.bodies:
        at = system.coordinates.index(f"{name}.x")
        spin = np.array([rate, speed / wheels[name][1] if name in wheels else 0, 0])
        v[at : at + 3] = np.cross([rate, 0, 0], q[at : at + 3]) + speed * np.eye(3)[0]
        v[at + 4 : at + 7] = spin / 2
    solution = run(system, system.consistent(q=q, v=v, hold="q"), t=2, h=0.01)

    mass = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
    damping = np.array([[0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
    still = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
    moving = np.array([[0, 76.59734589573222], [0, 2.65431523794604]])
    right = np.hstack([-9.81 * still - speed**2 * moving, -speed * damping])
    state = np.vstack([np.eye(2, 4, k=2), np.linalg.solve(mass, right)])
    wanted = [(expm(state * t) @ [0, 0, rate, 0])[1] for t in solution.t]
    assert np.abs(wanted).max() > 0.26 * rate
    assert off(solution.joint("steer").angle, wanted) < 1e-8 * rate


def test_a_bead_slides_down_a_helix_that_stands_on_a_turned_block():
    m = lv.bodies.Assembly(gravity=G)
    m.body("block", mass=1.0, inertia=CUBE, at=(3, 2, 1), rotation=(1, 2, 3, 4))
    m.fixed("F", m.ground, "block")
    m.body("bead", mass=0.5, inertia=CUBE, at=(1, 0, 0))
    m.guide("W", "block", "bead", lambda x, p: [x[0] - ca.cos(2 * x[2]), x[1] - ca.sin(2 * x[2])])
    solution = run(m.system(), m.start(rates={"W": (None, None, 0.3)}))
    height = 0.3 * solution.t - 9.81 / (1 + 4) * solution.t**2 / 2
    assert off(solution.body("bead").position[:, 2], height) < 1e-12
    # the curve carries all but the part of the weight along it
    force = solution.joint("W").force
    rate = 0.3 - 9.81 / 5 * solution.t
    inward = 0.5 * 4 * rate**2
    assert off(np.sum(force**2, axis=1), inward**2 + (0.5 * 9.81) ** 2 * 4 / 5) < 1e-10
    assert off(solution.joint("F").force - force, np.array([0, 0, 9.81])) < 1e-11


def test_gears_racks_and_screws_turn_at_their_ratios():
    m = lv.bodies.Assembly()
    for name, inertia, x in (("one", 0.1, 0.0), ("two", 0.3, 1.0)):
        m.body(name, mass=1.0, inertia=(inertia,) * 3, at=(x, 0, 0))
    m.body("rack", mass=2.0, inertia=CUBE, at=(0, 1, 0))
    torque = lambda t, angle, rate, params: params.T  # noqa: E731
    m.revolute("A", m.ground, "one", at=(0, 0, 0), axis=Z, torque=torque)
    m.revolute("B", m.ground, "two", at=(1, 0, 0), axis=Z)
    m.prismatic("C", m.ground, "rack", axis=(1, 0, 0))
    m.gear("AB", {"A": 20, "B": 31})
    m.gear("BC", {"B": 0.4, "C": -1})
    system = m.system({"T": 5.0})
    solution = run(system, m.start(), t=2.0, h=0.02, stages=6)
    ratio = 20 / 31
    inertia = 0.1 + (0.3 + 2.0 * 0.4**2) * ratio**2
    angle = 5.0 / inertia * solution.t**2 / 2
    assert angle[-1] > 8 * np.pi  # beyond the period of its quaternion
    assert off(solution.joint("A").angle, angle) < 1e-11
    assert off(solution.joint("B").angle, -ratio * angle) < 1e-11
    assert off(solution.joint("C").slide, -0.4 * ratio * angle) < 1e-11
    with pytest.raises(ValueError, match=r"'AB' is .* no joint\nhint: solution\.reaction\('AB'\)"):
        solution.joint("AB")
    assert np.abs(solution.reaction("AB")).max() > 0.1

    # the phase of the teeth is kept, also where the alpha family drives it, and a start follows it
    at = m.start(values={"A": 0.31})
    assert solution.residuals["constraint"].max() < 1e-11
    assert system.nonholonomic == ()
    slow = lv.integrate(system, lv.HHT(), t=(0, 20), h=0.01, every=50, **at)
    assert off(20 * slow.joint("A").angle, -31 * slow.joint("B").angle) < 1e-9
    assert slow.joint("A").angle[0] == pytest.approx(0.31)
    assert slow.joint("A").angle[-1] > 99

    m = lv.bodies.Assembly(gravity=G)
    m.body("nut", mass=2.0, inertia=(0.1, 0.1, 0.05), at=(0, 0, 0))
    m.screw("S", m.ground, "nut", at=(0, 0, 0), axis=Z, lead=0.3)
    system, pitch = m.system(), 0.3 / (2 * np.pi)
    solution = run(system, m.start(), t=3.0, h=0.02, stages=6)
    slide = -2.0 * 9.81 / (2.0 + 0.05 / pitch**2) * solution.t**2 / 2
    assert slide[-1] < -3 * 0.3
    assert off(solution.joint("S").slide, slide) < 1e-11
    assert off(solution.joint("S").angle, slide / pitch) < 1e-10


def test_roundings_of_a_tiny_moment_of_inertia_shorten_no_steps():
    """A rod with 1e-12 of its inertia about its axis takes hundreds of steps, and no million."""
    found = {}
    for moment in (1e-6, 1e-12):
        m = lv.bodies.Assembly(gravity=G)
        m.body("rod", mass=1.0, inertia=(0.1, 0.1, moment), at=(0, 0, -1))
        m.spherical("S", m.ground, "rod", at=(0, 0, 0))
        start = m.start(rates={"S": (1.0, 0.5, 0.0)})
        found[moment] = lv.integrate(m.system(), lv.Spark(4), t=(0, 2), rtol=1e-8, **start)
    places = [run.body("rod").position[-1] for run in found.values()]
    assert off(*places) < 1e-8
    assert found[1e-12].stats["steps"] < 1000


def test_springs_bushings_and_forces_act_as_in_minimal_coordinates():
    # a point mass on a spring with a damper
    m = lv.bodies.Assembly(gravity=G)
    m.point_mass("bob", mass=0.5, at=(0.3, 0, -1))
    m.spring("K", m.ground, "bob", at=((0, 0, 0), (0.3, 0, -1)), stiffness=20, rest=1, damping=0.3)
    system = m.system()
    solution = run(system, m.start())

    def length(q):
        return ca.norm_2(q)

    plain = lv.Lagrangian(
        lambda t, q, v, p: 0.25 * ca.dot(v, v) - 10 * (length(q) - 1) ** 2 + 0.5 * ca.dot(G, q),
        force=lambda t, q, v, p: -0.3 * ca.dot(q, v) / ca.dot(q, q) * q,
        q=3,
    )
    assert off(solution.q, run(plain, {"q": (0.3, 0, -1), "v": (0, 0, 0)}).q) < 1e-13

    # a bushing that a body turns and shifts in, along one axis each
    m = lv.bodies.Assembly()
    m.body("block", mass=2.0, inertia=(0.3, 0.4, 0.5), at=(0, 0, 0))
    values = np.arange(1.0, 7.0)
    m.bushing("N", m.ground, "block", at=(0, 0, 0), stiffness=10 * values, damping=0.1 * values)
    m.cylindrical("J", m.ground, "block", at=(0, 0, 0), axis=(1, 0, 0))
    system = m.system()
    start = m.start(values={"J": (0.9, 0.2)}, rates={"J": (1.0, 0.0)})
    solution = run(system, start, t=0.5)
    # the bushing's frame is the world's as drawn
    plain = lv.Lagrangian(
        lambda t, q, v, p: (
            0.15 * v[0] ** 2 + v[1] ** 2 - 80 * ca.sin(q[0] / 2) ** 2 - 5 * q[1] ** 2
        ),
        force=lambda t, q, v, p: [-0.4 * v[0], -0.1 * v[1]],
        q=2,
    )
    wanted = run(plain, {"q": (0.9, 0.2), "v": (1.0, 0.0)}, t=0.5)
    joint = solution.joint("J")
    assert off(joint.angle, wanted.q[:, 0]) < 1e-12
    assert off(joint.slide, wanted.q[:, 1]) < 1e-12

    # a motor, a spring and a damper on a hinge, a force at the tip and a torque
    m = lv.bodies.Assembly()
    m.body("rod", mass=1.0, inertia=CUBE, at=(0.5, 0, 0))
    motor = lambda t, angle, rate, params: ca.sin(t) * angle - 0.1 * rate  # noqa: E731
    m.revolute(
        "A", m.ground, "rod", at=(0, 0, 0), axis=Z, torque=motor, damping=0.2, spring=3, rest=0.1
    )
    m.force("F", "rod", lambda t, x, v, params: [0, params.F, -v[2]], at=(1, 0, 0))
    m.torque("T", "rod", lambda t, omega, params: -0.05 * omega)
    system = m.system({"F": 2.0})
    solution = run(system, m.start(values={"A": 0.2}))
    plain = lv.Lagrangian(
        lambda t, q, v, p: 0.175 * v[0] ** 2 - 1.5 * (q[0] - 0.1) ** 2,
        force=lambda t, q, v, p: ca.sin(t) * q[0] - 0.35 * v[0] + 2.0 * ca.cos(q[0]),
        q=1,
    )
    wanted = run(plain, {"q": (0.2,), "v": (0.0,)})
    joint = solution.joint("A")
    assert off(joint.angle, wanted.q[:, 0]) < 1e-12
    assert off(joint.effort, np.sin(solution.t) * joint.angle - 0.3 * joint.rate) < 1e-12


# --- starts -----------------------------------------------------------------------------


def test_a_spring_without_length_pulls_through_where_its_points_coincide():
    m = lv.bodies.Assembly(gravity=G)
    m.point_mass("bob", mass=0.5, at=(0, 0, 0))
    m.free("F", "bob")
    m.spring("K", m.ground, "bob", at=((0, 0, 0), (0, 0, 0)), stiffness=50.0, rest=0)
    m.spring("L", m.ground, "bob", at=((0, 0, 1), (0, 0, 0)), stiffness=20.0, rest=1.5)
    solution = run(m.system(), m.start(), stages=6)
    # m z'' = -m g - 50 z - 20 (z + 1.5 - 1), from rest
    wanted = -(9.81 + 20) / 140 * (1 - np.cos(np.sqrt(140) * solution.t))
    assert off(solution.body("bob").position, np.outer(wanted, Z)) < 1e-12
    with pytest.raises(ValueError, match="of spring 'N' coincide: its direction"):
        m.spring("N", "ground", "bob", at=((0, 0, 0),) * 2, stiffness=1, rest=0, damping=0.1)


def test_a_start_closes_loops_with_what_is_given():
    m = fourbar()
    system = m.system()
    for angle in (0.7, -2.0, 4.0):
        start = m.start(values={"A": angle}, rates={"D": 2.0})
        g = system.at_point("node", system.values(None), 0.0, start["q"], np.zeros(23))[:23]
        assert off(g, 0) < 1e-14
        found = system.output("values", system.values(None), 0.0, start["q"], start["v"])[0]
        rates = system.output("rates", system.values(None), 0.0, start["q"], start["v"])[0]
        assert abs(found[0] - angle) < 1e-13
        assert abs(rates[3] - 2.0) < 1e-13
        lv.integrate(system, lv.Spark(2), t=(0, 0.01), h=0.01, **start)


def test_systems_are_pickled_and_run_in_ensembles():
    m = crank(spatial=False)
    system = m.system(slider_crank.system.params)
    copy = pickle.loads(pickle.dumps(system))
    start = copy.assemble(values={"A": 0.3}, rates={"A": 100.0}, params={"l1": 0.1})
    assert off(start["q"], m.start({"A": 0.3}, {"A": 100.0}, params={"l1": 0.1})["q"]) == 0
    speeds = np.array([0.9, 1.1])
    many = lv.ensemble(
        system,
        lv.Spark(3),
        t=(0, 0.01),
        h=1e-3,
        params={"l1": 0.1},
        q=start["q"],
        v=np.outer(speeds, start["v"]),
    )
    with pytest.raises(ValueError, match=r"that of a single run\nhint: .*: solution.member\(0\)"):
        many.joint("A")
    alone = [
        lv.integrate(
            x,
            lv.Spark(3),
            t=(0, 0.01),
            h=1e-3,
            params={"l1": 0.1},
            q=start["q"],
            v=1.1 * start["v"],
        )
        for x in (system, copy)
    ]
    assert (many.q[:, 1] == alone[0].q).all()
    assert (many.member(1).joint("A").angle == alone[0].joint("A").angle).all()
    assert (alone[0].joint("D").force == alone[1].joint("D").force).all()
    with pytest.raises(ValueError, match="there is no joint 'E'\nhint: joints are A, B, C, D"):
        alone[0].joint("E")
    with pytest.raises(AttributeError, match="joint 'D' has no angle\nhint: it has slide"):
        _ = alone[0].joint("D").angle
    with pytest.raises(TypeError, match="knows no bodies and joints"):
        lv.integrate(
            slider_crank.system, lv.Spark(2), t=(0, 1e-3), h=1e-3, **slider_crank.start
        ).joint("A")


def test_bodies_are_imported_where_they_are_used():
    program = (
        "import sys, liouville as lv; assert 'liouville.bodies' not in sys.modules; "
        "lv.bodies.Assembly()"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


# --- prescribed motions, springs of ball joints -----------------------------------------


def test_motions_of_any_coordinate_are_followed_by_the_torques_of_inertia():
    wave = lambda t, params: 0.3 * ca.sin(3 * t)  # noqa: E731
    still = lambda t, params: 0.2 * t  # noqa: E731
    given = {
        "universal": {"at": (0, 0, 0), "axes": ((1, 0, 0), (0, 1, 0)), "motion": (still, wave)},
        "cylindrical": {"at": (0, 0, 0), "axis": Z, "motion": (wave, still)},
        "screw": {"at": (0, 0, 0), "axis": Z, "lead": 0.5, "motion": (None, wave)},
        "planar": {"at": (0, 0, 0), "normal": Z, "motion": (still, None, wave)},
        "compound": {
            "axes": [("turn", (1, 0, 0), (0, 0, 0)), ("slide", Z)],
            "motion": (wave, None),
        },
    }
    for kind, more in given.items():
        m = lv.bodies.Assembly()
        m.body("body", mass=1.0, inertia=(0.3, 0.2, 0.4), at=(0, 0, 0))
        getattr(m, kind)("J", m.ground, "body", **more)
        system = m.system()
        solution = run(system, m.start(), t=0.3)
        joint = solution.joint("J")
        for name, motion in zip(joint.coordinates, more["motion"], strict=True):
            if motion is not None:
                wanted = [float(motion(t, None)) for t in solution.t]
                assert off(joint.coordinates[name], wanted) < 1e-13
    with pytest.raises(ValueError, match="motion= of joint 'K' has two functions\nhint: a screw"):
        m.screw("K", m.ground, "body", at=(0, 0, 0), axis=Z, lead=0.5, motion=(wave, wave))


def test_a_ball_joint_with_a_spring_swings_as_its_angle_does():
    m = lv.bodies.Assembly()
    m.body("ball", mass=1.0, inertia=(0.5, 0.5, 0.5), at=(0, 0, 0))
    m.spherical("S", m.ground, "ball", at=(0, 0, 0), spring=lambda params: params.k)
    # through half of a turn nearly, and through small angles
    start = m.system({"k": 2.0}) and m.start(rates={"S": (0, 3.6, 4.8)})
    solution = run(m.system({"k": 2.0}), start, t=2.0, h=0.02, stages=6)
    wanted = 6.0 / 2.0 * np.sin(2.0 * solution.t)  # 3 rad at most
    turned = 2 * np.arctan2(
        solution.body("ball").rotation[:, 1:] @ (0, 0.6, 0.8), solution.body("ball").rotation[:, 0]
    )
    assert off(turned, wanted) < 1e-9
    assert solution.invariant_drift("energy").max() < 1e-12


def test_controlled_steps_of_a_ball_joint_with_a_spring_end_at_half_a_turn():
    m = lv.bodies.Assembly()
    m.body("ball", mass=1.0, inertia=(0.1, 0.2, 0.25), at=(0, 0, 0))
    m.spherical("S", m.ground, "ball", at=(0, 0, 0), spring=0.1)
    system, start = m.system(), m.start(rates={"S": (1.0, 2.0, 4.0)})
    solution = lv.integrate(system, lv.Spark(4), t=(0, 5), rtol=1e-6, **start)
    turned = solution.body("ball").rotation[:, 0]
    assert (np.diff(np.sign(turned)) != 0).sum() > 2
    assert solution.invariant_drift("energy").max() < 1e-7  # 1e-2 without the ends of steps there


@pytest.mark.parametrize("is_ensemble", [False, True])
def test_equal_steps_past_half_a_turn_of_a_spring_say_so(is_ensemble):
    m = lv.bodies.Assembly()
    m.body("ball", mass=1.0, inertia=(0.5, 0.5, 0.5), at=(0, 0, 0))
    m.spherical("S", m.ground, "ball", at=(0, 0, 0), spring=0.5)
    system = m.system()
    starts = [m.start(rates={"S": (0, 0, rate)}) for rate in (2.0, 4.0)]
    if is_ensemble:  # sin t * rate: the second one passes pi at t = 0.903
        start = {name: np.stack([own[name] for own in starts]) for name in starts[0]}
        run, member = lv.ensemble, " of member 1"
    else:
        start, run, member = starts[1], lv.integrate, ""
    solution = run(system, lv.Spark(3), t=(0, 1), h=0.05, **start)
    assert f"joint 'S'{member} passes half a turn between t = 0.9 and 0.95" in solution.message
    below = lv.integrate(system, lv.Spark(3), t=(0, 3), h=0.05, **starts[0])
    controlled = lv.integrate(system, lv.Spark(3), t=(0, 1), rtol=1e-6, **starts[1])
    assert not below.message
    assert "half a turn" not in controlled.message


@pytest.mark.parametrize("revolute", [False, True])
def test_a_chain_of_bodies_has_programs_no_longer_than_one_by_hand(revolute):
    count = 10
    mass = length = 1 / count
    across, along = mass * length**2 * (3 * 0.25**2 + 1) / 12, mass * length**2 * 0.25**2 / 2
    m = lv.bodies.Assembly(gravity=(0, 0, -1))
    before = m.ground
    for k in range(count):
        at = (0, 0, -(k + 0.5) * length)
        m.body(f"rod{k}", mass=mass, inertia=(across, across, along), at=at)
        add = m.revolute if revolute else m.spherical
        more = {"axis": np.eye(3)[k % 2]} if revolute else {}
        add(f"J{k}", before, f"rod{k}", at=(0, 0, -k * length), **more)
        before = f"rod{k}"
    system, by_hand = m.system(), rigid_chain.build(count, revolute)
    own, wanted = (sum(map(len, x.tapes.values())) for x in (system, by_hand))
    assert own < 0.6 * wanted
    start = rigid_chain.start_for(count, revolute)
    runs = [run(x, start, t=0.02, stages=3) for x in (system, by_hand)]
    assert off(runs[0].q, runs[1].q) < 1e-13


def test_a_beam_bends_and_twists_as_a_cantilever_does():
    load, length, ei, ej = 1e-4, 0.8, 30.0, 70.0
    m = lv.bodies.Assembly()
    m.body("tip", mass=0.5, inertia=(0.1, 0.1, 0.1), at=(length, 0, 0))
    m.force("F", "tip", lambda t, x, v, params: [params.F, params.F, params.F])
    m.torque("T", "tip", lambda t, omega, params: [params.F, 0, 0])
    ends = ((0, 0, 0), (length, 0, 0))
    m.beam(
        "B",
        m.ground,
        "tip",
        at=ends,
        axial=1e3,
        bending=(lambda params: params.ei, ej),
        torsion=20.0,
        across=(1.0, 1.0, 0),
    )
    system = m.system({"F": load, "ei": ei})
    q = lv.analysis.equilibrium(system, **m.start()).start["q"]
    # bent about y by the force along z, about z by that along y
    wanted = (load * length / 1e3, load * length**3 / 3 / ej, load * length**3 / 3 / ei)
    assert q[:3] - (length, 0, 0) == pytest.approx(wanted, rel=1e-6)
    turned = 2 * q[4:]
    slopes = (load * length / 20, -load * length**2 / 2 / ei, load * length**2 / 2 / ej)
    assert turned == pytest.approx(slopes, rel=1e-6)
    with pytest.raises(ValueError, match="the line between the ends of beam 'C' has length zero"):
        m.beam("C", m.ground, "tip", at=(ends[0],) * 2, axial=1, bending=1, torsion=1)


def test_members_start_with_lengths_of_their_own():
    m = lv.bodies.Assembly(gravity=G)
    m.point_mass("bob", mass=1.0, at=lambda p: (p.l, 0, 0))
    m.distance("rod", m.ground, "bob", at=((0, 0, 0), lambda p: (p.l, 0, 0)))
    system = m.system({"l": 1.0})
    start = m.start(params={"l": [1.0, 2.0, 0.5]})
    for k, length in enumerate((1.0, 2.0, 0.5)):
        alone = m.start(params={"l": length})
        assert all(np.array_equal(start[name][k], alone[name]) for name in ("q", "v"))
    many = lv.ensemble(system, lv.Spark(3), t=(0, 1), h=0.1, params={"l": [1.0, 2.0, 0.5]}, **start)
    assert not many.failures
    with pytest.raises(ValueError, match="member 1: "):
        m.start(params={"l": [1.0, 0.0]})
