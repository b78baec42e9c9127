"""What each method claims, and the problems that can tell: one row a method.

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
from plain_alpha import Plain

import liouville as lv
from liouville.problems import load

DATA = Path(__file__).parent / "data"
REFERENCE = json.loads((DATA / "mechanics_reference.json").read_text())


@dataclass(frozen=True)
class Problem:
    """A system, a start, and steps for s = 1, 2, ... that are fine enough, and above roundoff.

    What cannot be kept on it, because the motion itself does not, is `lost`. `plain` is the same
    system written down again, where it is one of second order.
    """

    system: Any
    start: dict[str, Any]
    t: tuple[float, float]
    steps: tuple[tuple[int, ...], ...]
    lost: tuple[str, ...] = ()
    plain: Any = None

    @property
    def of(self):
        return (*self.system.states, "lam")


@dataclass(frozen=True)
class Row:
    """A method, its order in states and multipliers, and what it keeps."""

    method: Any
    order: int
    on: tuple[str, ...]
    keeps: tuple[str, ...] = ()

    def __str__(self):  # noqa: D105
        return repr(self.method)


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

_KEEPS = ("hidden", "symplectic form", "reversibility")

ALPHAS, BS, RHOS = (0.0, -0.1, -0.3, -1 / 3), (-1.0, 0.0, 1 / 3, 1.0), (0.0, 0.5, 0.8, 1.0)

EXTENDED = [
    *(lv.HHT(alpha, b) for alpha in ALPHAS for b in BS),
    *(lv.HHT(alpha, less_implicit=True) for alpha in ALPHAS),
    *(lv.GeneralizedAlpha(rho) for rho in RHOS),
    *(lv.GeneralizedAlpha(rho, b=1, less_implicit=True) for rho in RHOS),
]

ROWS = [
    *(Row(lv.Spark(s), 2 * s, on=tuple(PROBLEMS), keeps=_KEEPS) for s in (1, 2, 3, 4)),
    *(Row(method, 2, on=SECOND_ORDER, keeps=("hidden",)) for method in EXTENDED),
]
