"""Cost of a step and memory of HHT from 1e3 to 1e5 unknowns: a chain and a beam.

The chain has point masses on rigid links, a third of its unknowns multipliers; the beam is a
strip of plane-stress elements, four high, clamped on the left, supported on the right by a
constraint, under a load that comes suddenly. A step's time is the difference of a long and a short
run, minimum of repeats; steps are equal, so the beam's take no factorisation and the chain's take
few. What starts a run, the ordering and the first factorisation above all, has a column of its own.
Each size runs in a process of its own; memory is that process's peak less what the imports took,
building the system included. Run as ``python benchmarks/sparse_scaling.py``; takes some minutes.
"""

import json
import resource
import subprocess
import sys
import time

import numpy as np
import scipy.sparse as sp
from report import publish, show

import liouville as lv
from liouville import problems

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
SHORT, REPEATS = 5, 3
MORE = 4_000_000  # steps times unknowns in the long run, but at least 40 steps
HIGH = 4
POWERS_OF = ("ms a step", "µs a correction and unknown", "ms to start", "MiB")


def chain(unknowns):
    """Return a chain with its start and a step that follows its links."""
    links = round(unknowns / 3)
    problem = problems.load("chain")
    return problem.build(links), problem.start_for(links), 0.2 / links


def beam(unknowns):
    """Return a strip of square elements of side 1 with E = rho = 1, its start and a step."""
    long = round(unknowns / (2 * (HIGH + 1)))
    stiffness, mass = element()
    nodes = np.arange((long + 1) * (HIGH + 1)).reshape(long + 1, HIGH + 1)
    corners = [nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]]
    dofs = (2 * np.stack([c.ravel() for c in corners], 1)[:, :, None] + [0, 1]).reshape(-1, 8)
    rows, cols = (np.broadcast_to(x, (len(dofs), 8, 8)) for x in (dofs[:, :, None], dofs[:, None]))
    every, clamped = 2 * nodes.size, 2 * (HIGH + 1)
    n = every - clamped

    def assembled(block):
        values = np.broadcast_to(block, rows.shape).ravel()
        whole = sp.coo_array((values, (rows.ravel(), cols.ravel())), shape=(every, every)).tocsr()
        return whole[clamped:, clamped:]

    load = np.zeros(n)
    load[n // 2 // 10 * 10 + 1] = 1e-3
    support = n - (HIGH // 2 + 1) * 2 + 1
    system = lv.Structure(
        assembled(mass),
        assembled(stiffness),
        force=load,
        constraint=lambda t, q, params: q[support],
    )
    return system, {"q": np.zeros(n), "v": np.zeros(n)}, 0.5


def element(poisson=0.3):
    """Return stiffness and mass of the bilinear square of side 1, from 2 by 2 Gauss points."""
    elastic = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    elastic /= 1 - poisson**2
    stiffness, mass = np.zeros((8, 8)), np.zeros((8, 8))
    points = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
    for x in points:
        for y in points:
            shape = np.array([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y])
            by_x = np.array([y - 1, 1 - y, y, -y])
            by_y = np.array([x - 1, -x, x, 1 - x])
            strain = np.zeros((3, 8))
            strain[0, ::2] = strain[2, 1::2] = by_x
            strain[1, 1::2] = strain[2, ::2] = by_y
            move = np.zeros((2, 8))
            move[0, ::2] = move[1, 1::2] = shape
            stiffness += strain.T @ elastic @ strain / 4
            mass += move.T @ move / 4
    return stiffness, mass


def peak():
    """Peak memory of this process so far, in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def one(kind, unknowns):
    """Return the row of one size; runs in its own process."""
    imports = peak()
    begin = time.perf_counter()
    system, start, h = {"chain": chain, "beam": beam}[kind](unknowns)
    building = time.perf_counter() - begin

    def run(steps):
        return lv.integrate(
            system, lv.HHT(-0.1), t=(0.0, steps * h), steps=steps, every=steps, **start
        ).stats

    more = max(40, MORE // unknowns)
    pairs = [(run(SHORT), run(SHORT + more)) for _ in range(REPEATS)]
    short, long = (min((pair[k] for pair in pairs), key=lambda s: s["seconds"]) for k in (0, 1))
    n, m = len(system.coordinates), len(system.constraints)
    seconds, corrections = ((long[key] - short[key]) / more for key in ("seconds", "iterations"))
    return {
        "model": kind,
        "n": n,
        "m": m,
        "ms a step": 1e3 * seconds,
        "µs a step and unknown": 1e6 * seconds / (n + m),
        "corrections a step": round(corrections, 2),
        "µs a correction and unknown": 1e6 * seconds / corrections / (n + m),
        "ms to start": 1e3 * (short["seconds"] - SHORT * seconds),
        "building s": round(building, 2),
        "MiB": peak() - imports,
        "KiB an unknown": 1024 * (peak() - imports) / (n + m),
    }


def exponent(rows, key):
    """Fit the power of the number of unknowns that a quantity grows with."""
    sizes = np.log([row["n"] + row["m"] for row in rows])
    return float(np.polyfit(sizes, np.log([row[key] for row in rows]), 1)[0])


def main():
    if len(sys.argv) == 3:
        print(json.dumps(one(sys.argv[1], int(sys.argv[2]))))
        return
    rows, powers = [], []
    for kind in ("chain", "beam"):
        own = []
        for size in SIZES:
            command = [sys.executable, __file__, kind, str(size)]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            own.append(json.loads(done.stdout))
        powers.append({"model": kind, **{key: round(exponent(own, key), 3) for key in POWERS_OF}})
        rows += own
    columns = ("model", "n", "m", "ms a step", "µs a step and unknown", "ms to start")
    publish("sparse_scaling", rows, columns=(*columns, "building s", "MiB"))
    print()
    show(powers)


if __name__ == "__main__":
    main()
