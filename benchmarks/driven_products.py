"""Products of driven wave functions at equal error: series in time, Magnus and SciPy's DOP853.

The last columns are those of an H(t) that is known by its products alone: all calls of a function,
those that plan among them.

For each problem the library runs at four tolerances, DOP853 at twenty-one; of DOP853 the run with
the fewest products that is no further off counts, with H as it is or with the middle of its
spectrum taken away. One evaluation is one product. The Magnus methods have the orders that "auto"
takes for many drives.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp
from report import publish
from scipy.integrate import solve_ivp

import liouville as lv
from liouville._methods.planner.waves.driven import OF_PRODUCTS, SCHEMES
from liouville.problems import walker_preston

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)


def spins(length, site, axis):
    """Return a spin operator of one site."""
    single = {
        "x": [[0, 0.5], [0.5, 0]], "y": [[0, -0.5j], [0.5j, 0]], "z": [[0.5, 0], [0, -0.5]],
    }[axis]  # fmt: skip
    parts = [sp.identity(2**site), sp.csr_array(single), sp.identity(2 ** (length - site - 1))]
    return sp.csr_array(sp.kron(sp.kron(parts[0], parts[1]), parts[2]))


def heisenberg(length):
    """Return the matrix of Heisenberg's open chain."""
    total = sp.csr_array((2**length, 2**length), dtype=complex)
    for i in range(length - 1):
        for axis in "xyz":
            total = total + spins(length, i, axis) @ spins(length, i + 1, axis)
    return sp.csr_array(total.real)


