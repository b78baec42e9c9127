"""Compute the references of those ``liouville.problems`` that are made of bodies and joints.

Each motion is computed from minimal coordinates worked out by hand, which share nothing with the
models, and printed as positions and quaternions:

    four_bars             the angle of the rods
    jansen_leg            the crank's angle, corners by intersections of circles
    spatial_slider_crank  the crank's angle
    flyball_governor      the angles of the spindle and of the arms

All in 32 digits, each at two tolerances, and the difference is printed with it. Run as
``python tools/mechanism_references.py NAME``, some minutes each. ``tools/stewart_reference.py`` has
the Stewart platform.
"""
# ruff: noqa: T201

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mpmath import mp, mpf
from references import G, extrapolate, show

from liouville.problems import flyball_governor as governor
from liouville.problems import jansen_leg
from liouville.problems import spatial_slider_crank as slider

mp.dps = 32
Numbers = list[Any]


def vector(*values: float) -> Any:
    """Return a vector of multiprecision numbers, as they are written in decimals."""
    return np.array([mpf(str(x)) for x in values], dtype=object)


def cross(a: Any, b: Any) -> Any:
    """Return a x b."""
    return np.array([a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)])


def quaternion(matrix: Any, near: Any, root: Callable[[Any], Any] = mp.sqrt) -> Any:
    """Return the quaternion of a rotation matrix on the side of another one."""
    m = matrix
    squares = [
        1 + m[0, 0] + m[1, 1] + m[2, 2],
        1 + m[0, 0] - m[1, 1] - m[2, 2],
        1 - m[0, 0] + m[1, 1] - m[2, 2],
        1 - m[0, 0] - m[1, 1] + m[2, 2],
    ]
    largest = max(range(4), key=lambda k: squares[k])
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    rows = [[squares[0], a, b, c], [a, squares[1], xy, xz], [b, xy, squares[2], yz]]
    rows.append([c, xz, yz, squares[3]])
    found = np.array(rows[largest], dtype=object) / (2 * root(squares[largest]))
    return found if sum(found * near) > 0 else -found


def rate_of(e: Any, omega: Any) -> Any:
    """Return e' of an angular velocity in the world."""
    w, u = e[0], e[1:]
    return np.array([-sum(omega * u), *(w * omega + cross(omega, u))]) / 2


def one_freedom(name: str, bodies: Callable[..., Any], angle: Any, rate: Any, times: Any) -> None:
    """Show a conservative motion of an angle that never stops.

    ``bodies(a)`` gives the rows of q, those of v for a' = 1, twice the kinetic energy for a' = 1,
    and the potential.
    """
    _, _, inertia, potential = bodies(angle)
    energy = inertia * rate**2 / 2 + potential

    def speed(a: Any) -> Any:
        _, _, inertia, potential = bodies(a)
        return mp.sign(rate) * mp.sqrt(2 * (energy - potential) / inertia)

    def field(x: Numbers) -> Numbers:
        return [speed(x[0])]

    coarse, fine = (extrapolate(field, [angle], times, mpf(10) ** -d) for d in (21, 24))
    apart = max(abs(a[0] - b[0]) for a, b in zip(coarse, fine, strict=True))
    print(f"{name}: two tolerances differ by {mp.nstr(apart, 2)}")
    for time, (a,) in zip(times, fine, strict=True):
        q, v, *_ = bodies(a)
        show(name, time, {"q": q, "v": [x * speed(a) for x in v]})


