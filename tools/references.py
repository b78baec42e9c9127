"""Compute the reference numbers of ``liouville.problems`` that are not published elsewhere.

Each motion is computed in 45-digit arithmetic from equations that share nothing with the models of
the package (closed form, quadrature, or minimal coordinates), and printed with 25 digits:

    pendulum               closed form by Jacobi's elliptic functions
    slider_crank           one degree of freedom: t = int sqrt(I(a) / (2 (E - V(a)))) da
    hinged_fourbar         likewise, by the crank's angle
    bricard                likewise, by the angle at the ground's first hinge
    chain                  link angles, integrated by Gragg-Bulirsch-Stoer extrapolation
    relativistic_particle  canonical equations in spherical angles, integrated likewise
    circular_track         closed form
    knife_edge             closed form
    rolling_disk           its two angles, integrated likewise
    chaplygin_sleigh       speed and angle in closed form, the path by quadrature
    rolling_ball           the centre in closed form, the attitude integrated likewise
    belt                   closed form
    ladder                 its angle, on the wall and beside it, integrated likewise
    rocking_block          its angle, from one corner to the other, integrated likewise

Each is computed twice, with another tolerance or another partition of the quadrature, and the
difference is printed with it. Needs only mpmath: ``python tools/references.py`` (two minutes).
"""
# ruff: noqa: T201

from collections.abc import Callable, Sequence

from mpmath import mp, mpf

mp.dps = 45
G = mpf("9.81")

State = list[mpf]
Field = Callable[[State], State]


def midpoint(f: Field, x: State, h: mpf, n: int) -> State:
    """Go one step ``h`` by Gragg's midpoint rule with ``n`` substeps; its error is even in h/n."""
    d = h / n
    before, now = x, [a + d * b for a, b in zip(x, f(x), strict=True)]
    for _ in range(n - 1):
        before, now = now, [a + 2 * d * b for a, b in zip(before, f(now), strict=True)]
    return [(a + b + d * c) / 2 for a, b, c in zip(before, now, f(now), strict=True)]


def extrapolate(f: Field, x: State, times: Sequence[mpf], tol: mpf, columns: int = 16) -> list:
    """States at ``times`` of x' = f(x), x(0) = ``x``, with error at most ``tol`` a step."""
    t, h, found = mpf(0), mpf(1) / 50, []
    for end in times:
        while t < end:
            step = min(h, end - t)
            table: list[State] = []
            for j in range(1, columns + 1):
                row = [midpoint(f, x, step, 2 * j)]
                for k in range(1, j):
                    ratio = (mpf(j) / (j - k)) ** 2 - 1
                    row.append(
                        [a + (a - b) / ratio for a, b in zip(row[-1], table[k - 1], strict=True)]
                    )
                table, last = row, table
            error = max(abs(a - b) for a, b in zip(table[-1], last[-1], strict=True))
            if error <= tol:
                t, x = t + step, table[-1]
            growth = (tol / (error + tol**2)) ** (mpf(1) / (2 * columns - 1))
            h = step * min(mpf(3), mpf("0.8") * growth)
        found.append(x)
    return found


def show(name: str, time: object, values: dict[str, Sequence[mpf]]) -> None:
    """Print one reference the way the problem modules hold it."""
    print(f"{name}, t = {time}")
    for key, row in values.items():
        print(f'    "{key}": (' + ", ".join(mp.nstr(a, 25) for a in row) + ")")


def checked(name: str, f: Field, energy: Callable, x: State, times: Sequence[mpf]) -> list:
    """Integrate at two tolerances, say how far they differ, and return the finer states."""
    coarse, fine = (extrapolate(f, x, times, mpf(10) ** -d) for d in (30, 34))
    apart = max(abs(a - b) for a, b in zip(coarse[-1], fine[-1], strict=True))
    drift = abs(energy(fine[-1]) - energy(x))
    print(f"{name}: two tolerances differ by {mp.nstr(apart, 2)}, energy by {mp.nstr(drift, 2)}")
    return fine


def pendulum(times: Sequence[int] = (10, 100, 2000)) -> None:
    """Released from the horizontal: sin(a/2) = k sn(K - w t), k^2 = 1/2, w^2 = g / l."""
    m, w = mpf(1) / 2, mp.sqrt(G)
    for t in times:
        u = mp.ellipk(m) - w * t
        sn, cn, dn = (mp.ellipfun(kind, u, m=m) for kind in ("sn", "cn", "dn"))
        # sin a = 2 sin(a/2) cos(a/2) with sin(a/2) = sn/sqrt(2), cos(a/2) = dn
        a_dot = -mp.sqrt(2) * w * cn
        x, y = mp.sqrt(2) * sn * dn, sn**2 - 1
        v = (-y * a_dot, x * a_dot)
        show("pendulum", t, {"q": (x, y), "v": v, "lam": [a_dot**2 - G * y]})


