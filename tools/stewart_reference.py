"""Compute the reference of the Stewart platform of ``liouville.problems``.

Place and attitude of the plate are the coordinates. The equations of Newton and Euler of the plate
and of both halves of all legs are projected on its velocities, and share nothing with the model.
Gragg's midpoint rule is extrapolated in NumPy's ``longdouble``, which has 64 bits on x86, with two
steps; the difference is printed. Run as ``python tools/stewart_reference.py`` (a minute).
"""
# ruff: noqa: T201

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mechanism_references import cross, quaternion, rate_of
from mpmath import mpf
from references import show

from liouville.problems import stewart_platform

LONG = np.longdouble


def longs(*values: Any) -> Any:
    """Return numbers of extended precision, as they are written in decimals."""
    return np.array([LONG(str(x)) for x in values])


class Platform:
    """The plate's six freedoms, and the equations of Newton and Euler projected on them."""

    def __init__(self) -> None:
        p = stewart_platform
        third = longs(0, 0, 1)
        self.plate = LONG(p.PLATE_BODY[0]), longs(*p.PLATE_BODY[1])
        self.halves = [(LONG(m), longs(*j)) for m, j in (p.LOWER_BODY, p.UPPER_BODY)]
        self.feet = self.ring(p.BASE, p.BASE_ANGLES)
        self.heads = self.ring(p.PLATE, p.PLATE_ANGLES)  # in the axes of the plate
        self.height = LONG(str(p.HEIGHT))
        drawn = self.heads + self.height * third - self.feet
        self.lengths = np.sqrt((drawn**2).sum(axis=1))
        self.firsts = [cross(u, third) for u in drawn / self.lengths[:, None]]
        self.firsts = np.array([x / np.sqrt(x @ x) for x in self.firsts])
        self.lower = LONG(str(p.LOWER)) * self.lengths
        self.upper = (1 - LONG(str(p.UPPER))) * self.lengths
        self.stiffness, self.gravity = LONG(5000), LONG("9.81") * third
        turns = [p.assembly._bodies[f"lower{k}"].rotation for k in range(1, 7)]
        self.sides = [longs(*turn) for turn in turns]

    @staticmethod
    def ring(radius: float, angles: Any) -> Any:
        """Return points on a circle at these angles in degrees."""
        turn = np.array(angles, dtype=LONG) * (4 * np.arctan(LONG(1))) / 180
        size = LONG(str(radius))
        return np.stack([size * np.cos(turn), size * np.sin(turn), 0 * turn], axis=1)

    def bodies(self, x: Any, v: Any, acceleration: Any) -> Any:
        """Yield mass, moments, place, frame, velocity, turning and both their rates.

        Of the plate, all lower and all upper halves, a body each along the second last axis, and of
        n velocities and accelerations of shape (n, 6) at once.
        """
        frame, place = rotation(x[3:]), x[:3]
        speed, omega = v[:, None, :3], v[:, None, 3:]
        a, alpha = acceleration[:, None, :3], acceleration[:, None, 3:]
        yield *self.plate, place[None], frame[None], speed, omega, a, alpha
        arm = self.heads @ frame.T
        swing = across(omega, arm)
        d, dd = place + arm - self.feet, speed + swing
        ddd = a + across(alpha, arm) + across(omega, swing)
        length = np.sqrt(along(d, d))
        u = d / length
        rate = along(u, dd)
        du = (dd - rate * u) / length
        second = along(u, ddd) + along(du, dd)
        ddu = (ddd - second * u - 2 * rate * du) / length
        w, dw, ddw = (across(each, self.firsts) for each in (u, du, ddu))
        size = np.sqrt(along(w, w))
        y = w / size
        ex = across(y, u)
        spin = -along(dw, ex) / size
        turning = across(u, du) + spin * u
        more = -(along(ddw, ex) + along(dw, across(turning, ex))) / size
        more = more + along(dw, ex) * along(w, dw) / size**3
        twisting = across(u, ddu) + more * u + spin * du
        frames = np.stack([ex, y, u], axis=-1)
        low, high = self.lower[:, None], self.upper[:, None]
        below = self.feet + low * u, frames, low * du, turning, low * ddu, twisting
        above = place + arm - high * u, frames, dd - high * du, turning, ddd - high * ddu, twisting
        yield *self.halves[0], *below
        yield *self.halves[1], *above

    def field(self, x: Any) -> Any:
        """Return the rates of place, quaternion, velocity and angular velocity.

        Inertia forces less given ones, projected on the plate's velocities, vanish.
        """
        at, unit, zero = x[:7], np.eye(6, dtype=LONG), np.zeros((7, 6), dtype=LONG)
        # the state itself, at rest, with each acceleration, and with each velocity
        v = np.concatenate([x[None, 7:], zero, unit])
        acceleration = np.concatenate([zero[:2], unit, zero[:6]])
        found = np.zeros((8, 6), dtype=LONG)
        for mass, j, _, frames, speed, omega, a, alpha in self.bodies(at, v, acceleration):
            own = np.einsum("bji,nbj->nbi", frames, omega[:8])
            down = np.einsum("bji,nbj->nbi", frames, alpha[:8])
            torque = np.einsum("bij,nbj->nbi", frames, j * down + across(own, j * own))
            found += np.einsum("nbi,kbi->nk", mass * (a[:8] + self.gravity), speed[8:])
            found += np.einsum("nbi,kbi->nk", torque, omega[8:])
        arm = self.heads @ rotation(at[3:]).T
        d = at[:3] + arm - self.feet
        length = np.sqrt(along(d, d))
        pull = self.stiffness * (length - self.lengths[:, None]) * d / length
        found += np.array([*pull.sum(axis=0), *across(arm, pull).sum(axis=0)])
        acceleration = solve((found[2:] - found[1]).T, -found[0])
        return np.array([*x[7:10], *rate_of(at[3:], x[10:]), *acceleration])

    def start(self) -> Any:
        """Return the start of the field."""
        p = stewart_platform
        return longs(0, 0, p.HEIGHT, 1, 0, 0, 0, *p.VELOCITY, *p.SPIN)

    def states(self, x: Any) -> dict[str, Any]:
        """Return q and v in the order of the model: the plate, then both halves of each leg."""
        plate, low, high = self.bodies(x[:7], x[None, 7:], np.zeros((1, 6), dtype=LONG))
        order = [(plate, 0), *((half, k) for k in range(6) for half in (low, high))]
        q, v = [], []
        for body, k in order:
            _, _, place, frames, speed, omega, *_ = body
            side = x[3:7] if body is plate else self.sides[k]
            turn = quaternion(frames[k], side, np.sqrt)
            q += [*place[k], *turn]
            v += [*speed[0, k], *rate_of(turn, omega[0, k])]
        return {"q": q, "v": v}


