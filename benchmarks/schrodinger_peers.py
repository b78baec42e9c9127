"""Products H psi and errors of this library and of other codes for wave functions, in one table.

An open chain with disorder, Heisenberg's chain of ten spins and a complex lattice with a flux, each
from a complex state for theta = 100, beta half the width of bounds of the spectrum that all share.
Errors are those of the state at the end, in its norm, against eigenvalues and -vectors. Of a code
with tolerances the run with the fewest products that reaches the error counts. Every product of H
with a complex vector is counted, by the matrix itself. Counts do not depend on the machine.

Run as ``python benchmarks/schrodinger_peers.py``, after ``pip install --group bench quspin``.
"""

import numpy as np
import qutip
import scipy.sparse as sp
from peers import wave
from quspin.operators import hamiltonian
from quspin.tools import evolution
from report import publish
from scipy.sparse.linalg import expm_multiply
from scipy.special import jv

import liouville as lv
from liouville.problems import heisenberg

THETA = 100.0
TOLERANCES = (1e-4, 1e-8, 1e-12)
FINE = 10.0 ** -np.arange(3.0, 15.0)
INTEGRATORS = ("adams", "dop853", "vern7", "vern9")


class Matrix(sp.csr_array):
    """A sparse matrix that counts its products with vectors."""

    products = 0

    def _matmul_dispatch(self, other, *args, **kwargs):
        Matrix.products += 1
        return super()._matmul_dispatch(other, *args, **kwargs)


def chebyshev(matrix, bounds, span, psi, tol):
    """Return the Chebyshev series of a textbook, with terms down to the tolerance."""
    sigma, beta = 0.5 * (bounds[1] + bounds[0]), 0.5 * (bounds[1] - bounds[0])
    tail = 2 * np.abs(jv(np.arange(int(beta * span) + 200), beta * span))[::-1].cumsum()[::-1]
    degree = int(np.argmax(tail[1:] <= tol))
    before, term = psi, (matrix @ psi - sigma * psi) / beta
    found = jv(0, beta * span) * before - 2j * jv(1, beta * span) * term
    for k in range(2, degree + 1):
        before, term = term, 2 * (matrix @ term - sigma * term) / beta - before
        found = found + 2 * (-1j) ** k * jv(k, beta * span) * term
    return np.exp(-1j * sigma * span) * found


def problems():
    """Give names, matrices, and systems of the library."""
    draw = np.random.default_rng(0)
    chain = sp.diags_array([draw.uniform(-1, 1, 200), -np.ones(199), -np.ones(199)],
                           offsets=[0, 1, -1])  # fmt: skip
    yield "disordered chain of 200", chain, lv.Schrodinger(chain.tocsr())
    spins = heisenberg.build(10, field=np.cos(np.arange(10)))
    unit = np.eye(spins.size)
    matrix = np.array([spins.outward(spins.hamiltonian.multiply(row)) for row in unit])
    places = np.array([spins.outward(row.astype(complex)).real for row in unit])
    yield "Heisenberg chain of 10", sp.csr_array(places.T @ matrix), spins
    n = 16
    hop = -np.ones(n - 1)
    along = sp.diags_array([hop], offsets=[1], shape=(n, n))
    turned = sp.block_diag([np.exp(0.42j * np.pi * i) * along for i in range(n)])
    half = turned + sp.kron(along, sp.identity(n))
    flux = sp.csr_array(half + half.conj().T)
    yield "16 x 16 lattice, flux 0.21", flux, lv.Schrodinger(flux)


def fewest(runs, tol):
    """Return products and error of the cheapest run that reaches a tolerance."""
    return min(((n, error) for n, error in runs if error <= tol), default=(np.nan, np.nan))


def counted(run):
    """Return what a run returns, and the products it made."""
    Matrix.products = 0
    found = run()
    return Matrix.products, found


def quspin_runs(matrix, span, psi):
    """Give products and states of QuSpin's two ways: its own exponential, and an integrator."""
    own = hamiltonian([matrix], [], dtype=np.complex128, check_symm=False, check_herm=False)
    tool = evolution.expm_multiply_parallel(sp.csr_matrix(own.tocsr()), a=-1j * span)
    # its loop over at most so many terms of each of its steps is compiled
    yield "QuSpin expm_multiply", int(tool._m_star * tool._s), tool.dot(psi.copy())
    for tol in FINE:
        calls = []

        def slope(t, y, calls=calls):
            calls.append(t)
            return -1j * own.dot(y)

        found = evolution.evolve(
            psi, 0.0, span, slope, solver_name="dop853", atol=tol, rtol=tol, nsteps=10**8
        )
        yield "QuSpin evolve", len(calls), found


def measure(name, matrix, system):
    """Give a row for each code and tolerance."""
    energies, vectors = np.linalg.eigh(matrix.toarray())
    low, high = system.bounds
    span = 2 * THETA / (high - low)
    psi = np.random.default_rng(1).normal(size=(2, energies.size)).T @ [1.0, 1j]
    psi /= np.linalg.norm(psi)
    exact = vectors @ (np.exp(-1j * energies * span) * (vectors.conj().T @ psi))
    runs = {}

    def keep(code, products, found):
        runs.setdefault(code, []).append((products, float(np.linalg.norm(found - exact))))

    mine = Matrix(matrix.astype(complex))
    keep("SciPy expm_multiply", *counted(lambda: expm_multiply(-1j * span * mine, psi)))
    for code, products, found in quspin_runs(matrix, span, psi):
        keep(code, products, found)
    for integrator in INTEGRATORS:
        code = wave.QuTiP(matrix, psi, span, integrator)
        for tol in FINE:
            try:
                found = code.run(tol)[1]
            except qutip.IntegratorException as trouble:
                print(integrator, tol, str(trouble).splitlines()[0])
                continue
            keep("QuTiP", code.products, found)
    for tol in TOLERANCES:
        ours = lv.integrate(system, lv.SchrodingerSplitting(tol), t=(0.0, span), psi=psi)
        cells = {"liouville": (ours.stats["products"], np.linalg.norm(ours.psi[-1] - exact))}
        products, found = counted(lambda tol=tol: chebyshev(mine, (low, high), span, psi, tol))
        cells["NumPy Chebyshev"] = products, np.linalg.norm(found - exact)
        cells |= {code: fewest(each, tol) for code, each in runs.items()}
        for code, (products, error) in cells.items():
            row = {"problem": name, "tol": tol, "code": code, "products": products}
            yield {**row, "error": float(error)}


def main():
    """Print the table: a line for each problem and tolerance, products and error of each code."""
    rows = [row for problem in problems() for row in measure(*problem)]
    table = {}
    for row in rows:
        line = table.setdefault((row["problem"], row["tol"]), {})
        text = "not reached" if np.isnan(row["products"]) else f"{row['products']:g}"
        line[row["code"]] = f"{text} ({row['error']:.0e})" if text[0] != "n" else text
    publish(
        "schrodinger_peers",
        [{"problem": name, "tolerance": tol, **line} for (name, tol), line in table.items()],
        ("scipy", "qutip", "quspin"),
    )


if __name__ == "__main__":
    main()
