"""Trajectories per second of many spherical pendulums: alone, in lanes, and in other codes.

The members start with the problem's position and velocities around its own, and swing until t = 5.
Errors are the largest of positions at the end over a sample of members, against Spark(6). The
library takes equal steps, constraints to roundoff; "one by one" is the core's time for single runs
of a sample, "calls" what calling `integrate` for each takes. heyoka advances as many members as a
register holds, each with its own steps, and diffrax all at once under vmap, both on the
index-reduced equations and on one thread. Setting up, XLA's compiler included, is left out.

Run as ``python benchmarks/ensembles.py``, after ``pip install --group bench``; ``--members``
says how many, 100 000 by default.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"

import argparse
import time
from functools import partial
from importlib import import_module

import numpy as np
from peers import reduced
from report import publish

import liouville as lv
from liouville.problems import spherical_pendulum as problem

OWN = ((2, 0.05), (4, 0.1))  # stages and step
TOLERANCES = (1e-4, 1e-8, 1e-13)
SAMPLE, REPEATS = 200, 3


def members(count):
    """Return positions and velocities, (count, 3) each, tangent to the sphere."""
    q = np.tile(problem.start["q"], (count, 1))
    v = np.tile(problem.start["v"], (count, 1))
    v += 0.2 * np.random.default_rng(1).normal(size=v.shape)
    return q, v - (q * v).sum(1, keepdims=True) * q


def alone(method, h, q, v):
    """Run a sample one by one; return seconds of the core, of the calls, and the ends."""
    inside, ends, begin = 0.0, [], time.perf_counter()
    for q0, v0 in zip(q[:SAMPLE], v[:SAMPLE], strict=True):
        found = lv.integrate(
            problem.system, method, t=problem.interval, h=h, every=10**9, q=q0, v=v0
        )
        inside += found.stats["seconds"]
        ends.append(found.q[-1])
    return inside, time.perf_counter() - begin, np.array(ends)


def together(method, h, q, v, threads):
    """Run all members at once; return seconds and the ends."""
    begin = time.perf_counter()
    found = lv.ensemble(
        problem.system, method, t=problem.interval, h=h, every=10**9, q=q, v=v, threads=threads
    )
    return time.perf_counter() - begin, found.q[-1]


def here(q, v):
    """Yield code, setting, members, and what runs them, of the library."""
    for s, h in OWN:
        method, setting, few = lv.Spark(s), f"h = {h}", min(SAMPLE, len(q))

        def one(method=method, h=h, which=0):
            found = alone(method, h, q, v)
            return found[which], found[2]

        yield f"Spark({s}), one by one", setting, few, one
        yield f"Spark({s}), calls", setting, few, partial(one, which=1)
        for threads in range(1, (os.cpu_count() or 1) + 1):
            name = f"Spark({s}), lanes, threads: {threads}"
            yield name, setting, len(q), partial(together, method, h, q, v, threads)


def elsewhere(q, v):
    """Yield the same of heyoka and diffrax, where they are installed."""
    equation = reduced.reduced(problem.system, problem.start)
    states = np.hstack([q, v])
    for name, kind in (("taylor", "HeyokaBatch"), ("compiled", "DiffraxBatch")):
        try:
            code = getattr(import_module(f"peers.{name}"), kind)
        except ImportError as trouble:
            print(f"{name} is left out: {trouble}")
            continue
        solver = code(equation, problem.interval, TOLERANCES)
        for tol in TOLERANCES:
            yield solver.name, f"tol = {tol:g}", len(q), partial(solver.run, states, tol)


def main():
    """Publish the table."""
    parser = argparse.ArgumentParser(description="trajectories per second of an ensemble")
    parser.add_argument("--members", type=int, default=100_000)
    q, v = members(parser.parse_args().members)
    _, _, exact = alone(lv.Spark(6), 0.02, q, v)
    codes = [*here(q, v), *elsewhere(q, v)]
    seconds, errors = np.full(len(codes), np.inf), [0.0] * len(codes)
    for _ in range(REPEATS):
        for k, (*_, run) in enumerate(codes):
            took, ends = run()
            seconds[k] = min(seconds[k], took)
            sample = np.asarray(ends)[: len(exact), :3]
            errors[k] = float(np.abs(sample - exact).max())
    rates = np.array([count for _, _, count, _ in codes]) / seconds
    rows = [
        {
            "code": name,
            "setting": setting,
            "members": count,
            "trajectories a second": float(rate),
            "over one by one": float(rate / rates[0]),
            "error": error,
        }
        for (name, setting, count, _), rate, error in zip(codes, rates, errors, strict=True)
    ]
    publish("ensembles", rows, ("heyoka", "diffrax", "jax"))


if __name__ == "__main__":
    main()