def slider_crank(times: Sequence[mpf] = (mpf("0.05"), mpf("0.1"))) -> None:
    """Crank angle a by quadrature; the rod's angle b follows from l1 sin a + l2 sin b = 0."""
    l1, l2, m1, m2, m3 = (mpf(a) for a in ("0.153", "0.306", "0.038", "0.038", "0.076"))
    j1, j2, start = mpf("7.4e-5"), mpf("5.9e-4"), mpf(150)

    def rod(a: mpf) -> tuple[mpf, mpf]:
        b = -mp.asin(l1 * mp.sin(a) / l2)
        return b, -l1 * mp.cos(a) / (l2 * mp.cos(b))

    def inertia(a: mpf) -> mpf:
        b, db = rod(a)
        rod_x = -l1 * mp.sin(a) - l2 / 2 * mp.sin(b) * db
        rod_y = l1 * mp.cos(a) + l2 / 2 * mp.cos(b) * db
        slider = -l1 * mp.sin(a) - l2 * mp.sin(b) * db
        return j1 + m1 * l1**2 / 4 + j2 * db**2 + m2 * (rod_x**2 + rod_y**2) + m3 * slider**2

    def potential(a: mpf) -> mpf:
        return G * (m1 / 2 + m2 / 2) * l1 * mp.sin(a)

    energy = inertia(mpf(0)) * start**2 / 2

    def speed(a: mpf) -> mpf:
        return mp.sqrt(2 * (energy - potential(a)) / inertia(a))

    def elapsed(a: mpf, pieces: int = 17) -> mpf:
        return mp.quad(lambda s: 1 / speed(s), mp.linspace(0, a, pieces + 1))

    for t in times:
        a = start * t
        for _ in range(20):
            a -= (elapsed(a) - t) * speed(a)
        b, db = rod(a)
        w = speed(a)
        slider = -(l1 * mp.sin(a) + l2 * mp.sin(b) * db) * w
        apart = abs(elapsed(a, pieces=23) - t) * w
        print(f"slider_crank: another partition differs by {mp.nstr(apart, 2)}")
        q = (a, b, l1 * mp.cos(a) + l2 * mp.cos(b))
        show("slider_crank", mp.nstr(t, 3), {"q": q, "v": (w, db * w, slider)})


Bodies = list[tuple[mpf, mpf, mpf]]


def one_freedom(
    name: str, frames: Callable[[mpf], State], bodies: Bodies, start: State, times: Sequence[mpf]
) -> None:
    """Rods by mass, length and radius, their centres and directors as functions of an angle."""

    def rates(a: mpf) -> State:
        with mp.workdps(60):  # the difference is off by 1e-40
            d = mpf(10) ** -20
            ahead, behind = frames(a + d), frames(a - d)
            return [(x - y) / (2 * d) for x, y in zip(ahead, behind, strict=True)]

    def inertia(a: mpf) -> mpf:
        moved, total = rates(a), mpf(0)
        for k, (mass, length, radius) in enumerate(bodies):
            weights = (mass, mass * length**2 / 12, *[mass * radius**2 / 4] * 2)
            for j, weight in enumerate(weights):
                first = 12 * k + 3 * j
                total += weight * sum(x**2 for x in moved[first : first + 3])
        return total

    def potential(a: mpf) -> mpf:
        places = frames(a)
        return G * sum(mass * places[12 * k + 1] for k, (mass, _, _) in enumerate(bodies))

    begin, rate = start
    energy = inertia(begin) * rate**2 / 2 + potential(begin)

    def speed(a: mpf) -> mpf:
        return mp.sign(rate) * mp.sqrt(2 * (energy - potential(a)) / inertia(a))

    def elapsed(a: mpf, pieces: int = 5) -> mpf:
        return mp.quad(lambda s: 1 / speed(s), mp.linspace(begin, a, pieces + 1))

    for t in times:
        a = begin + rate * t
        for _ in range(12):
            with mp.workdps(30):
                step = (elapsed(a) - t) * speed(a)
            a -= step
            if abs(step) < mpf(10) ** -27:
                break
        with mp.workdps(30):
            apart = abs(elapsed(a, pieces=7) - t) * abs(speed(a))
        print(f"{name}: another partition differs by {mp.nstr(apart, 2)}")
        moving = [speed(a) * x for x in rates(a)]
        show(name, mp.nstr(t, 3), {"q": frames(a), "v": moving})


