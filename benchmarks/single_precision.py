"""Errors that states of single precision would have, by methods of this library in NumPy.

A chain of 10,000 sites with disorder from a complex random state, for lengths theta = beta t: a
Chebyshev series and a stable splitting of the ladder with all vectors and the matrix rounded to 32
bits after every operation, against the same in double precision.

With ``--memory`` instead: what a run of a chain of 24 spins in its sector takes at its peak, in
bytes a component of the state, for one state observed at its end, and for two that are kept.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from report import show
from scipy.special import jv

import liouville as lv

SITES, BETA = 10_000, 3.0
THETAS = (10.0, 100.0, 1000.0, 10_000.0)


def series(matrix, psi, theta):
    """Return the Chebyshev series, in the precision of the matrix and the state."""
    real, kind = matrix.dtype.type, psi.dtype.type
    factors = jv(np.arange(int(theta + 60 + 8 * theta ** (1 / 3))), theta)
    before, term = psi, (matrix @ psi) * real(1 / BETA)
    found = kind(factors[0]) * before + kind(-2j * factors[1]) * term
    for k in range(2, factors.size):
        before, term = term, (matrix @ term) * real(2 / BETA) - before
        found = found + kind(2 * (-1j) ** k * factors[k]) * term
    return found


def splitting(matrix, psi, coefficients, steps, h):
    """Return steps of shears, in the precision of the matrix and the state."""
    real = matrix.dtype.type
    q, p = psi.real.copy(), psi.imag.copy()
    for _ in range(steps):
        for k, a in enumerate(coefficients):
            if k % 2:
                p = p - real(a * h) * (matrix @ q)
            else:
                q = q + real(a * h) * (matrix @ p)
    return q + 1j * p


def status(key):
    """Return bytes of memory of this process, as Linux counts them."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(key))


def peak(method, is_kept):
    """Return the bytes a component that a run takes at its peak, beside the start."""
    system = lv.Schrodinger(lv.SpinChain(24, up=12))
    psi = np.full(system.size, 1e-3 + 0j)
    how = {} if is_kept else {"states": False, "observe": {"up": np.ones(psi.size)}}
    Path("/proc/self/clear_refs").write_text("5")  # the peak is what there is now
    before = status("VmRSS")
    lv.integrate(system, method, t=(0, 1), psi=psi, **how)
    return (status("VmHWM") - before) / psi.size


def memory():
    """Print what runs take, each in a process of its own."""
    for method in (lv.Chebyshev(tol=1e-5), lv.SchrodingerSplitting(tol=1e-5, mode="stable")):
        found = []
        for is_kept in (False, True):
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                found.append(pool.submit(peak, method, is_kept).result())
        print(f"{type(method).__name__}: {found[0]:.0f} observed, {found[1]:.0f} kept")


def main():
    """Print the table."""
    draw = np.random.default_rng(0)
    sides = [-np.ones(SITES - 1)] * 2
    matrix = sp.diags_array([draw.uniform(-1, 1, SITES), *sides], offsets=[0, 1, -1]).tocsr()
    system = lv.Schrodinger(matrix, bounds=(-BETA, BETA))
    psi = draw.normal(size=(2, SITES)).T @ [1.0, 1j]
    psi /= np.linalg.norm(psi)
    rows = []
    for theta in THETAS:
        span = theta / BETA
        plan = lv.plan(system, lv.SchrodingerSplitting(1e-4, "stable"), t=(0.0, span))
        shears = (np.asarray(plan.core.coefficients), plan.steps, span / plan.steps)
        ends = [
            (series(h, state, theta), splitting(h, state, *shears))
            for h, state in ((matrix, psi), (matrix.astype("f4"), psi.astype("c8")))
        ]
        errors = [np.linalg.norm(one - other) for one, other in zip(*ends, strict=True)]
        rows.append({"theta": theta, "series": errors[0], "stable splitting": errors[1]})
    show(rows)


if __name__ == "__main__":
    if sys.argv[1:] == ["--memory"]:
        memory()
    else:
        main()
