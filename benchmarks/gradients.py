"""What derivatives cost: seconds of the processor over those of the run alone.

A gradient is that of a number at the end, by all of the start and the parameters, with the run that
it belongs to. Tangents are one direction, and ten side by side. Memory is the peak of a process of
its own. Run as ``python benchmarks/gradients.py``; takes two minutes, and four more with
``--memory``, which takes a million steps of Andrews' mechanism.

With ``--peers`` it is nothing but milliseconds, beside diffrax, alone and with 256 members under
``vmap``, IDAS through CasADi, and JAX for pulses, at equal accuracy of the gradient: each code with
many settings, in turn, of which the fastest counts that has reached the error. Takes six minutes,
of which compilers have most.
"""

import argparse
import resource
import time
from functools import partial

import casadi as ca
import numpy as np
import scipy.sparse as sp
from report import publish, show

import liouville as lv
from liouville.problems import chain, load

REPEATS = 5
LINKS = (100, 1000)


def cases():
    """Yield a name, system, start, interval, steps and stages."""
    pendulum, andrews = load("pendulum"), load("andrews")
    yield "pendulum", pendulum.system, pendulum.start, (0.0, 50.0), 2500, 4
    yield "pendulum", pendulum.system, pendulum.start, (0.0, 400.0), 20_000, 2
    yield "Andrews' mechanism", andrews.system, andrews.start, (0.0, 0.03), 300, 3
    for links in LINKS:
        start, t = chain.start_for(links), (0.0, 20 / links)
        yield f"chain of {links}", chain.build(links), start, t, 100, 2