def along(a: Any, b: Any) -> Any:
    """Return a . b along the last axis, which stays."""
    return (a * b).sum(axis=-1, keepdims=True)


def across(a: Any, b: Any) -> Any:
    """Return a x b along the last axis."""
    rolled = [np.roll(a, -k, axis=-1) * np.roll(b, k - 3, axis=-1) for k in (1, 2)]
    return rolled[0] - rolled[1]


def rotation(e: Any) -> Any:
    """Return the matrix of a unit quaternion."""
    w, x, y, z = e
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def solve(matrix: Any, right: Any) -> Any:
    """Solve a symmetric positive definite system, which LAPACK does not in extended precision."""
    m = np.concatenate([matrix, right[:, None]], axis=1)
    for k in range(len(m)):
        m[k] /= m[k, k]
        for i in range(len(m)):
            if i != k:
                m[i] -= m[i, k] * m[k]
    return m[:, -1]


def stewart(times: Sequence[Any] = (LONG(1) / 2, LONG(1))) -> None:
    """Extrapolate Gragg's midpoint rule in extended precision, with two steps."""
    platform = Platform()
    ends = []
    for count in (40, 50):
        x, found = platform.start(), []
        step = LONG(1) / 2 / count
        for _ in times:
            for _ in range(count):
                x = extrapolated(platform.field, x, step)
            found.append(x)
        ends.append(found)
    apart = max(np.abs(a - b).max() for a, b in zip(*ends, strict=True))
    print(f"stewart_platform: two steps differ by {apart:.1e}")
    for time, x in zip(times, ends[1], strict=True):
        rows = platform.states(x)
        show(
            "stewart_platform", time, {key: [mpf(str(y)) for y in row] for key, row in rows.items()}
        )


def extrapolated(field: Callable[..., Any], x: Any, step: Any, columns: int = 8) -> Any:
    """Go one step of order 16."""
    first = field(x)
    last: list[Any] = []
    for j in range(1, columns + 1):
        n = 2 * j
        d = step / n
        before, now = x, x + d * first
        for _ in range(n - 1):
            before, now = now, before + 2 * d * field(now)
        row = [(before + now + d * field(now)) / 2]
        for k in range(1, j):
            row.append(row[-1] + (row[-1] - last[k - 1]) / ((LONG(j) / (j - k)) ** 2 - 1))
        last = row
    return last[-1]


if __name__ == "__main__":
    stewart()