def hinged_fourbar(times: Sequence[mpf] = (mpf("0.5"), mpf(1))) -> None:
    """Crank, coupler and rocker as complex numbers; the coupler's side by the law of cosines."""
    lengths, ground = [mpf(x) for x in ("0.5", "1", "0.9")], mpf("1.1")

    def frames(a: mpf) -> State:
        crank = mp.expj(a)
        pin = lengths[0] * crank
        gap = abs(ground - pin)
        lift = mp.acos((lengths[1] ** 2 + gap**2 - lengths[2] ** 2) / (2 * lengths[1] * gap))
        coupler = (ground - pin) / gap * mp.expj(lift)
        rocker = (pin + lengths[1] * coupler - ground) / lengths[2]
        found: State = []
        ends = zip((0, pin, ground), (crank, coupler, rocker), lengths, strict=True)
        for end, along, length in ends:
            for z in (end + length / 2 * along, along, 1j * along):
                found += [mp.re(z), mp.im(z), mpf(0)]
            found += [mpf(0), mpf(0), mpf(1)]
        return found

    masses, radius = [mpf(1), mpf(2), mpf("1.8")], mpf(1) / 10
    bodies = [(m, length, radius) for m, length in zip(masses, lengths, strict=True)]
    one_freedom("hinged_fourbar", frames, bodies, [mpf(1), mpf(6)], times)


def bricard(times: Sequence[mpf] = (mpf("0.2"), mpf("0.4"))) -> None:
    """Turn about the hinges, and by right angles between them, bar after bar."""

    def turn(axis: int, angle: mpf) -> mp.matrix:
        c, s = mp.cos(angle), mp.sin(angle)
        if axis == 0:
            return mp.matrix([[1, 0, 0], [0, c, -s], [0, s, c]])
        return mp.matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    def frames(a: mpf) -> State:
        b = mp.acos(-mp.cos(a) / (1 + mp.cos(a)))
        place, attitude, found = mp.matrix([1, 0, 0]), turn(0, mp.pi / 2), []
        for k in range(1, 6):
            attitude = attitude * turn(2, b if k % 2 else a)
            found += [*(place + attitude[:, 0] / 2), *(attitude.T)]
            place = place + attitude[:, 0]
            attitude = attitude * turn(0, -mp.pi / 2 if k % 2 else mp.pi / 2)
        return found

    bodies = [(mpf(1), mpf(1), mpf(1) / 10)] * 5
    one_freedom("bricard", frames, bodies, [mp.pi / 2, mpf(-3)], times)


def chain(links: int = 10, times: Sequence[mpf] = (mpf(1),)) -> None:
    """Angles a_j from the vertical: sum_k W_jk (cos(a_j-a_k) a_k'' + sin(a_j-a_k) a_k'^2) = f_j."""
    n, length = range(links), mpf(1) / links
    first = mpf("2.404825557695772768622")

    def weight(j: int) -> int:
        return links - j  # masses carried by link j

    def field(x: State) -> State:
        a, w = x[:links], x[links:]
        mass = mp.matrix(links)
        load = mp.matrix(links, 1)
        for j in n:
            load[j] = -weight(j) * mp.sin(a[j]) / length
            for k in n:
                common, turn = weight(max(j, k)), a[j] - a[k]
                mass[j, k] = common * mp.cos(turn)
                load[j] -= common * mp.sin(turn) * w[k] ** 2
        return [*w, *mp.lu_solve(mass, load)]

    def cartesian(x: State) -> tuple[State, State]:
        q, v = [], []
        position, velocity = mp.mpc(0), mp.mpc(0)
        for a, w in zip(x[:links], x[links:], strict=True):
            position += length * mp.mpc(mp.sin(a), -mp.cos(a))
            velocity += length * w * mp.mpc(mp.cos(a), mp.sin(a))
            q += [position.real, position.imag]
            v += [velocity.real, velocity.imag]
        return q, v

    def energy(x: State) -> mpf:
        q, v = cartesian(x)
        return sum((c**2 for c in v), mpf(0)) * length / 2 + sum(q[1::2]) * length

    across = [mp.besselj(0, first * mp.sqrt(1 - mpf(i + 1) / links)) for i in n]
    x = [mpf(0)] * links + [(across[i] - (across[i - 1] if i else 0)) / length for i in n]
    for t, state in zip(times, checked("chain", field, energy, x, times), strict=True):
        q, v = cartesian(state)
        show("chain", mp.nstr(t, 3), {"q": q, "v": v})


