"""Compute the reference numbers of the polynomial fields in ``liouville.problems``.

Each motion is computed in 45-digit arithmetic by Gragg-Bulirsch-Stoer extrapolation, twice, with
tolerances 1e-30 and 1e-34 a step, from equations written down a second time, with vectors, matrices
and complex numbers where the package has components. An invariant is watched. The numbers are
printed with 25 digits. Needs only mpmath: ``python tools/field_references.py [NAME ...]`` (two
minutes for all).
"""

import sys
from collections.abc import Callable, Sequence

from mpmath import mp, mpc, mpf
from references import Field, State, checked, show

Case = tuple[Field, Callable[[State], mpf], State, Sequence[int]]


def decimals(*numbers: str) -> State:
    """Return numbers as they are written."""
    return [mpf(number) for number in numbers]


def squares(x: State) -> mpf:
    """Return the sum of squares."""
    return mp.fsum(a**2 for a in x)


def cross(u: State, v: State) -> State:
    """Return the vector product."""
    return [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]


def complexes(x: State) -> list[mpc]:
    """Return pairs of numbers as complex ones."""
    return [mpc(a, b) for a, b in zip(x[::2], x[1::2], strict=True)]


def reals(u: Sequence[mpc]) -> State:
    """Return complex numbers as pairs."""
    return [part for z in u for part in (z.real, z.imag)]


def bajer_moffatt() -> Case:
    """Return the flow and, for want of an invariant, zero."""

    def field(x: State) -> State:
        x, y, z = x
        return [z - 8 * x * y, 11 * x * x + 3 * y * y + z * z + x * z - 3, -x + (2 * z - x) * y]

    return field, lambda x: mpf(0), decimals("0.1", "0.2", "-0.3"), (2, 10)


def hill_vortex() -> Case:
    """Return the velocity from the gradient of the stream function, and the latter."""

    def field(x: State) -> State:
        x, y, z = x
        radius = mp.sqrt(x * x + y * y)
        rest = 1 - radius**2 - z * z
        outward = radius * z  # -psi_z / radius
        along = (2 * radius * rest - 2 * radius**3) / (2 * radius)  # psi_radius / radius
        around = radius**2 * rest / 2 / radius  # psi / radius
        c, s = x / radius, y / radius
        return [outward * c - around * s, outward * s + around * c, along]

    def stream(x: State) -> mpf:
        return (x[0] ** 2 + x[1] ** 2) * (1 - squares(x)) / 2

    return field, stream, decimals("0.3", "0.2", "0.4"), (1, 10)


def euler_top() -> Case:
    """Return m x (a m), and the energy."""
    a = decimals("0.5", "1", "1.5")

    def rates(m: State) -> State:
        return [b * c for b, c in zip(a, m, strict=True)]

    def energy(m: State) -> mpf:
        return mp.fdot(m, rates(m)) / 2

    return lambda m: cross(m, rates(m)), energy, decimals("0.6", "-0.3", "0.7"), (4, 10)


def volterra_lattice(n: int = 12) -> Case:
    """Return the growth, and the product."""
    start = [1 + mpf(5 * i % 7 - 2) / 8 for i in range(n)]
    return (
        lambda x: [x[i] * (x[(i + 1) % n] - x[i - 1]) for i in range(n)],
        mp.fprod,
        start,
        (1, 10),
    )


def toda_lattice(n: int = 8) -> Case:
    """Return the Lax equation's right-hand side, entry by entry, and the determinant of L."""

    def lax(x: State) -> tuple[mp.matrix, mp.matrix]:
        left, right = mp.matrix(n), mp.matrix(n)
        for i in range(n):
            k = (i + 1) % n
            left[i, i] = x[n + i]
            left[i, k] = left[k, i] = x[i]
            right[i, k], right[k, i] = x[i], -x[i]
        return left, right

    def field(x: State) -> State:
        left, right = lax(x)
        growth = right * left - left * right
        return [growth[i, (i + 1) % n] for i in range(n)] + [growth[i, i] for i in range(n)]

    start = [mpf(1) / 2] * n + [mpf(3 * i % 7 - 3) / 8 for i in range(n)]
    return field, lambda x: mp.det(lax(x)[0]), start, (1, 10)


def lorenz96(n: int = 36) -> Case:
    """Return the growth, and the energy."""
    start = [mpf(5 * i % 9) / 4 - 1 + mpf(i) / 72 for i in range(n)]

    def field(x: State) -> State:
        return [(x[(i + 1) % n] - x[i - 2]) * x[i - 1] for i in range(n)]

    return field, squares, start, (1, 5)


