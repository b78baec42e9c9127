"""Energy and joints of a swinging chain of ten, per second of the processor, beside MuJoCo.

The chain hangs, starts in its first mode and swings until t = 10. MuJoCo has it with hinges, whose
angles are its coordinates, and with mass points on equality constraints. Energies are relative to
the kinetic energy at the start, links to their length, positions at the end to the chain's length,
against Spark(6). Times are minima of repeats taken in turn, on one thread; states are looked at a
hundred times. Run as ``python benchmarks/mujoco_chain.py``, after ``pip install --group bench``.
"""

import sys
from functools import partial

import numpy as np
from report import publish

import liouville as lv
from liouville.problems import chain

LINKS, END, RECORDS, REPEATS = 10, 10.0, 100, 5
OWN = (
    (lv.LobattoPair(2), 0.01),
    (lv.Spark(2), 0.02),
    (lv.Spark(3), 0.05),
    (lv.Spark(4), 0.05),
    (lv.Spark(5), 0.1),
)
PEERS = (
    ("DISCRETE", 1e-2),
    ("Euler", 1e-2),
    ("implicitfast", 1e-2),
    ("implicit", 1e-3),
    ("RK4", 1e-2),
    ("RK4", 1e-3),
)


def run_here(system, start, method, h):
    """Return seconds, q and v of a run with a method of the library."""
    steps = round(END / h)
    found = lv.integrate(system, method, t=(0.0, END), steps=steps, every=steps // RECORDS, **start)
    return found.stats["seconds"], found.q, found.v


def energy(q, v):
    """Return the energy of each state."""
    mass, heights = 1.0 / LINKS, q[:, 1::2]
    return mass * ((v**2).sum(1) / 2 + heights.sum(1))


def stretch(q):
    """Return the largest error of a link's length, relative."""
    ends = np.concatenate([np.zeros((len(q), 1, 2)), q.reshape(len(q), -1, 2)], axis=1)
    return float(np.abs(np.linalg.norm(np.diff(ends, axis=1), axis=2) * LINKS - 1).max())


def runs(system, start):
    """Yield each code's name, joints, step, and what runs it."""
    for method, h in OWN:
        name = f"{type(method).__name__}({method.stages})"
        yield name, "constraints", h, partial(run_here, system, start, method, h)
    try:
        from peers import robotics
    except ImportError as trouble:
        print(f"MuJoCo is left out: {trouble}", file=sys.stderr)
        return
    for joints in robotics.JOINTS:
        for integrator, h in PEERS:
            model = robotics.Chain(dict(system.params), start, joints, integrator, h)
            steps = round(END / RECORDS / h)
            yield f"MuJoCo {integrator}", joints, h, partial(model.run, RECORDS, steps)


def main():
    """Publish the table."""
    system, start = chain.build(LINKS), chain.start_for(LINKS)
    _, exact, _ = run_here(system, start, lv.Spark(6), 0.02)
    prepared = list(runs(system, start))
    seconds = np.min([[run()[0] for *_, run in prepared] for _ in range(REPEATS)], axis=0)
    rows = []
    for (name, joints, h, run), least in zip(prepared, seconds, strict=True):
        _, q, v = run()
        energies = energy(q, v)
        kinetic = (v[0] ** 2).sum() / 2 / LINKS
        rows.append(
            {
                "code": name,
                "joints": joints,
                "h": h,
                "ms": 1e3 * float(least),
                "energy off by": float(np.abs(energies - energies[0]).max() / kinetic),
                "links off by": stretch(q),
                "positions off by": float(np.abs(q[-1] - exact[-1]).max()),
            }
        )
    publish("mujoco_chain", rows, ["mujoco"])


if __name__ == "__main__":
    main()
