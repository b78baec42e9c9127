"""Compute the references of ``liouville.problems.polymer``, as ``references.py`` does others.

Cartesian accelerations with the tensions of the bonds eliminated, in 45-digit arithmetic, at two
tolerances. Needs only mpmath: ``python tools/polymer_reference.py`` (some minutes).
"""

from collections.abc import Iterator, Sequence

from mpmath import mp, mpf
from references import State, checked, show


def minus(a: State, b: State) -> State:
    """Subtract vectors."""
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a: State, b: State) -> mpf:
    """Multiply vectors."""
    return sum((x * y for x, y in zip(a, b, strict=True)), mpf(0))


def cross(a: State, b: State) -> State:
    """Multiply vectors in space."""
    return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]


def differences(rows: list[State]) -> list[State]:
    """Subtract each row from the next."""
    return [minus(rows[i + 1], rows[i]) for i in range(len(rows) - 1)]


def tensions(bonds: list[State], load: State) -> State:
    """Solve 2 |b_i|^2 s_i - b_i . (b_{i-1} s_{i-1} + b_{i+1} s_{i+1}) = load_i."""
    pivots, s = [2 * dot(bonds[0], bonds[0])], load[:]
    beside = [-dot(bonds[i], bonds[i + 1]) for i in range(len(bonds) - 1)]
    for i, c in enumerate(beside):
        pivots.append(2 * dot(bonds[i + 1], bonds[i + 1]) - c**2 / pivots[i])
        s[i + 1] -= c / pivots[i] * s[i]
    s[-1] /= pivots[-1]
    for i in reversed(range(len(beside))):
        s[i] = (s[i] - beside[i] * s[i + 1]) / pivots[i]
    return s


def pulled(rows: list[State], bonds: list[State], s: State) -> list[State]:
    """Add pulls s_i along bonds i to the rows at their ends."""
    rows = [row[:] for row in rows]
    for i, (bond, pull) in enumerate(zip(bonds, s, strict=True)):
        for k in range(3):
            rows[i][k] += pull * bond[k]
            rows[i + 1][k] -= pull * bond[k]
    return rows


def draws() -> Iterator[mpf]:
    """Draw numbers between 0 and 1: x <- 48271 x mod 2^31 - 1, from 1."""
    x = 1
    while True:
        x = 48271 * x % (2**31 - 1)
        yield mpf(x) / (2**31 - 1)


def folded(beads: int, rest: mpf) -> State:
    """Fold a chain at random and give it random velocities that its bonds allow."""
    random, sine = draws(), mp.sqrt(1 - rest**2)
    bond, normal = [mpf(1), mpf(0), mpf(0)], [mpf(0), mpf(0), mpf(1)]
    r, v = [[mpf(0)] * 3, bond], []
    for _ in range(beads - 2):
        turn, inward = 2 * mp.pi * next(random), cross(normal, bond)
        across = [mp.cos(turn) * a + mp.sin(turn) * c for a, c in zip(inward, normal, strict=True)]
        after = [rest * a + sine * c for a, c in zip(bond, across, strict=True)]
        normal = [c / sine for c in cross(bond, after)]
        bond = after
        r.append([a + c for a, c in zip(r[-1], bond, strict=True)])
    for _ in range(beads):
        v.append([])
        for _ in range(3):
            radius = mp.sqrt(-2 * mp.log(next(random)))
            v[-1].append(radius * mp.cos(2 * mp.pi * next(random)))
    r, v = (
        [minus(row, [sum(c) / beads for c in zip(*rows, strict=True)]) for row in rows]
        for rows in (r, v)
    )
    bonds, rates = differences(r), differences(v)
    along = [dot(bond, rate) for bond, rate in zip(bonds, rates, strict=True)]
    return [c for row in (*r, *pulled(v, bonds, tensions(bonds, along))) for c in row]


def polymer(beads: int = 20, times: Sequence[mpf] = (mpf(1),)) -> None:
    """r_i'' = f_i + s_i b_i - s_{i-1} b_{i-1}: tensions s from b . b'' + |b'|^2 = 0."""
    rest, stiffness, trap = mpf(1) / 3, mpf(20), mpf("0.02")

    def points(x: State) -> list[State]:
        return [x[3 * i : 3 * i + 3] for i in range(beads)]

    def field(x: State) -> State:
        r, v = points(x[: 3 * beads]), points(x[3 * beads :])
        b, rates = differences(r), differences(v)
        a = [[-trap * c for c in row] for row in r]
        for i in range(len(b) - 1):
            pull = stiffness * (dot(b[i], b[i + 1]) - rest)
            for k in range(3):
                first, second = pull * b[i + 1][k], pull * b[i][k]
                a[i][k] += first
                a[i + 1][k] += second - first
                a[i + 2][k] -= second
        apart = differences(a)
        load = [dot(b[i], apart[i]) + dot(rates[i], rates[i]) for i in range(len(b))]
        a = pulled(a, b, tensions(b, load))
        return [*x[3 * beads :], *(c for row in a for c in row)]

    def energy(x: State) -> mpf:
        b = differences(points(x[: 3 * beads]))
        bent = sum((dot(b[i], b[i + 1]) - rest) ** 2 for i in range(len(b) - 1))
        kinetic, trapped = dot(x[3 * beads :], x[3 * beads :]), dot(x[: 3 * beads], x[: 3 * beads])
        return (kinetic + stiffness * bent + trap * trapped) / 2

    x = folded(beads, rest)
    for t, state in zip(times, checked("polymer", field, energy, x, times), strict=True):
        show("polymer", mp.nstr(t, 3), {"q": state[: 3 * beads], "v": state[3 * beads :]})


if __name__ == "__main__":
    polymer()
