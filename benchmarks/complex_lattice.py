"""A lattice with a magnetic flux through its cells: products and times of methods, beside SciPy's.

The flux makes H complex, and no gauge makes it real. `python benchmarks/complex_lattice.py`
"""

import argparse
import time

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import expm_multiply

import liouville as lv

#: The tolerance of all runs.
TOL = 1e-8


def lattice(n, flux=0.21):
    """Return a square of n by n sites with so many flux quanta in a cell, in the Landau gauge."""
    along = sp.diags_array([-np.ones(n - 1)], offsets=[1])
    turned = sp.diags_array([np.exp(2j * np.pi * flux * np.arange(n))], offsets=[0])
    half = sp.kron(along, sp.eye_array(n)) + sp.kron(turned, along)
    return (half + half.conj().T).tocsr()


def timed(run, *args, **more):
    """Return what a run gives, and its seconds of a processor."""
    clock = time.process_time()
    found = run(*args, **more)
    return found, time.process_time() - clock


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sites", type=int, nargs="+", default=[30, 300])
    parser.add_argument("--theta", type=float, default=100.0)
    sizes = parser.parse_args()
    for n in sizes.sites:
        h = lattice(n)
        rng = np.random.default_rng(0)
        psi = rng.normal(size=n * n) + 1j * rng.normal(size=n * n)
        psi /= np.linalg.norm(psi)
        system = lv.Schrodinger(h)
        t = sizes.theta / (0.5 * np.ptp(system.bounds))
        wanted, seconds = timed(expm_multiply, -1j * t * h, psi)
        print(f"| {n} x {n} | SciPy | | | {1e3 * seconds:.0f} |")
        for name, method in (
            ("auto", lv.SchrodingerSplitting(TOL)),
            ("stable", lv.SchrodingerSplitting(TOL, mode="stable")),
            ("Lanczos", lv.Lanczos(TOL)),
        ):
            lv.integrate(system, method, t=(0, t / 10), psi=psi)
            solution, seconds = timed(lv.integrate, system, method, t=(0, t), psi=psi)
            error = np.linalg.norm(solution.psi[-1] - wanted)
            products = solution.stats["products"]
            print(f"| | {name} | {products:g} | {error:.0e} | {1e3 * seconds:.0f} |")


if __name__ == "__main__":
    main()
