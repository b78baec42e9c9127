"""Compound joints and couplings of assemblies."""

import numpy as np
import pytest

import liouville as lv


def test_a_compound_joint_counts_turns_and_closes_loops():
    m = lv.bodies.Assembly()
    m.body("wheel", mass=1.0, inertia=(0.1, 0.1, 0.2), at=(0, 0, 0))
    m.body("bolt", mass=1.0, inertia=(0.1, 0.1, 0.2), at=(0, 0, 1))
    m.compound("W", m.ground, "wheel", [("turn", (0, 0, 2), (0, 0, 0))], armature=0.3, spring=0.5)
    m.revolute("R", m.ground, "bolt", at=(0, 0, 1), axis=(0, 0, 1))
    m.compound("C", "bolt", "wheel", [("slide", (0, 0, 1)), ("turn", (0, 0, 1), (0, 0, 0))])
    m.couple("gear", "W", ("C", "turn 2"), by=(0.0, 2.0))
    system = m.system()
    start = m.start(values={"W": 5 * np.pi})
    found = dict(zip(system.coordinates, start["q"], strict=True))
    assert abs(found["W.angle"] - 5 * np.pi) < 1e-12
    assert abs(found["C.turn 2"] - 2.5 * np.pi) < 1e-12
    solution = lv.integrate(system, lv.Spark(4), t=(0, 3), h=0.05, **start)
    # W - R = C = W / 2, so bolt turns half as far: (0.2 + 0.3 + 0.2 / 4) x'' = -0.5 x
    wanted = 5 * np.pi * np.cos(np.sqrt(0.5 / 0.55) * solution.t)
    assert np.abs(solution.joint("W").angle - wanted).max() < 1e-9
    assert np.abs(solution.joint("C").coordinates["slide 1"]).max() < 1e-14


def test_compound_joints_move_as_those_with_their_own_equations():
    def built(kind, **more):
        m = lv.bodies.Assembly(gravity=(0.3, 0.2, -9.81))
        place = {"at": (0.3, 0.2, -1), "rotation": (1, 0.2, 0.3, 0.4)}
        m.body("a", mass=1.3, inertia=(1, 1.5, 2), **place)
        m.body("b", mass=0.7, inertia=(0.5, 0.7, 0.4), at=(0.3, 1.2, -2))
        m.spherical("S", m.ground, "a", at=(0, 0, 0))
        getattr(m, kind)("J", "a", "b", damping=(0.1, 0.2), spring=(1.0, 2.0), **more)
        start = m.start(values={"J": (0.4, -0.3)}, rates={"J": (2.0, -1.0), "S": (0.1, 0.2, 0.3)})
        return lv.integrate(m.system(), lv.Spark(4), t=(0, 0.5), h=0.01, **start)

    at, x, y = (0.5, 0.5, -1.5), (1, 0, 0), (0, 1, 0)
    one = built("universal", at=at, axes=(x, y))
    other = built("compound", axes=[("turn", x, at), ("turn", y, at)])
    assert np.abs(one.q - other.q).max() < 1e-13
    assert np.abs(one.joint("J").force - other.joint("J").force).max() < 1e-11


COMPOUND = {
    "write ('turn', direction, point)": lambda m: m.compound("J", "a", "b", [("twist", (0, 0, 1))]),
    "an axis of joint 'J' is": lambda m: m.compound("J", "a", "b", [("turn", (0, 0, 1))]),
    "direction of 'slide' of joint 'J' has length zero": lambda m: m.compound(
        "J", "a", "b", [("slide", (0, 0, 0))]
    ),
    "names= of joint 'J' must be 1 different names": lambda m: m.compound(
        "J", "a", "b", [("slide", (0, 0, 1))], names=("x", "x")
    ),
    "armature of 'slide' of joint 'J' must be zero or positive, not -1": lambda m: m.compound(
        "J", "a", "b", [("slide", (0, 0, 1))], armature=-1.0
    ),
    "'p' is point": lambda m: m.compound("J", "a", "p", [("slide", (0, 0, 1))]),
    "coupling 'k' has no joint 'X'\nhint: joints are A": lambda m: m.couple("k", "X", by=[1.0]),
    "has no 'slide'\nhint: its coordinates are angle": lambda m: m.couple(
        "k", ("A", "slide"), by=0.0
    ),
    "couples joint 'A' with itself": lambda m: m.couple("k", "A", "A", by=[0.0, 1.0]),
    "a polynomial of no other joint": lambda m: m.couple("k", "A", by=[0.0, 1.0]),
}


@pytest.mark.parametrize("sentence", COMPOUND)
def test_bad_compounds_and_couplings_are_refused(sentence):
    m = lv.bodies.Assembly()
    for name in "ab":
        m.body(name, mass=1.0, inertia=(1, 1, 1), at=(0, 0, 0))
    m.point_mass("p", mass=1.0, at=(0, 0, 0))
    m.revolute("A", m.ground, "a", at=(0, 0, 0), axis=(0, 0, 1))
    with pytest.raises((TypeError, ValueError)) as raised:
        COMPOUND[sentence](m)
    assert sentence in str(raised.value)
