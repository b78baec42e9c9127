"""Vectors and unit quaternions by their components, of numbers, arrays or expressions alike.

A vector is a tuple of 3 components and a quaternion of 4, (w, x, y, z); a component is a number, an
array of them or a row of CasADi's, one entry for each body, joint or time. R(e) turns vectors of a
body into those of the world, and the world's angular velocity is 2 e' e*.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Components = Sequence[Any] | NDArray[Any]


def dot(a: Components, b: Components) -> Any:
    """Return a . b."""
    found = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        found = found + x * y
    return found


def cross(a: Components, b: Components) -> tuple[Any, Any, Any]:
    """Return a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def plus(a: Components, b: Components) -> tuple[Any, ...]:
    """Return a + b."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def minus(a: Components, b: Components) -> tuple[Any, ...]:
    """Return a - b."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def times(factor: Any, a: Components) -> tuple[Any, ...]:
    """Return a multiple of a."""
    return tuple(factor * x for x in a)


def conjugate(e: Components) -> tuple[Any, Any, Any, Any]:
    """Return the quaternion of the turn back."""
    return e[0], -e[1], -e[2], -e[3]


def product(a: Components, b: Components) -> tuple[Any, Any, Any, Any]:
    """Return the quaternion of the turn b, then a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
        a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
    )


def columns(e: Components) -> tuple[tuple[Any, Any, Any], ...]:
    """Return the columns of R(e), each homogeneous of degree 2 in e."""
    w, x, y, z = e
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    wx, wy, wz, xy, xz, yz = w * x, w * y, w * z, x * y, x * z, y * z
    return (
        (ww + xx - yy - zz, 2 * (xy + wz), 2 * (xz - wy)),
        (2 * (xy - wz), ww - xx + yy - zz, 2 * (yz + wx)),
        (2 * (xz + wy), 2 * (yz - wx), ww - xx - yy + zz),
    )


def combine(directors: Sequence[Components], a: Components) -> tuple[Any, ...]:
    """Return the vector with the components a along three directors."""
    return tuple(
        directors[0][k] * a[0] + directors[1][k] * a[1] + directors[2][k] * a[2] for k in range(3)
    )


def rotate(e: Components, a: Components) -> tuple[Any, ...]:
    """R(e) a."""
    return combine(columns(e), a)


def own_rate(e: Components, rate: Components) -> tuple[Any, Any, Any]:
    """Return the angular velocity about the body's own axes, 2 e* e'."""
    found = product(conjugate(e), rate)
    return 2 * found[1], 2 * found[2], 2 * found[3]


def world_rate(e: Components, rate: Components) -> tuple[Any, Any, Any]:
    """Return the angular velocity about the world's axes, 2 e' e*."""
    found = product(rate, conjugate(e))
    return 2 * found[1], 2 * found[2], 2 * found[3]


def rate_of(e: Components, omega: Components) -> tuple[Any, ...]:
    """Return e' of an angular velocity about the world's axes."""
    return times(0.5, product((0.0, *omega), e))


def torque_of(e: Components, force: Components) -> tuple[Any, ...]:
    """Return the torque about the centre, in the world, of generalised forces on e."""
    w, *u = e
    first, *rest = force
    turned = cross(u, rest)
    return tuple((w * rest[k] - u[k] * first + turned[k]) / 2 for k in range(3))


def turn(axis: Components, angle: Any) -> tuple[Any, ...]:
    """Return the quaternion of a turn by an angle about an axis of length one."""
    return (np.cos(angle / 2), *times(np.sin(angle / 2), axis))


def between(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the quaternion of the least turn of direction a to b, each of length one.

    Signed permutations of the axes come out without roundoff.
    """
    if np.array_equal(a, b):
        return 1.0, 0.0, 0.0, 0.0
    w, u = 1.0 + float(a @ b), np.cross(a, b)
    if w < 1e-8:
        u = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        w = 0.0
    found = np.array([w, *u])
    return tuple((found / np.linalg.norm(found)).tolist())


def of_frame(x: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the quaternion of the frame with first axis x and third axis z, across each other."""
    first = between(np.array([0.0, 0.0, 1.0]), z)
    own = np.array(rotate(first, (1.0, 0.0, 0.0)))
    angle = np.arctan2(float(np.cross(own, x) @ z), float(own @ x))
    return product(first, turn((0.0, 0.0, 1.0), float(angle)))
