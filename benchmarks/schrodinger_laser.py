"""Work against error on grids: split operators, Magnus methods, and splittings into shears.

A product is a pair of complex FFTs, or two real products with H. The molecule HF in a laser, smooth
and of low energy, by steps of the split operator and of the Magnus method of order 4, whose
exponentials are splittings into shears, against a run of 2000 steps of RKN6s11. The packet in the
well of Pöschl and Teller, spread over its lowest twelve states, for theta = beta t = 100 and 1000,
by split operators, by the ladder and by Lanczos' method, against eigenvalues and -vectors: on the
library's grid, whose largest kinetic energy is nine times the depth of the well, and on a coarser
one that has the energies right to 1e-5. Errors are those of the state at the end, in its norm.

Run as ``python benchmarks/schrodinger_laser.py``; takes some seconds.
"""

import numpy as np
from report import publish, show

import liouville as lv
from liouville.problems import poschl_teller as well
from liouville.problems import walker_preston as molecule

SCHEMES = {"S2": 1, "BM4": 6, "RKN4s6": 6, "BM6": 10, "RKN6s11": 11}  # pairs of FFTs a step
PRODUCTS = (12, 25, 50, 100, 200, 400, 800, 1600, 3200, 6400)
MAGNUS = (40, 80, 160, 320, 640, 1280)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
REFERENCE = 2000
LEVELS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
THETAS = (100.0, 1000.0)
GRIDS = ((10.0, 320), (6.0, 96))


def run(system, method, span, psi, **how):
    """Return products and the end of a run; none where it fails."""
    try:
        found = lv.integrate(system, method, t=(0.0, span), psi=psi, **how)
    except (ValueError, lv.IntegrationError):
        return np.nan, np.full(psi.size, np.nan)
    return found.stats["products"], found.psi[-1]


def splits(system, span, psi):
    """Yield the name, products and end of each split operator's run."""
    for scheme, pairs in SCHEMES.items():
        for products in PRODUCTS:
            steps = max(1, round(products / pairs))
            method = lv.SplitOperator(scheme)
            yield scheme, *run(system, method, span, psi, steps=steps, every=steps)


def laser():
    """Return runs of the molecule by method: products and errors."""
    psi, span = molecule.start["psi"], molecule.interval[1]
    method = lv.SplitOperator("RKN6s11")
    end = run(molecule.system, method, span, psi, steps=REFERENCE, every=REFERENCE)[1]
    for place, value in molecule.reference[span]["psi"].items():
        if abs(end[place] - value) > 1e-11:
            raise AssertionError("the reference is not that of the problem")
    found = list(splits(molecule.system, span, psi))
    for steps in MAGNUS:
        how = {"steps": steps, "every": steps}
        found.append(("Magnus", *run(molecule.system, lv.Magnus(tol=1e-10), span, psi, **how)))
    return [(name, products, distance(psi, end)) for name, products, psi in found]


def packet(half, points):
    """Return the well on a grid, its energies, and its lowest states as columns."""
    system = lv.Schrodinger(lv.Grid(-half, half, points, potential=well.potential))
    matrix = np.array([system.hamiltonian.multiply(e) for e in np.eye(points)])
    energies, states = np.linalg.eigh((matrix + matrix.T) / 2)
    energies, states = energies[: well.STATES], states[:, : well.STATES]
    wrong = np.abs(energies - [well.energy(n) for n in range(well.STATES)]).max()
    print(f"{points} points to {half}: energies are off by {wrong:.1e}")
    return system, energies, states * np.sign(states[3 * points // 4])


def deep(theta, half, points):
    """Return runs of the packet in the well by method: products and errors."""
    system, energies, states = packet(half, points)
    low, high = system.bounds
    span = 2 * theta / (high - low)
    psi = states.sum(axis=1) / np.sqrt(well.STATES) + 0j
    end = states @ np.exp(-1j * energies * span) / np.sqrt(well.STATES)
    found = list(splits(system, span, psi))
    for tol in TOLERANCES:
        ladder = lv.SchrodingerSplitting(tol, mode="fast")
        found.append(("ladder", *run(system, ladder, span, psi)))
        found.append(("Lanczos", *run(system, lv.Lanczos(tol), span, psi)))
    return [(name, products, distance(psi, end)) for name, products, psi in found]


def distance(psi, end):
    """Return how far two states are apart."""
    return float(np.linalg.norm(psi - end))


def least(runs, name, error):
    """Return the fewest products of a method with such an error, between two runs by powers."""
    points = sorted((n, e) for code, n, e in runs if code == name and np.isfinite(e))
    best = []
    for n, e in points:
        if not best or e < best[-1][1]:
            best.append((n, max(e, 1e-16)))
    if not best or error < best[-1][1]:
        return np.nan
    products, errors = np.log(np.array(best)[::-1].T)
    return float(np.exp(np.interp(np.log(error), errors, products)))


def main():
    problems = {"molecule in a laser": laser()}
    for half, points in GRIDS:
        for theta in THETAS:
            problems[f"well, {points} points, Θ = {theta:g}"] = deep(theta, half, points)
    runs = [
        {"problem": problem, "method": name, "products": products, "error": error}
        for problem, found in problems.items()
        for name, products, error in found
    ]
    show(runs)
    names = (*SCHEMES, "Magnus", "ladder", "Lanczos")
    rows = [
        {"problem": problem, "error": error} | {name: least(found, name, error) for name in names}
        for problem, found in problems.items()
        for error in LEVELS
    ]
    print("\nProducts for an error, between runs by powers:\n")
    publish("schrodinger_laser", rows)


if __name__ == "__main__":
    main()
