"""Products and times of many outputs of wave functions, and bounds of a sparse spectrum."""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse as sp
from report import publish

import liouville as lv

COUNTS = (1, 10, 100, 1000)
THETA, TOL = 100.0, 1e-8


def random_sparse(n: int, entries: int = 10) -> sp.csr_array:
    """Return a symmetric matrix with entries at random places."""
    matrix = sp.random_array((n, n), density=entries / n, rng=np.random.default_rng(1))
    matrix.data -= 0.5
    return sp.csr_array(matrix + matrix.T)


def seconds(system, method, t, psi, repeats=3):
    """Return the products, and the least time of some runs that keep an observable alone."""
    best = np.inf
    plan = lv.plan(system, method, t=t, psi=psi)
    for _ in range(repeats):
        clock = time.perf_counter()
        run = lv.integrate(system, plan, t=t, psi=psi, states=False, threads=1)
        best = min(best, time.perf_counter() - clock)
    return run.stats["products"], best


def outputs() -> None:
    """Print products and times by the number of outputs."""
    systems = {
        "chain of 200": lv.Schrodinger(lv.Lattice(200)),
        "lattice of 10000": lv.Schrodinger(
            lv.Lattice((100, 100), potential=np.random.default_rng(0).normal(size=(100, 100)))
        ),
        "sparse, 10000 rows": lv.Schrodinger(random_sparse(10**4)),
    }
    rows = []
    for name, system in systems.items():
        rng = np.random.default_rng(2)
        psi = rng.normal(size=system.size) + 1j * rng.normal(size=system.size)
        psi /= np.linalg.norm(psi)
        span = THETA / (np.ptp(system.bounds) / 2)
        for count in COUNTS:
            t = np.linspace(0.0, span, count + 1)
            row = {"H": name, "outputs": count}
            splitting, series = lv.SchrodingerSplitting(TOL, "stable"), lv.Chebyshev(TOL)
            for code, method in (("splitting", splitting), ("series", series)):
                products, best = seconds(system, method, t, psi, 3 if count < 1000 else 1)
                row |= {code: f"{products:g}", f"{code} ms": 1e3 * best}
            real = lv.plan(system, lv.Chebyshev(TOL), t=t, psi=psi.real).products
            rows.append(row | {"series, real start": f"{real:g}"})
    publish("schrodinger_outputs", rows)


def bounds() -> None:
    """Print widths of bounds of a sparse matrix, and the products of a run with them."""
    matrix = random_sparse(3000)
    ends = np.linalg.eigvalsh(matrix.toarray())[[0, -1]]
    span = 2 * THETA / np.ptp(ends)
    rows = []
    for way in ("gershgorin", "auto", "lanczos"):
        system = lv.Schrodinger(matrix, bounds=way)
        plan = lv.plan(system, lv.Chebyshev(TOL), t=(0.0, span))
        split = lv.plan(system, lv.SchrodingerSplitting(TOL, "fast"), t=(0.0, span))
        width = np.ptp(plan.bounds) / np.ptp(ends)
        once = system.spectrum(span).products
        row = {"bounds": f"{way}: {plan.guarantee}", "width / true width": f"{width:.3f}"}
        row |= {"products of Lanczos": once, "splitting": split.products, "series": plan.products}
        rows.append(row)
    publish("schrodinger_bounds", rows)


if __name__ == "__main__":
    outputs()
    print()
    bounds()