def neel(length):
    """Return the state up, down, up and so on, with a little of all others."""
    psi = np.random.default_rng(0).normal(size=2**length) * 0.02 + 0j
    psi[int("01" * (length // 2), 2)] += 1.0
    return psi / np.linalg.norm(psi)


def chain(length=10):
    """Heisenberg's chain with a field along z on one end that oscillates."""
    h0, h1 = heisenberg(length), spins(length, 0, "z").real
    drive = [(lambda t, _: 0.5 * ca.cos(2 * t), h1)]
    return h0, [(lambda t: 0.5 * np.cos(2 * t), h1)], drive, (0.0, 10.0), neel(length)


def landau_zener():
    """Two levels that cross."""
    h0, h1 = np.array([[0.0, 0.5], [0.5, 0.0]]), np.diag([0.5, -0.5])
    psi = np.array([1.0, 0.0j])
    drive = [(lambda t, _: 2 * t, h1)]
    return h0, [(lambda t: 2 * t, h1)], drive, (-5.0, 5.0), psi


def circular(length=8):
    """Heisenberg's chain in a field that turns: complex, and real by no gauge."""
    h0 = heisenberg(length)
    x = sum(spins(length, i, "x").real for i in range(length))
    y = sum((1 + i / 4) * spins(length, i, "y") for i in range(length))
    drive = [(lambda t, _: ca.cos(1.5 * t), x), (lambda t, _: ca.sin(1.5 * t), y)]
    functions = [(lambda t: np.cos(1.5 * t), x), (lambda t: np.sin(1.5 * t), y)]
    return h0, functions, drive, (0.0, 10.0), neel(length)


def dop853(multiply, middle, span, psi, tol):
    """Return the state at the end, and the evaluations."""
    count = 0

    def slope(t, y):
        nonlocal count
        count += 1
        return -1j * (multiply(t, y) - middle * y)

    found = solve_ivp(slope, span, psi, method="DOP853", rtol=tol, atol=tol * 1e-2)
    return np.exp(-1j * middle * (span[1] - span[0])) * found.y[:, -1], count


def molecule():
    """Walker and Preston's molecule in a laser, on its grid."""
    system, span, p = walker_preston.system, walker_preston.interval, walker_preston.PARAMS
    (kinetic,) = system.grid.kinetic(system.hbar)
    x = system.grid.points[:, 0]
    morse = p["D"] * (1 - np.exp(-p["alpha"] * x)) ** 2

    def multiply(t, y):
        potential = morse + p["A"] * np.cos(p["omega"] * t) * x
        return np.fft.ifft(kinetic * np.fft.fft(y)) + potential * y

    return system, multiply, span, np.asarray(walker_preston.start["psi"], dtype=complex)


def cases():
    """Give the name, the system, H(t) psi, the middle of the spectrum, span and start."""
    for name, make in (("chain", chain), ("Landau-Zener", landau_zener), ("circular", circular)):
        h0, functions, drive, span, psi = make()
        system = lv.Schrodinger(h0, drive=drive)

        def multiply(t, y, h0=h0, functions=functions):
            return h0 @ y + sum(f(t) * (h @ y) for f, h in functions)

        yield name, system, multiply, float(np.mean(system.bounds_at(0.0))), span, psi
    system, multiply, span, psi = molecule()
    yield "molecule", system, multiply, float(np.mean(system.bounds_at(0.0))), span, psi


def magnus(tol):
    """Return the Magnus method that "auto" takes for a tolerance."""
    order, exponentials, _ = next(scheme for scheme in SCHEMES if tol >= scheme[2])
    return lv.Magnus(order, tol, exponentials)


def alone(tol):
    """Return the Magnus method that "auto" takes for products that are no sum."""
    order, exponentials, _ = next(scheme for scheme in OF_PRODUCTS if tol >= scheme[2])
    return lv.Magnus(order, tol, exponentials)


def by_calls(multiply, method, span, psi, exact):
    """Return calls of a function that is all that is known of H(t), and the error."""
    calls = []

    def product(t, y):
        calls.append(t)
        return multiply(t, y)

    run = lv.integrate(lv.Schrodinger((psi.size, product)), method, t=span, psi=psi)
    return len(calls), np.linalg.norm(run.psi[-1].ravel() - exact)


def main():
    """Publish the table; the errors of others than series are printed alone."""
    rows = []
    for name, system, multiply, middle, span, psi in cases():
        exact = lv.integrate(system, lv.Chebyshev(1e-12), t=span, psi=psi).psi[-1]
        exact = exact.ravel()
        others = []
        for tol in 10.0 ** -np.arange(3.0, 13.1, 0.5):
            for shift in {0.0, middle}:
                found, count = dop853(multiply, shift, span, psi, tol)
                others.append((np.linalg.norm(found - exact), count))
        for tol in TOLERANCES:
            runs = []
            for method in (lv.Chebyshev(tol), magnus(tol)):
                run = lv.integrate(system, method, t=span, psi=psi)
                runs.append((run.stats["products"], np.linalg.norm(run.psi[-1].ravel() - exact)))
            runs += [
                by_calls(multiply, method, span, psi, exact)
                for method in (lv.SchrodingerSplitting(tol), alone(tol))
            ]
            (count, error), *exponentials = runs
            # equal error: the tolerance that was asked for is not what counts
            least = min((n for e, n in others if e <= error), default=np.inf)
            row = {"problem": name, "tolerance": f"{tol:.0e}", "products": f"{count:g}"}
            row |= {"plan": f"{lv.plan(system, lv.Chebyshev(tol), t=span).products:g}"}
            row |= {"error": f"{error:.0e}", "DOP853": None, "ratio": None}
            if np.isfinite(least):
                row |= {"DOP853": f"{least:g}", "ratio": f"{count / least:.2f}"}
            names = ("Magnus", "by products alone", "the same by Magnus")
            for code, (n, off) in zip(names, exponentials, strict=True):
                row |= {code: f"{n:g}", f"error of {code}": f"{off:.0e}"}
            rows.append(row)
    columns = [key for key in rows[0] if key != "plan" and not key.startswith("error of")]
    publish("driven_products", rows, ("scipy",), columns)


if __name__ == "__main__":
    main()
