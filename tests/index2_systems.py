"""Semi-explicit systems of index 2 that see what others hide, and what is known of them.

One is nonlinear in z and has a constraint that moves with time, one rewrites index-3 mechanics with
its velocities constrained, one has an invariant of its own, and one is known in closed form.
"""

import casadi as ca
import numpy as np

import liouville as lv


def nonlinear(**more):
    """Return y1 = e^t, y2 = e^-2t (1 + sin t), z = e^2t, as a system nonlinear in z."""

    def field(t, y, z, params):
        growth = 1 + ca.sin(t)
        u = y[1] / growth
        return [
            y[0] * u**2 * z**2,
            (u**2 * z - 3 * y[0] ** 2 * u**2) * growth + u * ca.cos(t),
        ]

    return lv.SemiExplicit(
        field=field,
        constraint=lambda t, y, params: y[0] ** 2 * y[1] - 1 - ca.sin(t),
        y=2,
        z=("z",),
        **more,
    )


def nonlinear_at(t):
    return np.array([np.exp(t), np.exp(-2 * t) * (1 + np.sin(t))]), np.array([np.exp(2 * t)])


def pendulum():
    """Return the planar pendulum with its velocities constrained too."""
    return lv.SemiExplicit(
        field=lambda t, y, z, params: {
            "x": y[2] - y[0] * z[1],
            "y": y[3] - y[1] * z[1],
            "u": -y[0] * z[0],
            "v": -y[1] * z[0] - params.g,
        },
        constraint=lambda t, y, params: {
            "rod": (y[0] ** 2 + y[1] ** 2 - 1) / 2,
            "speed": y[0] * y[2] + y[1] * y[3],
        },
        y=("x", "y", "u", "v"),
        z=("tension", "shift"),
        params={"g": 9.81},
    )


def spinning():
    """Return a turning vector whose first component is prescribed: its length is an invariant."""

    def field(t, y, z, params):
        return ca.cross(ca.vertcat(ca.sin(3 * t) / 5, z[0], (1 + z[0] ** 2) / 2), y)

    return lv.SemiExplicit(
        field=field,
        constraint=lambda t, y, params: y[0] - ca.sin(2 * t) / 4,
        y=3,
        z=1,
        invariants={"length": lambda t, y, z, params: ca.dot(y, y)},
    )


SPINNING = np.array([0.0, 0.0, 1.0])


def track(is_stabilised):
    """Return the circular track of index 2: its velocity constrained, or its position as well."""
    drive = lambda y: ca.vertcat(2 * y[1], -2 * y[0])  # noqa: E731

    def field(t, y, z, params):
        moved = y[2:] - (y[:2] * z[1] if is_stabilised else 0)
        return ca.vertcat(moved, drive(y) - y[:2] * z[0])

    def constraint(t, y, params):
        velocity = y[0] * y[2] + y[1] * y[3]
        return [velocity, (ca.dot(y[:2], y[:2]) - 1) / 2] if is_stabilised else [velocity]

    return lv.SemiExplicit(field=field, constraint=constraint, y=4, z=1 + is_stabilised)


def track_at(t):
    s, c = np.sin(t**2), np.cos(t**2)
    return np.array([s, c, 2 * t * c, -2 * t * s]), 4 * t**2
