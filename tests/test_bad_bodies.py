"""Assemblies that are no mechanisms are refused with a sentence that names joints and bodies."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from test_bodies import CUBE, G, Z, fourbar

import liouville as lv


def rods(*points, pins=None):
    """Rods between points in the plane, hinged to one another, and to the ground at both ends."""
    m = lv.bodies.Assembly()
    before = m.ground
    for k, (a, b) in enumerate(pairwise(points)):
        m.body(f"rod{k}", mass=1.0, inertia=CUBE, at=(np.add(a, b) / 2))
        m.revolute(f"J{k}", before, f"rod{k}", at=(pins or {}).get(k, a), axis=Z)
        before = f"rod{k}"
    m.revolute("end", before, m.ground, at=points[-1], axis=Z)
    return m


@pytest.mark.parametrize(
    ("points", "pins", "sentence"),
    [
        (((0, 0, 0), (1, 1, 0), (2, 0, 0)), None, "no freedom: joints 'J0', 'J1' and 'end'"),
        (((0, 0, 0), (1, 0, 0), (2, 0, 0)), None, "first-order mobility only"),
        (
            ((0, 0, 0), (1, 1, 0), (2, 0, 0)),
            {1: ((9.0, 0, 0), (1.0, 1, 0))},
            "the loop through 'J0', 'J1' and 'end' cannot be closed",
        ),
    ],
)
def test_a_mechanism_that_cannot_move_or_be_closed_is_refused(points, pins, sentence):
    with pytest.raises(ValueError, match=sentence):
        rods(*points, pins=pins).start()


def test_starts_refuse_what_contradicts_the_joints():
    m = fourbar()
    with pytest.raises(ValueError, match="rates given contradict"):
        m.start(rates={"A": 1.0, "D": 1.0})
    with pytest.raises(ValueError, match=r"loop through|values given contradict"):
        m.start(values={"A": 0.5, "D": 3.0})
    with pytest.raises(ValueError, match="no joint 'E'\nhint: joints are A, B, C, D"):
        m.start(values={"E": 0.5})
    with pytest.raises(ValueError, match="coordinates angle, and 2 of them"):
        m.start(values={"A": (0.5, 1.0)})
    with pytest.raises(
        ValueError, match="1e\\+09 away from the places as drawn\\nhint: angles are in"
    ):
        m.start(values={"A": 1e9})
    with pytest.raises(ValueError, match="rates of joint 'A' must be a finite number"):
        m.start(rates={"A": np.nan})


# --- calls ------------------------------------------------------------------------------


def base():
    m = lv.bodies.Assembly(gravity=G)
    m.body("rod", mass=1.0, inertia=CUBE, at=(0, 0, -1))
    return m


AT = {"at": (0, 0, 0)}
BAD = {
    "at= of joint 'A' must be 3 finite": lambda m: m.spherical(
        "A", m.ground, "rod", at=(0, np.inf, 0)
    ),
    "at= of joint 'A' must be a place in space, not .0, 0.\nhint: give three": lambda m: (
        m.spherical("A", m.ground, "rod", at=(0, 0))
    ),
    "axis of joint 'A' has length": lambda m: m.revolute(
        "A", m.ground, "rod", **AT, axis=(0, 0, 0)
    ),
    "which is no body\nhint: there are 'ground' and 'rod'": lambda m: m.fixed("A", "rob", "rod"),
    "belongs to another assembly": lambda m: m.fixed("A", base().ground, "rod"),
    "joins 'rod' with itself": lambda m: m.fixed("A", "rod", "rod"),
    "there is a body called 'rod' already": lambda m: m.free("rod", "rod"),
    "rod' is not connected with the ground\nhint": lambda m: m.system(),
    "inertia of body 'b' is that of no body": lambda m: m.body(
        "b", mass=1, inertia=(1, 1, 2.1), at=(0, 0, 0)
    ),
    "principal moments, not 0": lambda m: m.body("b", mass=1, inertia=(1, 1, 0), at=(0, 0, 0)),
    "mass of body 'b' must be positive, not -1": lambda m: m.point_mass("b", mass=-1, at=(0, 0, 0)),
    "rotation of body 'b' has length zero": lambda m: m.body(
        "b", mass=1, inertia=CUBE, at=(0, 0, 0), rotation=(0, 0, 0, 0)
    ),
    "damping= of joint 'A' must be zero or positive, not -1": lambda m: m.revolute(
        "A", m.ground, "rod", **AT, axis=Z, damping=-1
    ),
    "damping= of joint 'A' must be a value for each": lambda m: m.cylindrical(
        "A", m.ground, "rod", **AT, axis=Z, damping=1.0
    ),
    "do not cross at a right angle": lambda m: m.universal(
        "A", m.ground, "rod", **AT, axes=((1, 0, 0), (1, 1, 0))
    ),
    "length= of joint 'A' is 0": lambda m: m.distance("A", m.ground, "rod", at=((0, 0, 0),) * 2),
    "lies flat on its plane": lambda m: m.rolling("A", m.ground, "rod", radius=1, axis=Z),
    "gear 'A' has no joint 'B'": lambda m: m.gear("A", {"B": 1, "C": 2}),
    "gear 'G' has two factors for 'angle' of joint 'A'": lambda m: (
        m.revolute("A", m.ground, "rod", **AT, axis=Z),
        m.gear("G", {"A": 20, ("A", "angle"): 31}),
    ),
    "factor of joint 'A' in gear 'G' must not be zero": lambda m: (
        m.cylindrical("A", m.ground, "rod", **AT, axis=Z),
        m.gear("G", {"A": 0, ("A", "slide"): 31}),
    ),
    "by= of coupling 'C' must be 1 finite numbers": lambda m: (
        m.cylindrical("A", m.ground, "rod", **AT, axis=Z),
        m.couple("C", "A", ("A", "slide"), by=()),
    ),
    "by= of coupling 'C' must be 4 finite numbers": lambda m: (
        m.cylindrical("A", m.ground, "rod", **AT, axis=Z),
        m.couple("C", "A", ("A", "slide"), by=np.eye(2)),
    ),
    "lead= of joint 'A' is zero": lambda m: m.screw("A", m.ground, "rod", **AT, axis=Z, lead=0),
    "points of spring 'K' coincide": lambda m: m.spring(
        "K", m.ground, "rod", at=((0, 0, 0),) * 2, stiffness=1
    ),
    "would turn 'p', a point mass, which cannot\nhint: take a body": lambda m: m.revolute(
        "A", m.ground, m.point_mass("p", mass=1, at=(1, 0, 0)), **AT, axis=Z
    ),
    "not <Assembly of 1 body and 0 joints>\nhint: take its system": lambda m: lv.integrate(
        m, lv.Spark(2), t=(0, 1), h=0.1
    ),
    "joint 'A' of 'ground' and 'p' does not fit how these bodies move\nhint: planar": lambda m: (
        m.rolling("A", m.ground, m.planar_body("p", mass=1, inertia=1, at=(0, 0)), radius=1)
    ),
    "damping= of spring 'K' must be zero or positive, not -1": lambda m: m.damper(
        "K", m.ground, "rod", at=((0, 0, 0), (1, 0, 0)), damping=-1
    ),
    "rest= of spring 'K' must be zero or positive, not -1": lambda m: m.spring(
        "K", m.ground, "rod", at=((0, 0, 0), (1, 0, 0)), stiffness=1, rest=-1
    ),
    "damping= of bushing 'K' must have no negative eigenvalue, and has -1": lambda m: m.bushing(
        "K", m.ground, "rod", **AT, stiffness=np.ones(6), damping=(1, 1, 1, 1, 1, -1)
    ),
    "stiffness= of bushing 'K' must be symmetric": lambda m: m.bushing(
        "K", m.ground, "rod", **AT, stiffness=1e-9 * (np.eye(6) + np.eye(6, k=1) / 2)
    ),
    "stiffness of bushing 'K' must be symmetric": lambda m: (
        m.bushing(
            "K",
            m.ground,
            "rod",
            **AT,
            stiffness=lambda p: [
                [p.k * ((i == j) + (i < j) / 2) for i in range(6)] for j in range(6)
            ],
        ),
        m.system(params={"k": 1.0}),
    ),
    "stiffness of bushing 'K' must be 6 or 36 finite numbers": lambda m: (
        m.bushing("K", m.ground, "rod", **AT, stiffness=lambda p: [p.k] * 3),
        m.system(params={"k": 1.0}),
    ),
    "damping of beam 'K' must have no negative eigenvalue, and has -15.2": lambda m: (
        m.beam(
            "K",
            m.ground,
            "rod",
            at=((0, 0, 0), (1, 0, 0)),
            axial=12,
            bending=1,
            torsion=1,
            damping=lambda p: p.c,
        ),
        m.system(params={"c": -1.0}),
    ),
    "bending= of beam 'K' must be zero or positive, not -1": lambda m: m.beam(
        "K", m.ground, "rod", at=((0, 0, 0), (1, 0, 0)), axial=1, bending=(1, -1), torsion=1
    ),
    "damping of joint 'A' must be zero or positive, not -1": lambda m: (
        m.revolute("A", m.ground, "rod", **AT, axis=Z, damping=lambda p: p.c),
        m.system(params={"c": -1.0}),
    ),
    "motion= of joint 'A' must be a function": lambda m: m.revolute(
        "A", m.ground, "rod", **AT, axis=Z, motion=1.0
    ),
}


@pytest.mark.parametrize("sentence", BAD)
def test_bad_calls_are_refused_with_a_sentence(sentence):
    with pytest.raises((ValueError, TypeError), match=sentence):
        BAD[sentence](base())


def test_functions_of_joints_are_refused_by_name():
    m = base()
    m.revolute("A", m.ground, "rod", **AT, axis=Z, damping=lambda params: params.c)
    with pytest.raises(
        ValueError, match="damping of joint 'A': there is no parameter 'c'; the sys"
    ):
        m.system({"d": 1.0})
    m = base()
    with pytest.raises(ValueError, match="torque of joint 'A' contains the constant nan") as raised:
        m.revolute("A", m.ground, "rod", **AT, axis=(0, 1, 0), torque=lambda t, x, v, p: float(x))
    assert not hasattr(raised.value, "__notes__")
    m = base()
    m.revolute("A", m.ground, "rod", **AT, axis=(0, 1, 0), motion=lambda t, params: 2 * t)
    with pytest.raises(ValueError, match="joint 'A' cannot be where its motion= has it at t = 0"):
        m.start(values={"A": 1.0})
    m = lv.bodies.Assembly()
    m.planar_body("plate", mass=1.0, inertia=1.0, at=(0, 0))
    with pytest.raises(ValueError, match="joint 'A' of 'ground' and 'plate' does not fit"):
        m.revolute("A", m.ground, "plate", **AT, axis=(1, 0, 0))
    with pytest.raises(ValueError, match="the assembly has no bodies"):
        lv.bodies.Assembly().system()


def test_runs_refuse_parameters_that_make_no_body():
    m = lv.bodies.Assembly(gravity=G)
    m.body("a", mass=lambda p: p.m, inertia=lambda p: [p.J, 1, 1], at=(0, 0, -1))
    m.spherical("A", m.ground, "a", at=(0, 0, 0))
    system = m.system(params={"m": 1.0, "J": 1.0})
    call = {"t": (0, 1), "h": 0.1, **m.start()}
    with pytest.raises(ValueError, match="mass of body 'a' must be positive, not -1"):
        lv.integrate(system, lv.Spark(2), params={"m": -1.0}, **call)
    with pytest.raises(ValueError, match="member 1: inertia of body 'a' is that of no body"):
        lv.ensemble(system, lv.Spark(2), params={"J": [1.0, 3.0]}, **call)
    with pytest.raises(ValueError, match="member 0: parameter 'm' must be finite"):
        lv.ensemble(system, lv.Spark(2), params={"m": [np.nan, 1.0]}, **call)
    assert lv.integrate(system, lv.Spark(2), params={"m": 2.0, "J": 0.5}, **call).status == "done"


LINE = ((0, 0, 0), (1, 0, 0))


def lopsided(x):
    """Return a matrix that is symmetric for x = 1."""
    return ca.SX(np.eye(6)) + (1 - x) * ca.SX(np.eye(6, k=1))


#: How a joint or a spring takes its size from the parameters, and what is said of a wrong one.
SIZES = {
    "damping of joint 'A' must be zero or positive, not -1": lambda m, x: m.revolute(
        "A", m.ground, "rod", **AT, axis=Z, damping=x
    ),
    "armature of joint 'A' must be zero or positive, not -1": lambda m, x: m.compound(
        "A", m.ground, "rod", [("turn", Z, (0, 0, 0))], armature=(x,)
    ),
    "length of joint 'A' must be positive, not -1": lambda m, x: m.distance(
        "A", m.ground, "rod", at=((0, 0, 0), (0, 0, -1)), length=x
    ),
    "radius of joint 'A' must be positive, not -1": lambda m, x: m.rolling(
        "A", m.ground, "rod", radius=x, at=(0, 0, -2)
    ),
    "mu of friction of joint 'A' must be zero or positive, not -1": lambda m, x: m.prismatic(
        "A", m.ground, "rod", axis=Z, friction=lv.bodies.Coulomb(mu=x, v_s=0.1)
    ),
    "v_s of friction of joint 'A' must be positive, not -1": lambda m, x: m.prismatic(
        "A", m.ground, "rod", axis=Z, friction=lv.bodies.Coulomb(mu=0.1, v_s=x)
    ),
    "radius of friction of joint 'A' must be positive, not -1": lambda m, x: m.revolute(
        "A", m.ground, "rod", **AT, axis=Z,
        friction=lv.bodies.Coulomb(mu=0.1, v_s=0.1, radius=x),
    ),
    "mu_static - mu of friction of joint 'A' must be zero or pos": lambda m, x: m.revolute(
        "A", m.ground, "rod", **AT, axis=Z,
        friction=lv.bodies.Stribeck(
            mu=1, mu_static=lambda p: (x(p) + 1) / 2, v_stribeck=1, v_s=0.1, radius=0.1
        ),
    ),
    "damping of bushing 'K' must have no negative eigenvalue, and has -1": lambda m, x: (
        m.free("A", "rod"),
        m.bushing("K", m.ground, "rod", **AT, stiffness=(1,) * 6, damping=lambda p: [x(p)] * 6),
    ),
    "stiffness of bushing 'K' must be symmetric": lambda m, x: (
        m.free("A", "rod"),
        m.bushing("K", m.ground, "rod", **AT, stiffness=lambda p: lopsided(x(p))),
    ),
    "stiffness of beam 'K' must have no negative eigenvalue, and has -1": lambda m, x: (
        m.free("A", "rod"),
        m.beam("K", m.ground, "rod", at=LINE, axial=x, bending=1, torsion=1),
    ),
    "damping of beam 'K' must have no negative eigenvalue, and has -15.2": lambda m, x: (
        m.free("A", "rod"),
        m.beam("K", m.ground, "rod", at=LINE, axial=12, bending=1, torsion=1, damping=x),
    ),
    "damping of spring 'K' must be zero or positive, not -1": lambda m, x: (
        m.free("A", "rod"),
        m.spring("K", m.ground, "rod", at=((0, 0, 1), (0, 0, -1)), stiffness=1, damping=x),
    ),
    "rest length of spring 'K' must be zero or positive, not -1": lambda m, x: (
        m.free("A", "rod"),
        m.spring("K", m.ground, "rod", at=((0, 0, 1), (0, 0, -1)), stiffness=1, rest=x),
    ),
}  # fmt: skip


@pytest.mark.parametrize("sentence", SIZES)
def test_runs_refuse_parameters_that_make_no_joint(sentence):
    """Friction with a negative coefficient drives, and a run by it would not say so."""
    m = base()
    SIZES[sentence](m, lambda params: params.x)
    system = m.system(params={"x": 1.0})
    call = {"t": (0, 0.1), "h": 0.1, **m.start()}
    for refused in (
        lambda: lv.integrate(system, lv.Spark(2), params={"x": -1.0}, **call),
        lambda: m.start(params={"x": -1.0}),
        lambda: m.system(params={"x": -1.0}),
    ):
        with pytest.raises(ValueError, match=sentence):
            refused()
    with pytest.raises(ValueError, match=f"member 1: {sentence}"):
        lv.ensemble(system, lv.Spark(2), params={"x": [1.0, -1.0]}, **call)
    assert lv.integrate(system, lv.Spark(2), params={"x": 1.0}, **call).status == "done"


#: What has no value where it is drawn, or changes at no finite rate, and what is said of it.
NO_VALUE = {
    "the rate of constraint 'A.motion' is not finite as drawn, t = 0": lambda m: m.revolute(
        "A", m.ground, "rod", **AT, axis=Z, motion=lambda t, p: ca.sqrt(t)
    ),
    "constraint 'A.0' is not finite as drawn, t = 0": lambda m: m.guide(
        "A", m.ground, "rod", lambda place, p: [ca.log(place[2]) - place[0]]
    ),
    "constraint 'A.x' is not finite as drawn, t = 0": lambda m: m.spherical(
        "A", m.ground, "rod", at=lambda p: (0, 0, ca.sqrt(p.x))
    ),
}


@pytest.mark.parametrize("sentence", NO_VALUE)
def test_starts_refuse_what_has_no_value_as_drawn(sentence):
    """A motion by the root of the time has no rate at its start."""
    m = base()
    NO_VALUE[sentence](m)
    m.system(params={"x": 1.0})
    with pytest.raises(ValueError, match=sentence):
        m.start(params={"x": -1.0})


SPRING = {"at": ((0, 0, 0), (0, 0, -1))}
WRONG_LAWS = {
    "force 'F' must return 3 values, not 2": lambda m: m.force(
        "F", "rod", lambda t, x, v, p: [0, 0]
    ),
    "torque 'F' must return 3 values, not 1": lambda m: m.torque("F", "rod", lambda t, w, p: 1.0),
    r"torque of joint 'F' is called with \(t, angle, rate, p": lambda m: m.revolute(
        "F", m.ground, "rod", **AT, axis=Z, torque=lambda t, params: 1.0
    ),
    r"force of joint 'F' is called with \(t, slide, rate, p": lambda m: m.prismatic(
        "F", m.ground, "rod", axis=Z, force=lambda t, params: 1.0
    ),
    "motion of joint 'F' must return 1 value, not 2": lambda m: m.revolute(
        "F", m.ground, "rod", **AT, axis=Z, motion=lambda t, p: [t, t]
    ),
    "equations of joint 'F' must be 1 of .*, not 3": lambda m: m.guide(
        "F", m.ground, "rod", lambda x, p: x
    ),
    r"stiffness= of spring 'F' is called with \(params\)": lambda m: m.spring(
        "F", m.ground, "rod", **SPRING, stiffness=lambda length, rate, params: 1.0
    ),
    r"damping= of joint 'F' is called with \(params\)": lambda m: m.revolute(
        "F", m.ground, "rod", **AT, axis=Z, damping=lambda t, rate, params: 1.0
    ),
}


@pytest.mark.parametrize("sentence", WRONG_LAWS)
def test_a_wrong_law_is_refused_where_it_is_given_and_can_be_given_again(sentence):
    m = base()
    with pytest.raises((TypeError, ValueError), match=sentence):
        WRONG_LAWS[sentence](m)
    m.free("F", "rod")  # the name is free
    assert m.system().joints == ("F",)


def test_a_law_of_parameters_is_looked_at_once_they_have_values_and_taken_out_again():
    m = base()
    m.free("flight", "rod")
    m.force("F", "rod", lambda t, x, v, p: p.F)  # three numbers or not
    assert m.system({"F": [0.0, 0.0, 1.0]})
    with pytest.raises(ValueError, match="force 'F' must return 3 values, not 1"):
        m.system({"F": 1.0})
    with pytest.raises(ValueError, match=r"there is an element called 'F' already\nhint: m.remove"):
        m.force("F", "rod", lambda t, x, v, p: [p.F, 0, 0])
    m.remove("F")
    m.force("F", "rod", lambda t, x, v, p: [p.F, 0, 0])
    assert m.system({"F": 1.0})


def test_what_others_need_is_not_removed():
    m = base()
    m.cylindrical("A", m.ground, "rod", **AT, axis=Z)
    m.gear("G", {"A": 1, ("A", "slide"): 31})
    for name, user in (("rod", "A"), ("A", "G")):
        with pytest.raises(ValueError, match=f"'{user}' needs '{name}'\nhint: m.remove.'{user}'"):
            m.remove(name)
    with pytest.raises(ValueError, match="has no 'B'\nhint: there is 'rod', 'A' and 'G'"):
        m.remove("B")
    for name in ("G", "A", "rod"):
        m.remove(name)
    assert repr(m) == "<Assembly of 0 bodies and 0 joints>"