def jansen(times: Sequence[Any] = (mpf(1) / 2, mpf(1))) -> None:
    """Corners are complex numbers here, with their derivatives by the crank's angle."""
    n = {key: mpf(str(round(100 * size, 6))) / 100 for key, size in jansen_leg.LENGTHS.items()}

    def meet(p: Any, q: Any, to_p: Any, to_q: Any) -> Any:
        (p, dp), (q, dq) = p, q
        across = q - p
        gap = abs(across)
        along = (gap**2 + to_p**2 - to_q**2) / (2 * gap)
        found = p + across / gap * (along + 1j * mp.sqrt(to_p**2 - along**2))
        # distances are kept: (found - p) . (rate - dp) = 0, and likewise for q
        a, b = found - p, found - q
        first = (mp.conj(a) * dp).real
        second = (mp.conj(b) * dq).real
        det = a.real * b.imag - a.imag * b.real
        rate = mp.mpc(first * b.imag - second * a.imag, a.real * second - b.real * first) / det
        return found, rate

    starts: Numbers = []

    def bodies(angle: Any) -> Any:
        zero, fixed = mp.mpc(0), mp.mpc(-n["a"], -n["l"])
        pin = n["m"] * mp.expj(angle), 1j * n["m"] * mp.expj(angle)
        pivot = fixed, zero
        top = meet(pivot, pin, n["b"], n["j"])
        low = meet(pin, pivot, n["k"], n["c"])
        back = meet(pivot, top, n["d"], n["e"])
        knee = meet(low, back, n["g"], n["f"])
        foot = meet(low, knee, n["i"], n["h"])
        rows: list[Numbers] = [[zero, zero, angle, mpf(1), mpf(1), mpf("0.05")]]

        def rod(a: Any, b: Any) -> None:
            along, rate = b[0] - a[0], b[1] - a[1]
            length = abs(along)
            turn = (rate / along).imag
            rows.append([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, mp.arg(along), turn])
            rows[-1] += [length, length**3 / 12]

        def plate(a: Any, b: Any, c: Any) -> None:
            sides = [abs(x[0] - y[0]) for x, y in ((a, b), (b, c), (c, a))]
            mass = sum(sides)
            along, rate = b[0] - a[0], b[1] - a[1]
            centre, moving = ((a[k] + b[k] + c[k]) / 3 for k in range(2))
            rows.append([centre, moving, mp.arg(along), (rate / along).imag])
            rows[-1] += [mass, mass * sum(side**2 for side in sides) / 36]

        rod(pin, top)
        rod(pin, low)
        rod(pivot, low)
        plate(pivot, top, back)
        rod(back, knee)
        plate(low, knee, foot)
        angles = [row[2] for row in rows]
        if not starts:
            starts.extend(angles)
        q, v = [], []
        inertia = potential = mpf(0)
        for k, (x, dx, turn, rate, mass, moment) in enumerate(rows):
            # of rods as drawn, of plates zero as drawn; no body but the crank turns around
            own = turn - starts[k] if k in (4, 6) else turn
            own = own if k == 0 else own - 2 * mp.pi * mp.nint((turn - starts[k]) / (2 * mp.pi))
            q += [x.real, x.imag, own]
            v += [dx.real, dx.imag, rate]
            inertia += mass * abs(dx) ** 2 + moment * rate**2
            potential += mass * G * x.imag
        return q, v, inertia, potential

    one_freedom("jansen_leg", bodies, mpf(0), mpf(8), times)


def carried(u: Any, du: Any, first: Any) -> tuple[Any, Any]:
    """Return frame and angular velocity of a bar on a universal joint, and of its second axis.

    The bar is the third axis, its second is across the first axis of the joint, which stands still.
    """
    w, dw = cross(u, first), cross(du, first)
    size = mp.sqrt(sum(w * w))
    y = w / size
    x = cross(y, u)
    omega = cross(u, du) - u * sum(dw * x) / size
    return np.array([x, y, u]).T, omega


def slider_crank(times: Sequence[Any] = (mpf(1), mpf(2))) -> None:
    """Find the slider by the rod's length, and the rod's turn by its universal joint."""
    centre, crank, length = vector(*slider.CENTRE), mpf("0.08"), mpf("0.3")
    masses = vector(*slider.MASSES)
    moments = [vector(*own) for own in slider.INERTIAS]
    sides = [vector(1, 0, 0, 0), vector(*slider.assembly._bodies["rod"].rotation)]
    x = vector(1, 0, 0)

    def bodies(angle: Any) -> Any:
        c, s = mp.cos(angle), mp.sin(angle)
        arm, swing = crank * np.array([mpf(0), -s, c]), crank * np.array([mpf(0), -c, -s])
        pin = centre + arm
        place = mp.sqrt(length**2 - pin[1] ** 2 - pin[2] ** 2)
        rate = -(pin[1] * swing[1] + pin[2] * swing[2]) / place
        u, du = (pin - place * x) / length, (swing - rate * x) / length
        frame, omega = carried(u, du, x)
        half = np.array([mp.cos(angle / 2), mp.sin(angle / 2), mpf(0), mpf(0)])
        e = quaternion(frame, sides[1])
        rows = [
            (centre + arm / 2, swing / 2, half, x, x),
            ((pin + place * x) / 2, (swing + rate * x) / 2, e, omega, frame.T @ omega),
            (place * x, rate * x, sides[0], 0 * x, 0 * x),
        ]
        q, v = [], []
        inertia = potential = mpf(0)
        for mass, moment, (at, dat, turn, spin, own) in zip(masses, moments, rows, strict=True):
            q += [*at, *turn]
            v += [*dat, *rate_of(turn, spin)]
            inertia += mass * sum(dat * dat) + sum(moment * own * own)
            potential += mass * G * at[2]
        return q, v, inertia, potential

    one_freedom("spatial_slider_crank", bodies, mpf(0), mpf(6), times)


def two_tolerances(name: str, field: Callable[..., Any], x: Numbers, times: Any) -> Any:
    """Integrate at two tolerances, say how far they differ, and return the finer states."""
    coarse, fine = (extrapolate(field, x, times, mpf(10) ** -d) for d in (21, 24))
    apart = max(abs(a - b) for a, b in zip(coarse[-1], fine[-1], strict=True))
    print(f"{name}: two tolerances differ by {mp.nstr(apart, 2)}")
    return fine


