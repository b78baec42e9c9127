"""Compute the references of the quantum problems: ``python tools/quantum_references.py``.

Lattices and chains of spins are propagated by the Taylor series in 70 digits, of which cancellation
leaves 40; the separable lattices axis by axis. The driven oscillator is integrated by its Taylor
series step by step in extended precision, with two steps that must agree. Half a minute.
"""

import sys
from collections.abc import Iterator
from types import ModuleType

import mpmath as mp
import numpy as np

from liouville._systems import Grid
from liouville._systems.waves.entries import Entries
from liouville.problems import heisenberg, lattice2d, lattice3d, tight_binding, walker_preston

#: The results have so many digits; terms of the series are larger than their sum by 10^30.
DIGITS = 40
mp.mp.dps = DIGITS + 30


def propagator(entries: Entries, start: list, t: float) -> list:
    """Return exp(-i t H) psi by its Taylor series."""
    places = list(zip(entries.row.tolist(), entries.col.tolist(), strict=True))
    values = [mp.mpf(x) for x in entries.values.tolist()]
    term = [mp.mpc(x) for x in start]
    psi, k = list(term), 0
    while max(map(abs, term)) > mp.mpf(10) ** -DIGITS or k < 10:
        k += 1
        product = [mp.mpc(0)] * len(term)
        for (i, j), value in zip(places, values, strict=True):
            product[i] += value * term[j]
        term = [x * mp.mpc(0, -t) / k for x in product]
        psi = [a + b for a, b in zip(psi, term, strict=True)]
    return psi


def show(name: str, amplitudes: dict) -> None:
    """Print amplitudes as they stand in the problems."""
    sys.stdout.write(f"{name}\n")
    for place, z in amplitudes.items():
        z = mp.mpc(z)
        digits = f"{mp.nstr(z.real, 20)}, {mp.nstr(z.imag, 20)}"
        sys.stdout.write(f"    {place}: complex({digits}),\n")


def few(psi: list, count: int = 6) -> dict:
    """Return the largest amplitudes of a state."""
    largest = sorted(range(len(psi)), key=lambda i: -abs(psi[i]))
    return {i: psi[i] for i in sorted(largest[:count])}


def of_lattice(problem: ModuleType, axes: int) -> Iterator[tuple[int, mp.mpc]]:
    """Return a product of states on chains."""
    chain = problem.chain(problem.SITES)
    packet = [mp.mpf(x) for x in problem.packet(problem.SITES)]
    norm = mp.sqrt(mp.fsum(x**2 for x in packet))
    start = [x / norm for x in packet]
    line = propagator(chain.entries(), start, problem.interval[1])
    middle = problem.SITES // 2
    for i in few(line, 4):
        place, value = 0, mp.mpc(1)
        for axis in range(axes):
            j = i if axis == 0 else middle
            place, value = place * problem.SITES + j, value * line[j]
        yield place, value


def taylor(grid: Grid, start: np.ndarray, span: tuple, steps: int) -> np.ndarray:
    """Integrate i psi' = (H0 + A cos(w t) x) psi with 30 terms of the series in each step."""
    wide = np.longdouble
    k = np.fft.fftfreq(grid.size, 1 / grid.size).astype(wide)
    pi = wide("3.14159265358979323846264338327950288")
    length = wide(grid.high[0]) - wide(grid.low[0])
    x = wide(grid.low[0]) + length / grid.size * np.arange(grid.size).astype(wide)
    angles = 2 * pi / grid.size * ((np.arange(grid.size)[:, None] * k[None]) % grid.size)
    waves = np.cos(angles) + 1j * np.sin(angles)
    kinetic = (2 * pi / length * k) ** 2 / (2 * wide(grid.mass[0]))
    matrix = (waves * kinetic) @ waves.conj().T / grid.size
    numbers = {name: wide(str(value)) for name, value in walker_preston.PARAMS.items()}
    morse = numbers["D"] * (1 - np.exp(-numbers["alpha"] * x)) ** 2
    matrix = matrix.real + np.diag(morse)
    psi, h = start.astype(np.clongdouble), (wide(span[1]) - wide(span[0])) / steps
    omega, order = numbers["omega"], 30
    for n in range(steps):
        t = wide(span[0]) + n * h
        cosine, factor = [], wide(1)
        for j in range(order):
            cosine.append(factor * np.cos(omega * t + j * pi / 2))
            factor = factor * omega / (j + 1)
        terms = [psi]
        for j in range(order):
            drive = sum(cosine[i] * terms[j - i] for i in range(j + 1))
            terms.append(-1j * (matrix @ terms[j] + numbers["A"] * x * drive) / (j + 1))
        psi = sum(term * h**j for j, term in enumerate(terms))
    return psi


def main() -> None:
    """Print all references."""
    chain = tight_binding.system.source.entries()
    start = list(tight_binding.start["psi"])
    show("tight_binding", few(propagator(chain, start, 10.0), 8))
    square = tight_binding.disordered.source.entries()
    start = list(tight_binding.disordered_start["psi"])
    show("tight_binding, disordered", few(propagator(square, start, 10.0)))
    spins = heisenberg.system.source
    psi = propagator(spins.entries(), list(heisenberg.start["psi"]), 5.0)
    show("heisenberg", {85: psi[spins.index(85)], 170: psi[spins.index(170)]})
    show("lattice2d", dict(of_lattice(lattice2d, 2)))
    show("lattice3d", dict(of_lattice(lattice3d, 3)))
    grid, psi = walker_preston.system.grid, walker_preston.start["psi"]
    results = [taylor(grid, psi, walker_preston.interval, steps) for steps in (1500, 2000)]
    difference = abs(results[1] - results[0]).max()
    sys.stdout.write(f"walker_preston, two steps differ by {difference:.1e}\n")
    show(
        "walker_preston",
        few([mp.mpc(mp.mpf(str(z.real)), mp.mpf(str(z.imag))) for z in results[1]]),
    )


if __name__ == "__main__":
    main()
