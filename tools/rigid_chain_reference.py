"""Compute the references of ``liouville.problems.rigid_chain``, as ``references.py`` does others.

Attitudes and angular velocities of the rods alone, with the forces of the joints eliminated, in
45-digit arithmetic, at two tolerances. Needs only mpmath:
``python tools/rigid_chain_reference.py`` (some minutes).
"""

from collections.abc import Sequence

from mpmath import mp, mpf
from references import State, checked, show

RADIUS = mpf(1) / 4


def cross(a: State, b: State) -> State:
    """Multiply vectors in space."""
    return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]


def attitude(e: State) -> list[State]:
    """Return the rows of R(e)."""
    w, x, y, z = e
    return [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]


def turning(e: State, omega: State) -> State:
    """Return e' = e (0, omega) / 2, omega in the body's frame."""
    w, u = e[0], e[1:]
    vector = [w * a + b for a, b in zip(omega, cross(u, omega), strict=True)]
    return [x / 2 for x in (-sum(a * b for a, b in zip(u, omega, strict=True)), *vector)]


def rigid_chain(rods: int = 3, times: Sequence[mpf] = (mpf(1),)) -> None:
    """Hang, with angular velocities (s, 1 - s, 1) along the chain."""
    mass, length = mpf(1) / rods, mpf(1) / rods
    across = mass * length**2 * (3 * RADIUS**2 + 1) / 12
    moments = [across, across, mass * length**2 * RADIUS**2 / 2]

    def split(x: State) -> list[tuple[State, State]]:
        return [(x[7 * i : 7 * i + 4], x[7 * i + 4 : 7 * i + 7]) for i in range(rods)]

    def free(e: State, omega: State, torque: State) -> State:
        """Angular acceleration in space, of a torque in space."""
        rows = attitude(e)
        inside = [sum(rows[k][j] * torque[k] for k in range(3)) for j in range(3)]
        gyro = cross([a * b for a, b in zip(moments, omega, strict=True)], omega)
        alpha = [(a + b) / c for a, b, c in zip(inside, gyro, moments, strict=True)]
        return [sum(rows[k][j] * alpha[j] for j in range(3)) for k in range(3)]

    def accelerations(x: State, forces: Sequence[mpf]) -> tuple[list[State], list[State]]:
        """Gaps of the joints' accelerations and angular accelerations under these joint forces."""
        pull = [list(forces[3 * i : 3 * i + 3]) for i in range(rods)] + [[mpf(0)] * 3]
        gaps, alphas, below = [], [], [mpf(0)] * 3
        for i, (e, omega) in enumerate(split(x)):
            rows = attitude(e)
            arm = [length / 2 * rows[k][2] for k in range(3)]
            spin = [sum(rows[k][j] * omega[j] for j in range(3)) for k in range(3)]
            both = [a + b for a, b in zip(pull[i], pull[i + 1], strict=True)]
            alpha = free(e, omega, cross(arm, both))
            centre = [(a - b) / mass for a, b in zip(pull[i], pull[i + 1], strict=True)]
            centre[2] -= 1
            swing = [
                a + b for a, b in zip(cross(alpha, arm), cross(spin, cross(spin, arm)), strict=True)
            ]
            gaps.append([a + b - c for a, b, c in zip(centre, swing, below, strict=True)])
            below = [a - b for a, b in zip(centre, swing, strict=True)]
            alphas.append(alpha)
        return gaps, alphas

    def field(x: State) -> State:
        size = 3 * rods
        zero = [a for gap in accelerations(x, [mpf(0)] * size)[0] for a in gap]
        matrix = mp.matrix(size, size)
        for j in range(size):
            unit = [mpf(int(k == j)) for k in range(size)]
            column = [a for gap in accelerations(x, unit)[0] for a in gap]
            for k in range(size):
                matrix[k, j] = column[k] - zero[k]
        forces = list(mp.lu_solve(matrix, -mp.matrix(zero)))
        _, alphas = accelerations(x, forces)
        rates: State = []
        for (e, omega), alpha in zip(split(x), alphas, strict=True):
            rows = attitude(e)
            inside = [sum(rows[k][j] * alpha[k] for k in range(3)) for j in range(3)]
            rates += turning(e, omega) + inside
        return rates

    def cartesian(x: State) -> tuple[State, State]:
        q, v, place, moving = [], [], [mpf(0)] * 3, [mpf(0)] * 3
        for e, omega in split(x):
            rows = attitude(e)
            arm = [length / 2 * rows[k][2] for k in range(3)]
            spin = [sum(rows[k][j] * omega[j] for j in range(3)) for k in range(3)]
            swing = cross(spin, arm)
            q += [a - b for a, b in zip(place, arm, strict=True)] + e
            v += [a - b for a, b in zip(moving, swing, strict=True)] + turning(e, omega)
            place = [a - 2 * b for a, b in zip(place, arm, strict=True)]
            moving = [a - 2 * b for a, b in zip(moving, swing, strict=True)]
        return q, v

    def energy(x: State) -> mpf:
        q, v = cartesian(x)
        total = mpf(0)
        for i, (_, omega) in enumerate(split(x)):
            total += mass * (sum(a**2 for a in v[7 * i : 7 * i + 3]) / 2 + q[7 * i + 2])
            total += sum(a * b**2 for a, b in zip(moments, omega, strict=True)) / 2
        return total

    x: State = []
    for i in range(rods):
        s = (mpf(i) + mpf(1) / 2) / rods
        x += [mpf(1), mpf(0), mpf(0), mpf(0), s, 1 - s, mpf(1)]
    for t, state in zip(times, checked("rigid_chain", field, energy, x, times), strict=True):
        q, v = cartesian(state)
        show("rigid_chain", mp.nstr(t, 3), {"q": q, "v": v})


if __name__ == "__main__":
    rigid_chain()