def euler2d(largest: int = 2) -> Case:
    """Return -psi_x omega_y + psi_y omega_x on all modes, and the enstrophy."""
    waves = range(-largest, largest + 1)
    kept = [(a, b) for b in waves for a in waves if (b, a) > (0, 0)]
    size = len(kept)

    def field(x: State) -> State:
        half = dict(zip(kept, complexes(x), strict=True))
        omega = half | {(-a, -b): mp.conj(z) for (a, b), z in half.items()}
        psi = {k: -z / (k[0] ** 2 + k[1] ** 2) for k, z in omega.items()}
        growth = dict.fromkeys(kept, mpc(0))
        for p, first in psi.items():
            for q, second in omega.items():
                k = p[0] + q[0], p[1] + q[1]
                if k in growth:
                    growth[k] -= (p[1] * q[0] - p[0] * q[1]) * first * second
        return reals([growth[k] for k in kept])

    start = []
    for m, (a, b) in enumerate(kept):
        start += [mpf(c) / (8 * (a * a + b * b)) for c in (5 * m % 11 - 5, 7 * m % 13 - 6)]
    assert len(start) == 2 * size
    return field, squares, start, (1, 10)


def sabra(n: int = 8) -> Case:
    """Return the complex growth, and the helicity."""
    k = [mpf(2) ** i / 16 for i in range(n + 3)]

    def field(x: State) -> State:
        u = [mpc(0), mpc(0), *complexes(x), mpc(0), mpc(0)]  # u[i + 1] is u_i
        growth = []
        for i in range(1, n + 1):
            j = i + 1
            triads = k[i + 1] * mp.conj(u[j + 1]) * u[j + 2]
            triads -= k[i] / 2 * mp.conj(u[j - 1]) * u[j + 1]
            triads += k[i - 1] / 2 * u[j - 1] * u[j - 2]
            growth.append(mpc(0, 1) * triads)
        return reals(growth)

    def helicity(x: State) -> mpf:
        return mp.fsum((-2) ** (i + 1) * abs(u) ** 2 for i, u in enumerate(complexes(x)))

    size = [mpf(2) ** (-mpf(i) / 3) for i in range(1, n + 1)]
    start = reals([a * mp.expj(i**2) for i, a in enumerate(size, start=1)])
    return field, helicity, start, (1, 10)


def maxwell_bloch() -> Case:
    """Return e', p' and d' with complex e and p, and the length of Bloch's vector."""

    def field(x: State) -> State:
        e, p = complexes(x[:4])
        d = x[4]
        return [*reals([p, mpc(0, "0.5") * p + e * d]), -(mp.conj(e) * p).real]

    start = decimals("0.6", "0.1", "0.3", "-0.2", "0.8")
    return field, lambda x: squares(x[2:]), start, (1, 20)


def cubic_charge() -> Case:
    """Return velocity and acceleration, and the energy."""

    def field(x: State) -> State:
        q, v = x[:3], x[3:]
        flux = [-q[0] * q[2], -q[1] * q[2], 2 + q[2] ** 2 - (q[0] ** 2 + q[1] ** 2) / 2]
        return [*v, *(f - a**3 for f, a in zip(cross(v, flux), q, strict=True))]

    def energy(x: State) -> mpf:
        return squares(x[3:]) / 2 + squares([a**2 for a in x[:3]]) / 4

    return field, energy, decimals("0.9", "0", "0.4", "0.1", "0.5", "0.3"), (1, 10)


def abc_flow() -> Case:
    """Return the flow and, for want of an invariant, zero."""

    def field(x: State) -> State:
        s, c = [mp.sin(a) for a in x], [mp.cos(a) for a in x]
        return [s[2] + c[1], s[0] + c[2], s[1] + c[0]]

    return field, lambda x: mpf(0), decimals("0.1", "0.2", "0.3"), (1, 10)


CASES = {
    case.__name__: case
    for case in (
        bajer_moffatt,
        hill_vortex,
        euler_top,
        volterra_lattice,
        toda_lattice,
        lorenz96,
        euler2d,
        sabra,
        maxwell_bloch,
        cubic_charge,
        abc_flow,
    )
}


if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        field, invariant, start, times = CASES[name]()
        states = checked(name, field, invariant, start, [mpf(t) for t in times])
        for t, state in zip(times, states, strict=True):
            show(name, t, {"x": state})
