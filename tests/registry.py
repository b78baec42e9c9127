"""What each method claims, and the problems that can tell: a row for every public method.

`test_order` measures the order of each row, `test_invariants` what it keeps, `test_registry` that
an ensemble and a stored run have the bits of a run, and that there is a row for every method.

The problems see what others hide. A planar pendulum in uniform gravity cannot tell SPARK from
Lobatto IIIA--IIIB; an autonomous problem cannot tell t_n from t_{n+1}; p = M z cannot tell p(z)
from z. Here are a top with a mass matrix that depends on position, a constraint and a mass that
depend on time, a momentum nonlinear in the velocity, and a reaction nonlinear in the multiplier,
and a sphere that breathes under forces that depend on everything.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from families import FAMILIES, Problem
from plain_alpha import Plain

import liouville as lv
from liouville._methods.composition import SCHEMES
from liouville.problems import load

DATA = Path(__file__).parent / "data"
REFERENCE = json.loads((DATA / "mechanics_reference.json").read_text())


@dataclass(frozen=True)
class Row:
    """A method, its order in states and multipliers, and what it keeps.

    What it does not keep is seen to be lost. Where its steps are not those of a problem for its
    order, `steps` has them; slopes may be off by `room`; `of` are the states that have the order.
    """

    method: Any
    order: int | None
    on: tuple[str, ...]
    keeps: tuple[str, ...] = ()
    steps: tuple[int, ...] = ()
    room: float = 0.15
    of: tuple[str, ...] = ()

    def __str__(self):  # noqa: D105
        return repr(self.method)

    def counts(self, problem):
        """Return the numbers of steps to measure the order by."""
        if not self.steps:
            return problem.steps[(self.order + 1) // 2 - 1]
        return tuple(int(problem.finer * count) for count in self.steps)


def spherical_pendulum():
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[2],
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=("x", "y", "z"),
    )


def double_pendulum():
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[1] - q[3],
        lambda t, q, params: [
            (q[0] ** 2 + q[1] ** 2 - 1) / 2,
            ((q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2 - 1) / 2,
        ],
        q=4,
    )


def body_rates(q, v):
    """Return L(q) v, half the angular velocity in the body's frame."""
    rows = (-q[1], q[0], q[3], -q[2]), (-q[2], -q[3], q[0], q[1]), (-q[3], q[2], -q[1], q[0])
    return ca.vertcat(*(ca.dot(ca.vertcat(*row), v) for row in rows))


def top_lagrangian(t, q, v, params=None):
    rates = 2 * body_rates(q, v)
    spin = (rates[0] ** 2 + rates[1] ** 2 + rates[2] ** 2 / 2) / 2
    height = q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2
    return spin + ca.dot(q, v) ** 2 - height


def top():
    return lv.Lagrangian(
        top_lagrangian, lambda t, q, params: (ca.dot(q, q) - 1) / 2, q=("q0", "q1", "q2", "q3")
    )


def moving_wire():
    return load("moving_wire").system


def wire_lagrangian(t, q, v, params=None):
    return (1 + ca.sin(t) / 5) * (ca.dot(v, v) / 2 - q[1])


def breathing_force(t, y, z, params=None):
    """Return forces that depend on time, position and velocity, and have no potential."""
    return ca.vertcat(ca.sin(t) - z[0] / 5, -z[1] / 5 - y[0] * y[2], -1 - z[2] / 5 + y[0] * y[1])


def breathing_constraint(t, y, params=None):
    return (ca.dot(y, y) - (1 + ca.sin(2 * t) / 10) ** 2) / 2


def breathing_sphere():
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        breathing_constraint,
        q=("x", "y", "z"),
        force=breathing_force,
    )


def nonlinear_reaction():
    """Return the spherical pendulum in a magnetic field with lam -> lam + lam^3 / 10 in r."""
    return lv.Mechanical(
        velocity=lambda t, y, z, params: z,
        momentum=lambda t, y, z, params: z * (1 + ca.dot(z, z) / 4),
        force=lambda t, y, z, params: ca.vertcat(z[1], -z[0], -1 + ca.sin(t) / 2),
        reaction=lambda t, y, lam, params: -y * (lam + lam**3 / 10),
        constraint=lambda t, y, params: (ca.dot(y, y) - 1) / 2,
        y=("x", "y", "z"),
    )


def printed(name, *keys):
    """Return printed values of the reference tables as floats."""
    return [np.array([float(x) for x in REFERENCE["problems"][name][key]]) for key in keys]


SYSTEMS = {
    "spherical": spherical_pendulum,
    "double_pendulum": double_pendulum,
    "heavy_top_quaternion": top,
    "moving_wire": moving_wire,
}

_top_y0, _top_z0 = printed("heavy_top_quaternion", "y0", "z0")
_relativistic = load("relativistic_particle")

_STEPS = (32, 64, 128, 256), (10, 20, 40, 80), (8, 12, 18, 27), (8, 10, 12, 15)