def relativistic_particle(times: Sequence[mpf] = (mpf(5), mpf(10))) -> None:
    """H = sqrt(1 + p_a^2 + u^2) + cos a, u = (l - b sin^2 a) / sin a: polar angle a, azimuth f."""
    b = mpf(1)  # half the magnetic field; the canonical angular momentum l is constant
    q, v = [mpf("0.8"), mpf(0), mpf("0.6")], [mpf("0.3"), mpf("0.5"), mpf("-0.4")]
    gamma = 1 / mp.sqrt(1 - sum(c**2 for c in v))
    momentum = q[0] * (gamma * v[1] + b * q[0])

    def gamma_of(a: mpf, p: mpf) -> tuple[mpf, mpf]:
        u = momentum / mp.sin(a) - b * mp.sin(a)
        return mp.sqrt(1 + p**2 + u**2), u

    def field(x: State) -> State:
        a, _, p = x
        factor, u = gamma_of(a, p)
        du = -momentum * mp.cos(a) / mp.sin(a) ** 2 - b * mp.cos(a)
        return [p / factor, u / (factor * mp.sin(a)), mp.sin(a) - u * du / factor]

    def energy(x: State) -> mpf:
        return gamma_of(x[0], x[2])[0] + mp.cos(x[0])

    a = mp.acos(q[2])
    x = [a, mpf(0), gamma * (-v[2] / mp.sin(a))]
    states = checked("relativistic_particle", field, energy, x, times)
    for t, state in zip(times, states, strict=True):
        (a, f, _), (da, df, _) = state, field(state)
        sa, ca, sf, cf = mp.sin(a), mp.cos(a), mp.sin(f), mp.cos(f)
        v = (ca * cf * da - sa * sf * df, ca * sf * da + sa * cf * df, -sa * da)
        show("relativistic_particle", mp.nstr(t, 3), {"q": (sa * cf, sa * sf, ca), "v": v})


def circular_track(times: Sequence[int] = (2, 5)) -> None:
    """Angle t^2 from the y-axis, clockwise."""
    for t in map(mpf, times):
        x, y = mp.sin(t**2), mp.cos(t**2)
        show("circular_track", t, {"q": (x, y), "v": (2 * t * y, -2 * t * x), "lam": [4 * t**2]})


def knife_edge(times: Sequence[int] = (1, 5)) -> None:
    """Heading w t, w = 3/2, on a plane with gravity a = 1 down the slope."""
    w = mpf(3) / 2
    for t in times:
        s, c = mp.sin(w * t), mp.cos(w * t)
        x, y = s**2 / (2 * w**2), (w * t - s * c) / (2 * w**2)
        v = (s * c / w, s**2 / w, w)
        show("knife_edge", t, {"q": (x, y, w * t), "v": v, "lam": [2 * s]})


def rolling_disk(times: Sequence[mpf] = (mpf(1), mpf(5))) -> None:
    """(m r^2 + I) b'' = -m a r cos f and J f'' = k sin f: rolling angle b, heading f."""
    m, r, a, k = mpf(1), mpf(1), mpf(1) / 2, mpf(1) / 3
    spin, turn = m * r**2 / 2, m * r**2 / 4

    def field(x: State) -> State:
        f, db, df = x[3:]
        slope = -m * a * r * mp.cos(f) / (m * r**2 + spin)
        return [r * mp.cos(f) * db, r * mp.sin(f) * db, db, df, slope, k * mp.sin(f) / turn]

    def energy(x: State) -> mpf:
        rolling = (m * r**2 + spin) * x[4] ** 2 / 2 + turn * x[5] ** 2 / 2
        return rolling + m * a * x[0] + k * mp.cos(x[3])

    x = [mpf(0)] * 4 + [mpf(1), mpf(1) / 2]
    states = checked("rolling_disk", field, energy, x, times)
    for t, state in zip(times, states, strict=True):
        rates = field(state)
        *q, db, df = state
        (vx, vy, *_, ddb, _), f = rates, q[3]
        along = m * (r * mp.cos(f) * ddb - r * mp.sin(f) * db * df + a)
        across = m * (r * mp.sin(f) * ddb + r * mp.cos(f) * db * df)
        values = {"q": q, "v": (vx, vy, db, df), "lam": [-along, -across]}
        show("rolling_disk", mp.nstr(t, 3), values)


