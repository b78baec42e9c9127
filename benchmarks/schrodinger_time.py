"""Times of a wave function's run, beside SciPy, QuTiP and the library's own Chebyshev series.

Complex random starts, theta = 100, an error of at most 1e-6: on an open square lattice with
disorder, by its diagonals, and with a sparse matrix that has four entries beside the diagonal in
each row at random places within 200, by rows. All codes in turn, the least time counts, and setting
up is no part of it; a million rows are given to the others once. SciPy's ``expm_multiply`` always
goes for the last digit: the splitting at a tolerance of 1e-12 is there for comparison. QuTiP's time
is that of the fastest integrator and tolerance that reach 1e-6 with 10^4 rows; with 10^6 it runs
at a tenth of that tolerance. Both take one thread.

ns: nanoseconds a row, of a real product of the splitting and of a complex one of the series.
share: the bytes that a real product would move if each went through memory alone, a row 32 on the
lattice (the other vector, its own twice, the potential) and 80 of the matrix, over what a STREAM
triad moves in the same time, over as many bytes and on as many threads. Several products go over H
in one sweep, so it may be more than 1.

Run as ``python benchmarks/schrodinger_time.py``, after ``pip install --group bench``; takes four
minutes. ``--rows 10000`` leaves out the large ones, ``--alone`` the others' codes.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")

import argparse
import time
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from peers import lattice, wave
from report import publish, show

import liouville as lv
from liouville.problems import tight_binding

ROWS = (10_000, 1_000_000)
THREADS = (1, 2)
THETA, TOL, FINE, WIDTH, SEED = 100.0, 1e-6, 1e-12, 4.0, 1
REACH, BESIDE = 200, 4
MOVED = {"lattice": 32, "rows": 80}
INTEGRATORS = ("adams", "dop853", "vern7", "vern9", "tsit5", "krylov")
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
ONCE = 100_000  # more rows, and the others run once
SECONDS = 3.0  # of repeats for a code


def systems(n):
    """Return a lattice and a matrix without structure, each with what SciPy takes."""
    side = round(n**0.5)
    square = tight_binding.build((side, side), width=WIDTH)
    entries = square.source.entries()
    matrix = sp.csr_array((entries.values, (entries.row, entries.col)), shape=(n, n))
    yield "lattice", square, matrix
    random = np.random.default_rng(SEED)
    i = np.repeat(np.arange(n), BESIDE // 2)
    j = (i + random.integers(1, REACH + 1, i.size)) % n
    inside = j > i
    half = sp.csr_array((random.uniform(0.5, 1.0, i.size)[inside], (i[inside], j[inside])), (n, n))
    matrix = (half + half.T + sp.diags_array(random.uniform(-2, 2, n))).tocsr()
    yield "rows", lv.Schrodinger(matrix), matrix


class Own:
    """A run of the library; the seconds of the steps alone are kept."""

    def __init__(self, system, psi, span, method, threads):
        self.asked = {"t": (0.0, span), "psi": psi, "threads": threads}
        self.system, self.method = system, method
        self.products, self.inside = 0.0, np.inf

    def run(self, tol):
        """Propagate to the end."""
        begin = time.perf_counter()
        found = lv.integrate(self.system, replace(self.method, tol=tol), **self.asked)
        seconds = time.perf_counter() - begin
        self.inside = min(self.inside, found.stats["seconds"])
        self.products = found.stats["products"]
        return seconds, found.psi[-1]


def least(codes, end, n):
    """Run codes in turn; return least seconds and the error of each by name."""
    errors, seconds = {}, {}
    for name, (code, setting) in codes.items():
        seconds[name], psi = code.run(setting)
        errors[name] = float(np.linalg.norm(psi - end))
    for turn in range(20):
        for name, (code, setting) in codes.items():
            is_other = not isinstance(code, Own)
            if (turn + 1) * seconds[name] > SECONDS or (is_other and n > ONCE):
                continue
            seconds[name] = min(seconds[name], code.run(setting)[0])
    return seconds, errors


def fastest(matrix, psi, span, end):
    """Return the integrator and tolerance of QuTiP's that is the fastest to reach the error."""
    found = []
    for integrator in INTEGRATORS:
        code = wave.QuTiP(matrix, psi, span, integrator, counted=False)
        for tol in TOLERANCES:
            try:
                seconds, state = code.run(tol)
            except Exception as trouble:  # they give up in many ways
                print(integrator, tol, str(trouble).splitlines()[0])
                continue
            if np.linalg.norm(state - end) <= TOL:
                found.append((min(seconds, code.run(tol)[0]), integrator, tol))
                break
    return min(found)[1:]


