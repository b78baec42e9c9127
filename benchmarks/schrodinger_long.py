"""A million steps of a wave function: which methods keep its norm and energy.

A chain of 24 sites with disorder and a random complex start; a step goes theta = beta h far, with
an error of at most 1e-7. The stable splitting keeps a quadratic form close to the norm; the series
and the Krylov spaces start anew at every step. Errors are relative to the start, the largest of the
first tenth and of the whole run; the power says how that of the norm grows with time, 1 is a drift.
The last column is the distance from the start of 10^4 steps forwards and as many backwards.

Run as ``python benchmarks/schrodinger_long.py``; takes a minute.
"""

from dataclasses import replace

import numpy as np
from report import publish, show

import liouville as lv

SITES, STEPS, RECORDS, BACK, TOL = 24, 1_000_000, 1000, 10_000, 1e-7
DRAWN = 30  # records of a run that are written down
RUNS = (
    ("stable splitting", 3.0, lv.SchrodingerSplitting(TOL, "stable")),
    ("stable splitting", 18.0, lv.SchrodingerSplitting(TOL, "stable")),
    ("Chebyshev series", 3.0, lv.Chebyshev(TOL)),
    ("Chebyshev series", 18.0, lv.Chebyshev(TOL)),
    ("Lanczos, dimension 12", 3.0, lv.Lanczos(TOL, 12)),
)


def chain():
    """Return the system and its start."""
    random = np.random.default_rng(0)
    system = lv.Schrodinger(lv.Lattice(SITES, potential=random.normal(size=SITES)))
    psi = random.normal(size=2 * SITES).view(complex)
    return system, psi / np.linalg.norm(psi)


def repeated(plan, step, steps, records):
    """Return a plan of many such steps, whose norm may be off, and the times of its records."""
    t = step * (steps // records) * np.arange(records + 1.0)
    guard = 3 if plan.core[0] in ("shears", "chebyshev", "lanczos") else None
    core = tuple(1.0 if place == guard else part for place, part in enumerate(plan.core))
    stops = tuple((end, steps // records) for end in t[1:].tolist())
    return replace(plan, t0=0.0, stops=stops, core=core), t


def measure(system, psi, name, theta, method):
    """Return a row, and the records of the run."""
    low, high = system.bounds
    step = 2 * theta / (high - low)
    single = lv.plan(system, method, t=(0.0, step))
    plan, t = repeated(single, step, STEPS, RECORDS)
    found = lv.integrate(system, plan, t=t, psi=psi, states=False)
    norm = found.invariant_drift("norm")
    energy = np.abs(found.invariants["energy"] - found.invariants["energy"][0]) / (high - low)
    slope = np.polyfit(np.log(t[RECORDS // 10 :]), np.log(norm[RECORDS // 10 :]), 1)[0]
    there, t = repeated(single, step, BACK, 1)
    away = lv.integrate(system, there, t=t, psi=psi).psi[-1]
    back = replace(there, t0=t[1], stops=((0.0, BACK),))
    again = lv.integrate(system, back, t=t[::-1], psi=away).psi[-1]
    row = {
        "method": name,
        "θ": theta,
        "products a step": found.stats["products"] / STEPS,
        "norm, first tenth": float(norm[: RECORDS // 10 + 1].max()),
        "norm": float(norm.max()),
        "power": float(slope),
        "energy, first tenth": float(energy[: RECORDS // 10 + 1].max()),
        "energy": float(energy.max()),
        "there and back": float(np.linalg.norm(again - psi)),
    }
    places = np.unique(np.geomspace(1, RECORDS, DRAWN).astype(int))
    steps = places * (STEPS // RECORDS)
    drawn = [
        {"method": name, "θ": theta, "step": int(k), "norm": float(a), "energy": float(b)}
        for k, a, b in zip(steps, norm[places], energy[places], strict=True)
    ]
    return row, drawn


def main():
    system, psi = chain()
    found = [measure(system, psi, *run) for run in RUNS]
    show([record for _, drawn in found for record in drawn])
    print("\nA million steps:\n")
    publish("schrodinger_long", [row for row, _ in found])


if __name__ == "__main__":
    main()