PROBLEMS = {
    "top": Problem(
        top(),
        {"q": _top_y0, "v": _top_z0},
        (0.0, 2.0),
        _STEPS,
        plain=Plain.lagrangian(4, top_lagrangian, lambda t, q: (ca.dot(q, q) - 1) / 2),
        finer=2,
    ),
    "moving wire": Problem(
        moving_wire(),
        {"q": [1, 0.5], "v": [0, 1]},
        (0.0, 4.0),
        ((64, 128, 256, 512), (32, 64, 128, 256), (48, 64, 88, 120), (44, 48, 56, 64)),
        lost=("symplectic form",),
        plain=Plain.lagrangian(
            2,
            wire_lagrangian,
            lambda t, q: q[1] - q[0] ** 2 / 2 - ca.sin(2 * t) / 2,
            lambda t, q, v: -v / 10,
        ),
        finer=2,
    ),
    "breathing sphere": Problem(
        breathing_sphere(),
        {"q": [0.6, 0, -0.8], "v": [0.12, 1.25, -0.16]},
        (0.0, 2.0),
        (*_STEPS[:3], (12, 14, 16, 20)),
        lost=("symplectic form",),
        plain=Plain(3, lambda t, y: ca.SX.eye(3), breathing_force, breathing_constraint),
    ),
    "relativistic": Problem(_relativistic.system, _relativistic.start, (0.0, 2.0), _STEPS),
    "nonlinear reaction": Problem(
        nonlinear_reaction(),
        {"y": [0.6, 0, -0.8], "z": [0, 1.25, 0]},
        (0.0, 2.0),
        _STEPS,
        lost=("symplectic form",),
    ),
}

#: The problems of second order, that is, with y' = z and a mass matrix.
SECOND_ORDER = ("top", "moving wire", "breathing sphere")

MECHANICS = tuple(PROBLEMS)
ALL = PROBLEMS | FAMILIES
NONHOLONOMIC = ("rolling disk", "pace", "bowl")
SEPARABLE = ("swinging rod",)

#: What symmetric symplectic methods keep, methods that are symmetric alone, and all.
SYMPLECTIC = ("hidden", "symplectic form", "reversibility")
SYMMETRIC = ("hidden", "reversibility")
HIDDEN = ("hidden",)

ALPHAS, BS, RHOS = (0.0, -0.1, -0.3, -1 / 3), (-1.0, 0.0, 1 / 3, 1.0), (0.0, 0.5, 0.8, 1.0)

EXTENDED = [
    *(lv.HHT(alpha, b) for alpha in ALPHAS for b in BS),
    *(lv.HHT(alpha, less_implicit=True) for alpha in ALPHAS),
    *(lv.GeneralizedAlpha(rho) for rho in RHOS),
    *(lv.GeneralizedAlpha(rho, b=1, less_implicit=True) for rho in RHOS),
]

FORCES = {"B": SYMPLECTIC, "A": SYMMETRIC, "D": SYMMETRIC, "C": HIDDEN, "C*": HIDDEN}

#: Steps of Radau methods of one, two and three stages.
RADAU = (1024, 2048, 4096), (64, 128, 256), (24, 48, 72)

#: Steps of compositions, and those for which errors change sign or are at roundoff too soon.
COMPOSED = {
    "Y4": (64, 96, 144, 216),
    "SU4": (32, 48, 72, 108),
    "SS6s11": (20, 26, 34, 44),
    "KL6": (32, 40, 50, 64),
    "SS8s21": (10, 12, 14, 17),
    "SS10s35": (7, 8, 9, 10),
}
HIGHEST = ("SS8s21", "SS10s35")
SMOOTH = ("top", "breathing sphere", "nonlinear reaction")


def composed(base, schemes, on, keeps=SYMPLECTIC):
    """Return rows of compositions, whose multipliers come to their order later than the states."""
    for scheme in schemes:
        method = lv.Composition(base, scheme)
        problems = SMOOTH if scheme in HIGHEST else on
        yield Row(
            method,
            method.order,
            problems,
            keeps,
            COMPOSED[scheme],
            room=0.3,
            of=("y", "z", "q", "v"),
        )


