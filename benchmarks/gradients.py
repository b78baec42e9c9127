"""What derivatives cost: seconds of the processor over those of the run alone.

A gradient is that of a number at the end, by all of the start and the parameters, with the run that
it belongs to. Tangents are one direction, and ten side by side. Memory is the peak of a process of
its own. Run as ``python benchmarks/gradients.py``; takes two minutes, and four more with
``--memory``, which takes a million steps of Andrews' mechanism.
"""

import argparse
import resource
import time
from functools import partial

import casadi as ca
import numpy as np
from report import publish

import liouville as lv
from liouville.problems import chain, load

REPEATS = 5
LINKS = (100, 1000)


def cases():
    """Yield a name, system, start, interval, steps and stages."""
    pendulum, andrews = load("pendulum"), load("andrews")
    yield "pendulum", pendulum.system, pendulum.start, (0.0, 50.0), 2500, 4
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

    def series(t, params):
        return ca.dot(params.a, ca.sin(np.pi * t / 10 * ca.DM(range(1, 51))))

    modes = np.random.default_rng(0).standard_normal(50) / 10
    waved = lv.Schrodinger(chain, drive=[(series, one)], params={"a": modes})
    yield "14 spins, 50 modes", waved, "auto", ["params.a"], {"t": t, "psi": psi}

    sites = 1000
    tilt = np.add.outer(np.arange(sites), np.zeros(sites)).ravel() / sites
    packet = np.exp(-((np.arange(sites) - sites / 2) ** 2) / 200)
    lattice = lv.Lattice((sites, sites))
    shaken = lv.Schrodinger(
        lattice, drive=[(lambda t, params: params.a * ca.sin(t), tilt)], params={"a": 1.0}
    )
    run = {"t": (0.0, 1.0), "psi": np.outer(packet, packet).ravel()}
    yield "1000 x 1000 sites", shaken, "auto", ["psi", "params.a"], run


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
    row = {"system": name, "s": stages, "us a step": round(1e6 * plain / steps, 2)}
    return row | {what: round(seconds(call) / plain, 1) for what, call in found.items()}


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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--memory", type=int, nargs="?", const=10**6, help="steps of a long run")
    chosen = parser.parse_args()
    publish("gradients", [cost(*case) for case in cases()])
    publish("gradients_waves", [wave_cost(*case) for case in waves()])
    if chosen.memory:
        publish("gradients_memory", [memory(chosen.memory)])


if __name__ == "__main__":
    main()