def chaplygin_sleigh(times: Sequence[int] = (5, 10)) -> None:
    """Speed u = A tanh s and rate A sech(s) / k, s = s0 + a A t / k^2, k^2 = a^2 + J / m."""
    a, inertia, speed, rate = mpf(1), mpf("0.44"), mpf("-0.8"), mpf("0.5")
    k = mp.sqrt(a**2 + inertia)
    top = mp.sqrt(speed**2 + (k * rate) ** 2)
    first, pace = mp.atanh(speed / top), a * top / k**2

    def angle(t: mpf) -> mpf:
        half = (mp.tanh(s / 2) for s in (first + pace * t, first))
        end, begin = (2 * mp.atan(x) for x in half)
        return k / a * (end - begin)

    def along(t: mpf) -> mpf:
        return top * mp.tanh(first + pace * t)

    def path(t: mpf, pieces: int) -> mp.mpc:
        return mp.quad(lambda s: along(s) * mp.expj(angle(s)), mp.linspace(0, t, pieces + 1))

    for t in map(mpf, times):
        f, w = angle(t), top / k * mp.sech(first + pace * t)
        place, velocity = path(t, 7), along(t) * mp.expj(f)
        apart = abs(path(t, 11) - place)
        print(f"chaplygin_sleigh: another partition differs by {mp.nstr(apart, 2)}")
        # across the blade: m (u w + a w') with w' = -(a / k^2) u w
        values = {
            "q": (place.real, place.imag, f),
            "v": (velocity.real, velocity.imag, w),
            "lam": [-(1 - (a / k) ** 2) * along(t) * w],
        }
        show("chaplygin_sleigh", mp.nstr(t, 3), values)


def rolling_ball(times: Sequence[mpf] = (mpf(5), mpf(10))) -> None:
    """Circle at J / (J + m r^2) of the turntable's rate; 2 p' = w p for the attitude p."""
    m, inertia, r, table = mpf(1), mpf("0.1"), mpf("0.5"), mpf(2)
    place, velocity, spin = mp.mpc("0.5", 0), mp.mpc("0.3", "0.5"), mpf(1)
    rate = table * inertia / (inertia + m * r**2)
    centre = place - velocity / (1j * rate)

    def motion(t: mpf) -> tuple[mp.mpc, mp.mpc]:
        turn = mp.expj(rate * t)
        return centre + turn * (place - centre), turn * velocity

    def field(x: State) -> State:
        t, p0, p1, p2, p3 = x
        z, v = motion(t)
        # the ball's lowest point moves with the table
        across = (table * z + 1j * v) / r
        wx, wy, wz = across.real, across.imag, spin
        rates = (
            -wx * p1 - wy * p2 - wz * p3,
            wx * p0 + wy * p3 - wz * p2,
            wy * p0 + wz * p1 - wx * p3,
            wz * p0 + wx * p2 - wy * p1,
        )
        return [mpf(1), *(x / 2 for x in rates)]

    def length(x: State) -> mpf:
        return sum((p**2 for p in x[1:]), mpf(0))

    x = [mpf(0), mpf(1), mpf(0), mpf(0), mpf(0)]
    states = checked("rolling_ball", field, length, x, times)
    for t, state in zip(times, states, strict=True):
        z, v = motion(t)
        q = (z.real, z.imag, *state[1:])
        show("rolling_ball", mp.nstr(t, 3), {"q": q, "v": (v.real, v.imag, *field(state)[1:])})


def until(f: Field, x: State, guess: mpf) -> tuple[mpf, State]:
    """Return the time near a guess at which the first entry of x' = f(x) is zero, and x there."""

    def at(t: mpf) -> State:
        return extrapolate(f, x, [t], mpf(10) ** -34)[0]

    t = guess
    for _ in range(8):
        now = at(t)
        t -= now[0] / f(now)[0]
    return t, at(t)