def waves():
    """Yield a name, system, method, what derivatives are by, the run, and the start."""
    length, t = 14, (0.0, 10.0)
    one = np.where(np.arange(2**length) % 2, -1.0, 1.0)
    psi = np.zeros(2**length)
    psi[int("01" * (length // 2), 2)] = 1.0
    chain, times = lv.SpinChain(length), np.linspace(*t, 1000)
    sampled = lv.Schrodinger(chain, drive=[(np.cos(2 * times) / 2, one)], times=times)
    run = {"t": t, "steps": 1000, "every": 1000, "psi": psi}
    yield "14 spins, 1000 samples", sampled, lv.Magnus(2), ["drive[0]"], run

    for modes in (50, 1000):
        waved = lv.Schrodinger(chain, drive=[(series, one)], params={"a": amplitudes(modes)})
        yield f"14 spins, {modes} modes", waved, "auto", ["params.a"], {"t": t, "psi": psi}

    sites = 1000
    tilt = np.add.outer(np.arange(sites), np.zeros(sites)).ravel() / sites
    packet = np.exp(-((np.arange(sites) - sites / 2) ** 2) / 200)
    lattice = lv.Lattice((sites, sites))
    shaken = lv.Schrodinger(
        lattice, drive=[(lambda t, params: params.a * ca.sin(t), tilt)], params={"a": 1.0}
    )
    run = {"t": (0.0, 1.0), "psi": np.outer(packet, packet).ravel()}
    yield "1000 x 1000 sites", shaken, "auto", ["psi", "params.a"], run


def amplitudes(count):
    """Return random amplitudes of as many modes, whose sum has the same size on average."""
    return np.random.default_rng(0).standard_normal(count) / np.sqrt(2 * count)


def series(t, params):
    """Return a sum of sines, which have frequencies up to 5 pi."""
    count = params.a.numel()
    return ca.dot(params.a, ca.sin(5 * np.pi * t / count * ca.DM(range(1, count + 1))))


def wave_gradient(system, method, wrt, run):
    """Run, and take the gradient of the probability to be where it began."""
    solution, pullback = lv.vjp(system, method, wrt=wrt, **run)
    first, last = solution.psi[[0, -1]]
    cotangent = np.zeros_like(solution.psi)
    cotangent[-1] = 2 * first * np.vdot(first, last)
    return pullback(psi=cotangent)


def wave_cost(name, system, method, wrt, run):
    """Return the row of a Schrödinger equation."""
    repeats = REPEATS if system.size < 10**5 else 1
    plain = seconds(partial(lv.integrate, system, method, **run), repeats)
    row = {"system": name, "products": lv.integrate(system, method, **run).stats["products"]}
    spent = seconds(partial(wave_gradient, system, method, wrt, run), repeats)
    return row | {"run, s": round(plain, 2), "gradient": round(spent / plain, 1)}


def seconds(function, repeats=REPEATS):
    """Return the least seconds of the processor of some calls."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.process_time()
        function()
        best = min(best, time.process_time() - begin)
    return best


def gradient(system, method, run, start):
    """Run, and take the gradient of the sum of coordinates at the end."""
    wrt = [*system.states, *(f"params.{name}" for name in system.params)]
    solution, pullback = lv.vjp(system, method, wrt=wrt, **run, **start)
    cotangent = np.zeros_like(solution.q)
    cotangent[-1] = 1.0
    return pullback(q=cotangent)


def cost(name, system, start, t, steps, stages):
    """Return the row of a system."""
    run = partial(lv.integrate, system, lv.Spark(stages), t=t, steps=steps, every=steps, **start)
    each = np.random.default_rng(0).standard_normal((10, len(system.coordinates)))
    times = {"t": t, "steps": steps, "every": steps}
    found = {
        "gradient": partial(gradient, system, lv.Spark(stages), times, start),
        "tangent": partial(run, tangents={"v": each[0]}),
        "ten tangents": partial(run, tangents={"v": each}),
    }
    plain = seconds(run)
    row = {"system": name, "s": stages, "µs a step": round(1e6 * plain / steps, 2)}
    return row | {what: round(seconds(call) / plain, 1) for what, call in found.items()}


def together(count=256, steps=100):
    """Return the row of an ensemble: its runs, and gradients at once and one by one with theirs."""
    problem, method = load("double_pendulum"), lv.Spark(3)
    system, run = problem.system, {"t": (0.0, steps / 100), "steps": steps, "every": steps}
    speeds = np.random.default_rng(0).standard_normal((count, len(system.coordinates))) / 3
    starts = system.consistent(q=problem.start["q"], v=speeds)

    def each():
        for k in range(count):
            gradient(system, method, run, {name: x[k] for name, x in starts.items()})

    found = {
        "runs": partial(lv.ensemble, system, method, threads=1, **run, **starts),
        "one by one": each,
        "at once": partial(gradient, system, method, run, starts),
        "at once, one thread": partial(gradient, system, method, run | {"threads": 1}, starts),
    }
    row = {"system": "double pendulum", "members": count, "steps": steps}
    return row | {what: round(1e3 * seconds(call) / count, 3) for what, call in found.items()}


def peak():
    """Return the most MiB that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def memory(steps):
    """Return seconds and MiB of a long run of Andrews' mechanism, alone and with its gradient."""
    andrews = load("andrews")
    t, method = (0.0, 1e-6 * steps), lv.Spark(3)
    run = {"t": t, "steps": steps, "every": steps}
    begin = time.process_time()
    lv.integrate(andrews.system, method, **run, **andrews.start)
    plain, before = time.process_time() - begin, peak()
    begin = time.process_time()
    gradient(andrews.system, method, run, andrews.start)
    spent = time.process_time() - begin
    row = {"steps": steps, "s": round(plain, 1), "gradient, s": round(spent, 1)}
    return row | {"MiB": round(before), "with gradient, MiB": round(peak())}


#: Settings of each code beside ours: tolerances, and the number of terms of a series.
TOLERANCES = {"diffrax": 10.0 ** -np.arange(3.0, 14), "IDAS": 10.0 ** -np.arange(4.0, 13)}
ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
TERMS = (4, 8, 12, 16)

#: More levels than this are too many for exponentials of matrices.
MATRIX = 16


def mechanisms():
    """Yield a name, a system, its start and its interval."""
    for name, t in (
        ("pendulum", (0.0, 10.0)),
        ("double_pendulum", (0.0, 5.0)),
        ("andrews", (0.0, 0.03)),
    ):
        problem = load(name)
        yield name, problem.system, problem.start, t


def beside(name, system, start, t):
    """Return the rows of a mechanism: milliseconds of each code to reach an error."""
    from peers import derivatives

    start = {key: np.array(start[key], dtype=float) for key in "qv"}
    best = derivatives.Ours(system, start, t, 7).run(4000)[1]
    again = derivatives.Ours(system, start, t, 6).run(4000)[1]
    assert error(again, best) < 1e-13, "the reference has an error"
    motion = lv.integrate(system, lv.Spark(4), t=t, steps=400, **start)
    scales = [float(np.abs(x).max()) for x in (motion.q, motion.v)]
    steps = [int(25 * 2 ** (k / 2)) for k in range(11)]
    codes = {("Spark", s): (derivatives.Ours(system, start, t, s), steps) for s in range(2, 8)}
    codes["diffrax", 0] = (
        derivatives.Diffrax(system, start, t, scales), TOLERANCES["diffrax"].tolist()
    )  # fmt: skip
    tolerances = TOLERANCES["IDAS"].tolist()
    codes["IDAS", 0] = derivatives.Idas(system, start, t, scales, tolerances), tolerances
    return [{"problem": name, **row} for row in reached(codes, best)]


def swings():
    """Yield a name, and how many damped pendulums there are."""
    yield "256 pendulums", 256


def mapped(name, count):
    """Return the rows of members under ``vmap`` in JAX: milliseconds of each code for all."""
    from peers import mapped as peers

    jnp, t = peers.jnp, (0.0, 10.0)
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 + params.g * ca.cos(q[0]),
        force=lambda t, q, v, params: -params.c * v,
        q=("angle",), params={"g": 9.81, "c": 0.1},
    )  # fmt: skip

    def rate(t, x, params):
        return jnp.stack([x[1], -params[0] * jnp.sin(x[0]) - params[1] * x[1]])

    rng = np.random.default_rng(0)
    columns = [rng.uniform(0.2, 2.0, (count, 1)), rng.uniform(-1, 1, (count, 1))]
    rows = [*columns, rng.uniform(9, 10, count), rng.uniform(0.05, 0.2, count)]
    steps = [int(40 * 2 ** (k / 2)) for k in range(8)]
    best = peers.Ours(system, rows, t, 7, [2000]).run(2000)[1]
    again = peers.Ours(system, rows, t, 6, [2000]).run(2000)[1]
    assert error(again, best) < 1e-12, "the reference has an error"
    codes = {("Spark", s): peers.Ours(system, rows, t, s, steps) for s in (3, 4, 5, 7)}
    codes = {key: (code, steps) for key, code in codes.items()}
    code = peers.Diffrax(rate, rows, t)
    codes["diffrax", 0] = code, TOLERANCES["diffrax"].tolist()
    first = {"Spark, first call": codes["Spark", 3][0].first, "diffrax, first call": code.first}
    first = {what: round(1e3 * x) for what, x in first.items()}
    return [{"problem": name, **row, **first} for row in reached(codes, best)]


def pulses():
    """Yield a name, the two parts of H, the states at both ends, a pulse and its length."""
    rng, levels = np.random.default_rng(0), 6
    lower = np.diag(np.sqrt(np.arange(1.0, levels)), 1)
    number = np.arange(levels, dtype=float)
    ladder = np.diag(-0.5 * 2.0 * number * (number - 1))
    pulse = np.sin(np.pi * np.linspace(0, 1, 400)) * (0.6 + 0.05 * rng.standard_normal(400))
    states = np.eye(levels)
    yield (
        "transmon of 6 levels, 400 slices",
        (ladder, (lower + lower.T) / 2),
        *states[:2],
        pulse,
        5.0,
    )
    exchange = np.array([[1, 0, 0, 0], [0, -1, 2, 0], [0, 2, -1, 0], [0, 0, 0, 1]]) / 4
    for spins in (8, 12):
        each = [sp.eye_array(2**k) for k in range(spins)]
        bonds = [sp.kron(sp.kron(each[k], exchange), each[-2 - k]) for k in range(spins - 1)]
        end = sp.diags_array(np.where(np.arange(2**spins) % 2, -1.0, 1.0))
        ends = [np.zeros(2**spins) for _ in range(2)]
        for state, pattern in zip(ends, ("01", "10"), strict=True):
            state[int(pattern * (spins // 2), 2)] = 1.0
        parts, pulse = (sum(bonds), end), rng.standard_normal(200)
        yield f"chain of {spins} spins, 200 slices", parts, *ends, pulse, 10.0


def pulsed(name, *case):
    """Return the rows of a pulse."""
    from peers import derivatives

    series = derivatives.JaxPulse(*case, by_matrix=False)
    best = series.run(20)[1]
    codes = {
        ("Magnus", 0): (derivatives.OurPulse(*case), [1e-4, 1e-7, 1e-10, 1e-13]),
        ("JAX, series", 0): (series, TERMS),
    }
    if case[1].size <= MATRIX:
        codes["JAX, expm", 0] = derivatives.JaxPulse(*case, by_matrix=True), [0]
    return [{"problem": name, **row} for row in reached(codes, best)]


def error(found, best):
    """Return the largest error of a gradient, relative to its largest component."""
    return float(np.abs(found - best).max() / np.abs(best).max())


def reached(codes, best, repeats=6):
    """Give for each error the least milliseconds in which each code has reached it."""
    least = {}
    for _ in range(repeats):
        for (name, form), (code, settings) in codes.items():
            for setting in settings:
                try:
                    spent, found = code.run(setting)
                except (RuntimeError, lv.IntegrationError):
                    continue
                key = name, form, setting, error(found, best)
                least[key] = min(spent, least.get(key, np.inf))
    names = list(dict.fromkeys(name for name, _ in codes))
    for wanted in ERRORS:
        row = {"error": wanted}
        for name in names:
            own = [
                1e3 * x for (which, *_, off), x in least.items() if which == name and off <= wanted
            ]
            row[name] = float(f"{min(own):.3g}") if own else None
        yield row


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--memory", type=int, nargs="?", const=10**6, help="steps of a long run")
    parser.add_argument(
        "--peers", nargs="*", help="other codes instead, on problems of these names"
    )
    chosen = parser.parse_args()
    if chosen.peers is not None:
        wanted = tuple(chosen.peers) or ""
        tables = (
            ("gradient_peers", beside, mechanisms()),
            ("gradient_mapped", mapped, swings()),
            ("gradient_pulses", pulsed, pulses()),
        )
        for table, measure, cases_of in tables:
            rows = [
                row for each in cases_of if each[0].startswith(wanted) for row in measure(*each)
            ]
            if rows:
                publish(table, rows, ("diffrax", "jax"))
        return
    publish("gradients", [cost(*case) for case in cases()])
    show([together(), together(steps=1000)])
    publish("gradients_waves", [wave_cost(*case) for case in waves()])
    if chosen.memory:
        show([memory(chosen.memory)])


if __name__ == "__main__":
    main()