GENERAL = [
    *(Row(lv.Spark(s), 2 * s, (*MECHANICS, *NONHOLONOMIC), SYMPLECTIC) for s in (1, 2, 3, 4)),
    *(
        Row(lv.Spark(s, points="radau"), 2 * s - 1, MECHANICS, HIDDEN, RADAU[s - 1])
        for s in (1, 2, 3)
    ),
    *(
        Row(lv.LobattoPair(s, force), 2 * s - 2, MECHANICS, keeps)
        for s in (2, 3, 4)
        for force, keeps in FORCES.items()
    ),
    *(Row(lv.LobattoPair(s), 2 * s - 2, NONHOLONOMIC, SYMMETRIC) for s in (2, 3, 4)),
    Row(lv.LobattoPair(3, "C"), 4, NONHOLONOMIC, HIDDEN),
    Row(lv.LobattoPair(2), 2, SEPARABLE, SYMPLECTIC),
    *composed(lv.Spark(1), COMPOSED, MECHANICS),
    *composed(lv.LobattoPair(2), ("Y4", "SS6s11", "SS8s21"), (*SMOOTH, *SEPARABLE)),
    *composed(lv.LobattoPair(2, "A"), ("Y4", "SS6s11"), SMOOTH, SYMMETRIC),
    *composed(lv.LobattoPair(2, "D"), ("Y4", "SS6s11"), SMOOTH, SYMMETRIC),
]
ALPHA = [
    *(Row(method, 2, SECOND_ORDER, HIDDEN) for method in EXTENDED),
    *(Row(lv.ArnoldBruls(rho), 2, SECOND_ORDER) for rho in (0.0, 0.5, 0.8)),
]
INDEX2 = [
    *(Row(lv.Spark(s), 2 * s, ("index 2",), SYMMETRIC) for s in (1, 2, 3, 4)),
    *(
        Row(lv.Spark(s, points="radau"), 2 * s - 1, ("index 2",), HIDDEN, RADAU[s - 1])
        for s in (1, 2, 3)
    ),
    Row(lv.Composition(lv.Spark(1), "SU4"), 4, ("index 2",), SYMMETRIC, (40, 80, 160)),
]

#: Many steps, of which the slope takes those that show the order.
_SPREAD = tuple(int(8 * 1.25**k) for k in range(14))
_DENSE = tuple(round(8 * 1.12**k) for k in range(26))


def volumes():
    """Return rows of all compositions of fields."""
    for scheme, facts in SCHEMES.items():
        order, is_symmetric = facts["order"], scheme != "Lie"
        keeps = ("volume", "reversibility") if is_symmetric else ("volume",)
        steps = {1: (4000, 8000, 16000), 10: _DENSE}.get(order, _SPREAD)
        steps = tuple(4 * count for count in steps) if order == 2 else steps
        method = lv.VolumeSplitting(composition=scheme)
        yield Row(
            method, order, ("five variables", "cubic charge"), keeps, steps, room=0.06 * order
        )


#: Splines of degree 5 leave orders up to theirs.
_ON_GRIDS = Row(
    lv.VolumeSplitting(composition="BM4"), 4, ("waves on a grid",), ("volume", "reversibility"),
    (20, 26, 34, 44), room=0.24,
)  # fmt: skip

#: Planes of a potential leave the order as it is.
_BY_POTENTIAL = [
    Row(lv.VolumeSplitting(composition=name), order, ("vector potential",),
        ("volume", "reversibility"), (10, 14, 20, 28), room=0.2)
    for name, order in (("S2", 2), ("BM4", 4), ("BM6", 6))
]  # fmt: skip

FIELDS = [*volumes(), _ON_GRIDS, *_BY_POTENTIAL]

#: Symplectic and reversible as maps of (Re psi, Im psi); those of the grid keep the norm too.
_SHEARS = ("symplectic form", "reversibility")
SPLIT = {"S2": 2, "BM4": 4, "RKN4s6": 4, "BM6": 6, "RKN6s11": 6}
WAVES = [
    Row(lv.SchrodingerSplitting(1e-6, "fast"), None, ("chain", "flux"), (*_SHEARS, "tolerance")),
    Row(lv.SchrodingerSplitting(1e-6, "stable"), None, ("chain", "flux"), (*_SHEARS, "tolerance")),
    Row(lv.Chebyshev(1e-6), None, ("chain", "flux"), ("tolerance",)),
    Row(lv.Lanczos(1e-6, dimension=6), None, ("chain", "flux"), ("tolerance",)),
    *(
        Row(lv.SplitOperator(name), order, ("moving grid",), (*_SHEARS, "norm"), (30, 42, 60), 0.2)
        for name, order in SPLIT.items()
    ),
    *(
        Row(
            lv.Magnus(order, 1e-13, exponentials),
            order,
            ("driven chain", "moving grid"),
            _SHEARS,
            steps,
            0.03 * order + 0.1,
        )
        for order, exponentials, steps in (
            (2, 1, (40, 56, 80)),
            (4, 2, (40, 56, 80)),
            (4, 3, (28, 40, 56)),
            (6, 5, (14, 20, 28)),
            (8, 8, (16, 20, 25)),
        )
    ),
    *(
        Row(lv.GrayManolopoulos(order), order, ("chain",), _SHEARS, _SPREAD, room=0.2)
        for order in range(2, 7)
    ),
    *(
        Row(
            lv.StabilitySplitting(order, stages),
            order,
            ("chain",),
            _SHEARS,
            _SPREAD,
            room=0.2,
        )
        for order, stages in ((2, 6), (4, 4), (6, 6), (8, 8))
    ),
]

ROWS = [*GENERAL, *ALPHA, *INDEX2, *FIELDS, *WAVES]