def belt(times: Sequence[mpf] = (mpf(5), mpf(10))) -> None:
    """Along with the belt from x = 0, then a cosine until the block is as fast as the belt."""
    w, speed, mu, static = mpf(5), mpf("0.5"), mpf("0.2"), mpf("0.3")
    middle, d = mu * G / w**2, (static - mu) * G / w**2
    first = static * G / w**2 / speed
    slips = 2 * (mp.pi - mp.atan(d * w / speed)) / w
    for t in times:
        into = (t - first) % (2 * d / speed + slips) if t > first else t - first
        if 0 <= into < slips:
            c, s = mp.cos(w * into), mp.sin(w * into)
            x, v = middle + d * c + speed / w * s, speed * c - d * w * s
        else:
            x, v = middle + d + speed * (into if into < 0 else into - slips - 2 * d / speed), speed
        show("belt", mp.nstr(t, 3), {"q": (x, 0), "v": (v, 0)})


def ladder(times: Sequence[mpf] = (mpf("0.4"), mpf("0.6"))) -> None:
    """Angle a to the wall: a'' = 3 g / 2 sin a on it; beside it the centre's x goes on."""
    first = mpf("0.3")
    leaves = mp.acos(2 * mp.cos(first) / 3)

    def on(x: State) -> State:
        return [x[1], 3 * G / 2 * mp.sin(x[0] + leaves)]

    def beside(x: State) -> State:
        a, rate = x
        s, c = mp.sin(a), mp.cos(a)
        return [rate, (6 * G * s - 3 * s * c * rate**2) / (1 + 3 * s**2)]

    def energy(x: State) -> mpf:
        return (1 + 3 * mp.sin(x[0]) ** 2) * x[1] ** 2 / 24 + G * mp.cos(x[0]) / 2

    left, (_, rate) = until(on, [first - leaves, mpf(0)], mpf("0.65"))
    speed = mp.cos(leaves) / 2 * rate
    print(f"ladder: leaves the wall at t = {mp.nstr(left, 20)}")
    for t in times:
        if t < left:
            a, w = extrapolate(on, [first - leaves, mpf(0)], [t], mpf(10) ** -34)[0]
            a, x, dx = a + leaves, mp.sin(a + leaves) / 2, mp.cos(a + leaves) / 2 * w
        else:
            ((a, w),) = checked("ladder", beside, energy, [leaves, rate], [t - left])
            x, dx = mp.sin(leaves) / 2 + speed * (t - left), speed
        q, v = (x, mp.cos(a) / 2, a), (dx, -mp.sin(a) / 2 * w, w)
        show("ladder", mp.nstr(t, 3), {"q": q, "v": v})


def rocking_block(times: Sequence[mpf] = (mpf(2), mpf(4))) -> None:
    """Tilt f from a corner: f'' = -3 g / (4 R) sin(alpha - f), the rate cut where f = 0."""
    b, h = mpf("0.5"), mpf(2)
    size, alpha = mp.sqrt(b**2 + h**2), mp.atan(b / h)
    kept = 1 - 3 * mp.sin(alpha) ** 2 / 2

    def field(x: State) -> State:
        return [x[1], -3 * G / (4 * size) * mp.sin(alpha - x[0])]

    def energy(x: State) -> mpf:
        return 2 * size * x[1] ** 2 / 3 + G * mp.cos(alpha - x[0])

    t, x, side, p = mpf(0), [mpf("0.1"), mpf(0)], -1, mp.sqrt(3 * G / (4 * size))
    for end in times:
        while True:
            # the time of the linear equation f'' = p^2 (f - alpha) is the guess
            u, rate = x[0] - alpha, x[1] / p
            root = mp.sqrt(alpha**2 - u**2 + rate**2)
            landing, there = until(field, x, mp.log((alpha + root) / -(u + rate)) / p)
            if t + landing > end:
                break
            t, x, side = t + landing, [mpf(0), -kept * there[1]], -side
            print(f"rocking_block: lands at t = {mp.nstr(t, 20)}")
        ((f, rate),) = checked("rocking_block", field, energy, x, [end - t])
        a, w = side * f, side * rate
        c, s, pivot = mp.cos(a), mp.sin(a), mpf(0) if side < 0 else -2 * b
        q = (pivot + side * c * b - s * h, side * s * b + c * h, a)
        v = ((-side * s * b - c * h) * w, (side * c * b - s * h) * w, w)
        show("rocking_block", mp.nstr(end, 3), {"q": q, "v": v})


if __name__ == "__main__":
    pendulum()
    slider_crank()
    hinged_fourbar()
    bricard()
    relativistic_particle()
    circular_track()
    knife_edge()
    rolling_disk()
    chaplygin_sleigh()
    rolling_ball()
    chain()
    belt()
    ladder()
    rocking_block()
