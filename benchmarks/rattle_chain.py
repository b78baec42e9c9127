"""Cost of a RATTLE step on chains of 10 to 10 000 bonds, beside an estimate and other codes.

Two chains: the library's polymer in space with its angles and trap, h = 0.01, and the hanging chain
in the plane, h = 0.2/N. A step's time is the difference of a long and a short run, the minimum of
repeats, in seconds of the processor.

The estimate is what a step has to move and to compute, with n coordinates, m bonds, e entries of
their gradient, k corrections of the multipliers a step, and a tape of F, G and D instructions a
bond for forces, constraints and gradient:

    numbers    (8 k + 17) n + (k + 7) e + (8 k + 24) m, each read or written once a stage
    program    16 bytes for each of the (F + k G + 2 D) m instructions that a step runs
    flops      (F + k G + 2 D) m, 2 (k + 4) e for products with the gradient and its transpose, 12 e
               for two matrices, 10 m and 8 (k + 1) m to eliminate and to solve, (8 k + 17) n for
               coordinates and momenta

over the bandwidth of STREAM's triad and the peak of a product of matrices, both of one thread and
measured in the same run. A compiled step would have no program to read.

The general Lobatto pair solves the same equations with dense matrices, up to a thousand bonds. With
OpenMM its Reference platform steps the same polymer, positions constrained to 1e-12 and to 1e-5.
Run as ``python benchmarks/rattle_chain.py``, after ``pip install --group bench``; takes some
minutes, or with ``--openmm``, for that comparison alone, seconds.
"""

import argparse
import importlib.util
import sys
import time

import numpy as np
from report import publish, show

import liouville as lv
from liouville.problems import chain, polymer

BONDS = (10, 100, 1000, 10_000)
MOST_DENSE = 1000
REPEATS = 3
TAPES = {"polymer": (33, 10, 9), "chain": (0, 7, 6)}  # instructions a bond: f, g and g_q


def triad():
    """Measure STREAM's triad of one thread, in numbers a second of the processor."""
    a, b, c = (np.full(10_000_000, 1.0) for _ in range(3))
    best = np.inf
    for _ in range(5):
        begin = time.process_time()
        np.multiply(b, 3.0, out=a)
        np.add(a, c, out=a)
        best = min(best, time.process_time() - begin)
    return 5 * a.size / best


def peak():
    """Measure a product of matrices on one thread, in flops a second of the processor."""
    size = 1000
    a, b = np.random.default_rng(1).normal(size=(2, size, size))
    best = np.inf
    for _ in range(5):
        begin = time.process_time()
        a @ b
        best = min(best, time.process_time() - begin)
    return 2 * size**3 / best


def model(kind, bonds):
    """Return a chain, its start and a step."""
    if kind == "chain":
        return chain.build(bonds), chain.start_for(bonds), 0.2 / bonds
    return polymer.build(bonds + 1), polymer.start_for(bonds + 1), 0.01


def cost(system, start, h, method, steps):
    """Return seconds and corrections of a step."""

    def run(count):
        begin = time.process_time()
        end = (0.0, count * h)
        stats = lv.integrate(
            system, method, t=end, steps=count, every=count, states=False, **start
        ).stats
        return time.process_time() - begin, stats["iterations"]

    few = 3
    short, long = (min(run(count) for _ in range(REPEATS)) for count in (few, few + steps))
    return (long[0] - short[0]) / steps, (long[1] - short[1]) / steps


def estimate(kind, n, m, k, rates):
    """Return the seconds that numbers, program and arithmetic of a step want."""
    e = (6 if kind == "polymer" else 4) * m
    force, constraint, gradient = TAPES[kind]
    program = (force + k * constraint + 2 * gradient) * m
    numbers = (8 * k + 17) * n + (k + 7) * e + (8 * k + 24) * m
    flops = program + 2 * (k + 4) * e + 12 * e
    flops += 10 * m + 8 * (k + 1) * m + (8 * k + 17) * n
    return numbers / rates[0], 2 * program / rates[0], flops / rates[1]


def scaling(rates):
    """Return a row for each chain and size."""
    rows = []
    for kind in ("polymer", "chain"):
        for bonds in BONDS:
            begin = time.process_time()
            system, start, h = model(kind, bonds)
            building = time.process_time() - begin
            steps = max(100, 200_000 // bonds)
            seconds, corrections = cost(system, start, h, lv.LobattoPair(2), steps)
            n, m = len(system.coordinates), len(system.constraints)
            numbers, program, arithmetic = estimate(kind, n, m, corrections, rates)
            row = {
                "chain": kind,
                "bonds": bonds,
                "building s": building,
                "µs a step": 1e6 * seconds,
                "corrections": corrections,
                "numbers us": 1e6 * numbers,
                "program us": 1e6 * program,
                "arithmetic us": 1e6 * arithmetic,
                "over the estimate": seconds / (numbers + program + arithmetic),
                "over a compiled one": seconds / (numbers + arithmetic),
                "general pair us": "-",
                "general over fast": "-",
            }
            if bonds <= MOST_DENSE:
                pair = lv.LobattoPair(2, solver="node-schur")
                slow, _ = cost(system, start, h, pair, max(3, 100_000 // bonds**2))
                row |= {"general pair us": 1e6 * slow, "general over fast": slow / seconds}
            rows.append(row)
    return rows


def beside_openmm():
    """Return rows of the polymer of a thousand bonds with OpenMM, and with RATTLE here."""
    from peers.molecular import INTEGRATORS, Polymer

    system, start, h = model("polymer", 1000)
    here, _ = cost(system, start, h, lv.LobattoPair(2), 500)
    end = lv.integrate(system, lv.LobattoPair(2), t=(0.0, 500 * h), steps=500, every=500, **start)
    bonds = np.linalg.norm(np.diff(end.q[-1].reshape(-1, 3), axis=0), axis=1)
    rows = [
        {
            "code": "liouville RATTLE",
            "tolerance": "roundoff",
            "µs a step": 1e6 * here,
            "bonds off by": float(np.abs(bonds - 1).max()),
            "over ours": 1.0,
        }
    ]
    for kind in INTEGRATORS:
        for tolerance in (1e-12, 1e-5):
            peer = Polymer(dict(system.params), start, h, tolerance, kind)
            peer.run(20)
            seconds = min(peer.run(160) / 160 for _ in range(REPEATS))
            row = {"code": f"OpenMM {kind}", "tolerance": tolerance, "µs a step": 1e6 * seconds}
            rows.append(row | {"bonds off by": peer.stretch(), "over ours": seconds / here})
    return rows


def main():
    """Publish both tables."""
    parser = argparse.ArgumentParser(description="the cost of RATTLE steps")
    parser.add_argument("--openmm", action="store_true", help="only the comparison with OpenMM")
    if not parser.parse_args().openmm:
        rates = triad(), peak()
        print(f"triad {8e-9 * rates[0]:.1f} GB/s, peak {1e-9 * rates[1]:.1f} Gflop/s, one thread\n")
        show(scaling(rates))
    if importlib.util.find_spec("openmm") is None:
        print("\nOpenMM is left out: it is not installed", file=sys.stderr)
        return
    print()
    publish("rattle_openmm", beside_openmm(), ["openmm"])


if __name__ == "__main__":
    main()