def start(n):
    """Return a random state."""
    psi = np.random.default_rng(SEED).normal(size=2 * n).view(complex)
    return psi / np.linalg.norm(psi)


def reference(system, psi, span):
    """Return the end by a Chebyshev series, once a splitting agrees."""
    series = lv.integrate(system, lv.Chebyshev(FINE), t=(0.0, span), psi=psi)
    shears = lv.integrate(system, lv.SchrodingerSplitting(FINE), t=(0.0, span), psi=psi)
    if np.linalg.norm(series.psi[-1] - shears.psi[-1]) > 2 * FINE:
        raise AssertionError("two references differ")
    return series.psi[-1]


def compare(kind, system, matrix, threads, others, best):
    """Return a row of times; `best` keeps what of QuTiP's is the fastest with few rows."""
    n, psi = system.size, start(system.size)
    low, high = system.bounds
    span = 2 * THETA / (high - low)
    end = reference(system, psi, span)
    codes = {
        "splitting": (Own(system, psi, span, lv.SchrodingerSplitting(mode="fast"), threads), TOL),
        "series": (Own(system, psi, span, lv.Chebyshev(), threads), TOL),
        "splitting 1e-12": (Own(system, psi, span, lv.SchrodingerSplitting(), threads), FINE),
    }
    if others and threads == 1:
        if kind not in best:
            best[kind] = fastest(matrix, psi, span, end)
        integrator, tol = best[kind]
        codes["SciPy"] = wave.SciPy(matrix, psi, span), None
        tol = tol if n <= ONCE else tol / 10
        codes["QuTiP"] = wave.QuTiP(matrix, psi, span, integrator, counted=False), tol
    seconds, errors = least(codes, end, n)
    own, series = codes["splitting"][0], codes["series"][0]
    size = MOVED[kind] * n
    triad = lattice.Triad(size, threads=threads)
    speed = max(triad.run(1 + 10**8 // size)[1] for _ in range(20))
    moved = 2 * own.products * size / own.inside
    row = {"H": kind, "n": n, "threads": threads, "products": own.products}
    row |= {f"{name} ms": 1e3 * seconds.get(name, np.nan) for name in (*codes, "SciPy", "QuTiP")}
    row |= {f"{name} error": errors.get(name, np.nan) for name in (*codes, "SciPy", "QuTiP")}
    row["ns"] = 1e9 * own.inside / (2 * own.products * n)
    row["series ns"] = 1e9 * series.inside / (series.products * n)
    for name in ("series", "SciPy", "QuTiP"):
        row[f"{name} / splitting"] = seconds.get(name, np.nan) / seconds["splitting"]
    row["SciPy / splitting 1e-12"] = seconds.get("SciPy", np.nan) / seconds["splitting 1e-12"]
    return row | {"triad GB/s": 1e-9 * speed, "share": moved / speed}


def main():
    parser = argparse.ArgumentParser(description="times of a wave function's run")
    parser.add_argument("--rows", type=int, nargs="*", default=ROWS)
    parser.add_argument("--threads", type=int, nargs="*", default=THREADS)
    parser.add_argument("--alone", action="store_true", help="without SciPy and QuTiP")
    given = parser.parse_args()
    rows, best = [], {}
    for n in given.rows:
        for kind, system, matrix in systems(n):
            for threads in given.threads:
                begin = time.perf_counter()
                row = compare(kind, system, matrix, threads, not given.alone, best)
                rows.append(row)
                took = time.perf_counter() - begin
                print(f"{kind}, {n} rows, {threads} threads: {took:.0f} s", flush=True)
    print("QuTiP's fastest:", best)
    show(rows)
    columns = ("H", "n", "threads", "splitting ms", "series ms", "SciPy ms", "QuTiP ms")
    columns += ("series / splitting", "SciPy / splitting", "SciPy / splitting 1e-12")
    columns += ("ns", "share")
    print("\nMilliseconds and ratios:\n")
    publish("schrodinger_time", rows, ("numba", "qutip", "scipy"), columns)


if __name__ == "__main__":
    main()