def four_bars(times: Sequence[Any] = (mpf(1), mpf(2)), loops: int = 3) -> None:
    """All rods are one pendulum."""
    inertia, weight = mpf(loops + 1) / 3 + loops, mpf(loops + 1) / 2 + loops
    factor = weight / inertia * G
    start = [mp.pi / 2, mpf(-1)]
    found = two_tolerances("four_bars", lambda x: [x[1], -factor * mp.cos(x[0])], start, times)
    for time, (a, rate) in zip(times, found, strict=True):
        c, s = mp.cos(a), mp.sin(a)
        q, v = [], []
        for k in range(loops + 1):
            q += [k + c / 2, s / 2, a]
            v += [-s * rate / 2, c * rate / 2, rate]
        for k in range(loops):
            q += [k + mpf(1) / 2 + c, s, mpf(0)]
            v += [-s * rate, c * rate, mpf(0)]
        show("four_bars", time, {"q": q, "v": v})


def flyball(times: Sequence[Any] = (mpf(1), mpf(2))) -> None:
    """Lagrange's equations of the angles of the spindle, f, and of the arms, c."""
    offset, height, arm, lever, rod = vector(
        governor.OFFSET, governor.HEIGHT, governor.ARM, governor.LEVER, governor.ROD
    )
    ball, across, own = mpf("1"), mpf("0.02"), mpf("0.004")
    sleeve, turning, k = mpf("0.8"), mpf("0.02") + mpf("0.008"), mpf(40)
    begin = mpf(str(governor.ANGLE))

    def height_of(c: Any) -> Any:
        """Return the sleeve's height and two derivatives by c."""
        s, co = mp.sin(c), mp.cos(c)
        root = mp.sqrt(rod**2 - lever**2 * s**2)
        d1 = -(lever**2) * s * co / root
        d2 = -(lever**2) * (co**2 - s**2) / root - (lever**2 * s * co) ** 2 / root**3
        return height - lever * co - root, lever * s - d1, lever * co - d2

    level = height_of(begin)[0]

    def field(x: Numbers) -> Numbers:
        _, c, df, dc = x
        s, co = mp.sin(c), mp.cos(c)
        z, z1, z2 = height_of(c)
        a = 2 * (ball * arm**2 + across) + sleeve * z1**2
        b = turning + 2 * (ball * (offset + arm * s) ** 2 + across * s**2 + own * co**2)
        db = 4 * (ball * (offset + arm * s) * arm * co + (across - own) * s * co)
        slope = 2 * ball * G * arm * s + (sleeve * G + k * (z - level)) * z1
        return [df, dc, -db * dc * df / b, (db * df**2 / 2 - sleeve * z1 * z2 * dc**2 - slope) / a]

    found = two_tolerances("flyball_governor", field, [mpf(0), begin, mpf(6), mpf(0)], times)
    drawn = {name: vector(*governor.assembly._bodies[name].rotation) for name in ("right", "left")}
    up = vector(0, 0, 1)
    for time, (f, c, df, dc) in zip(times, found, strict=True):
        out = np.array([mp.cos(f), mp.sin(f), mpf(0)])
        aside = cross(up, out)
        spin = df * up
        half = np.array([mp.cos(f / 2), mpf(0), mpf(0), mp.sin(f / 2)])
        z, z1, _ = height_of(c)
        q = [*(height / 2 * up), *half, *(z * up), *half]
        v = [*(0 * up), *rate_of(half, spin), *(z1 * dc * up), *rate_of(half, spin)]
        for name, side in (("right", 1), ("left", -1)):
            along = side * mp.sin(c) * out - mp.cos(c) * up
            # turned by f from the attitude as drawn, about the hinge by the change of c
            first = cross(aside, along)
            frame = np.array([first, cross(along, first), along]).T
            omega = spin - side * dc * aside
            e = near_turn(frame, drawn[name], f, side * (begin - c))
            place = side * offset * out + height * up + arm * along
            moving = side * offset * df * aside + arm * cross(omega, along)
            q += [*place, *e]
            v += [*moving, *rate_of(e, omega)]
        show("flyball_governor", time, {"q": q, "v": v})


def near_turn(frame: Any, drawn: Any, f: Any, lean: Any) -> Any:
    """Return the quaternion of a frame on the side of a turn by f after one by lean."""
    w, x, y, z = drawn
    c, s = mp.cos(lean / 2), mp.sin(lean / 2)
    leant = [c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x]
    c, s = mp.cos(f / 2), mp.sin(f / 2)
    w, x, y, z = leant
    return quaternion(frame, np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w]))


ALL = {
    "four_bars": four_bars,
    "jansen_leg": jansen,
    "spatial_slider_crank": slider_crank,
    "flyball_governor": flyball,
}

if __name__ == "__main__":
    for wanted in sys.argv[1:] or ALL:
        ALL[wanted]()
