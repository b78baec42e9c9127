"""Products H psi against the error that is reached, beside Chebyshev, Lanczos and QuTiP.

Five problems of the library, theta = beta t from 20 to 1e4 with beta half the width of the bounds
that all methods share, tolerances from 1e-3 to 1e-12. Starts are complex: the problem's own, a time
3 / beta later; a second column of the Chebyshev series starts from the problem's own, which is
real. Errors are those of the state at the end, in its norm, against eigenvalues and -vectors. The
library's methods are asked for the tolerance; of Lanczos' three dimensions and of QuTiP's
integrators and tolerances the run with the fewest products that reaches it counts. Counts do not
depend on the machine.

Run as ``python benchmarks/schrodinger_products.py``, after ``pip install --group bench``; takes
some minutes. Without ``--qutip`` QuTiP is left out.
"""

import argparse
from dataclasses import replace

import numpy as np
from report import publish, show

import liouville as lv
from liouville.problems import heisenberg, load

THETAS = (20.0, 100.0, 1000.0, 10_000.0)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
LATER = 3.0
DIMENSIONS = (12, 20, 30)
INTEGRATORS = ("adams", "dop853", "vern7", "vern9", "tsit5")
FINE = 10.0 ** -np.arange(3, 14.5, 0.5)  # tolerances that QuTiP is asked for
QUTIP_TO = 1000.0  # no longer ones
OURS = {
    "fast": lv.SchrodingerSplitting(mode="fast"),
    "stable": lv.SchrodingerSplitting(mode="stable"),
    "Chebyshev": lv.Chebyshev(),
}
RATIOS = ("stable", "Chebyshev", "real Chebyshev", "Lanczos", "QuTiP")


def problems():
    """Return the systems and their starts by name."""
    tight = load("tight_binding")
    found = {name: load(name) for name in ("poschl_teller", "harmonic_oscillator", "lattice2d")}
    pairs = {name: (module.system, module.start["psi"]) for name, module in found.items()}
    pairs["disorder"] = tight.disordered, tight.disordered_start["psi"]
    pairs["heisenberg"] = heisenberg.build(10, field=np.cos(np.arange(10))), None
    chain = pairs["heisenberg"][0]
    pairs["heisenberg"] = chain, heisenberg.start_for(10)["psi"]
    return pairs


class Exact:
    """A system by its eigenvalues and -vectors."""

    def __init__(self, system):
        unit = np.eye(system.size)
        self.matrix = np.array([system.outward(system.hamiltonian.multiply(e)) for e in unit])
        inner = np.array([system.outward(e.astype(complex)).real for e in unit])
        self.matrix = inner.T @ self.matrix  # from the core's order of the components
        self.energies, self.vectors = np.linalg.eigh(self.matrix)

    def at(self, t, psi):
        """Return a state at a time."""
        return self.vectors @ (np.exp(-1j * self.energies * t) * (self.vectors.T @ psi))


def ours(system, method, span, psi, tol, exact):
    """Return products, error and bound of a run of the library; NaN where it refuses."""
    try:
        found = lv.integrate(system, replace(method, tol=tol), t=(0.0, span), psi=psi)
    except ValueError:
        return np.nan, np.nan, np.nan
    error = np.linalg.norm(found.psi[-1] - exact)
    return found.stats["products"], float(error), found.stats.get("bound", np.nan)


def fewest(runs, tol):
    """Return products and error of the cheapest run that reaches a tolerance."""
    return min(((n, error) for n, error, *_ in runs if error <= tol), default=(np.nan, np.nan))


def peers(exact, span, psi, end):
    """Return products and errors of QuTiP's integrators at all tolerances."""
    from peers import wave

    runs = []
    for integrator in INTEGRATORS:
        code = wave.QuTiP(exact.matrix, psi, span, integrator)
        for tol in FINE:
            try:
                found = code.run(tol)[1]
            except Exception as trouble:  # they give up in many ways
                print(integrator, tol, str(trouble).splitlines()[0])
                continue
            runs.append((code.products, float(np.linalg.norm(found - end))))
    return runs


def measure(name, system, start, theta, *, is_wide):
    """Return a row for each tolerance."""
    exact = Exact(system)
    low, high = system.bounds
    beta = 0.5 * (high - low)
    span = theta / beta
    real = start / np.linalg.norm(start)
    psi = exact.at(LATER / beta, real)
    end, real_end = exact.at(span, psi), exact.at(span, real)
    others = peers(exact, span, psi, end) if is_wide and theta <= QUTIP_TO else []
    for tol in TOLERANCES:
        row = {"problem": name, "theta": theta, "tol": tol}
        for code, method in OURS.items():
            row[code], row[f"{code} error"], row[f"{code} bound"] = ours(
                system, method, span, psi, tol, end
            )
        row["real Chebyshev"], row["real Chebyshev error"], _ = ours(
            system, lv.Chebyshev(), span, real, tol, real_end
        )
        krylov = [ours(system, lv.Lanczos(dimension=d), span, psi, tol, end) for d in DIMENSIONS]
        row["Lanczos"], row["Lanczos error"] = fewest(krylov, tol)
        row["QuTiP"], row["QuTiP error"] = fewest(others, tol)
        yield row


def summary(rows):
    """Return a row for each theta and tolerance: means and extremes of ratios over the problems."""
    for theta in THETAS:
        for tol in TOLERANCES:
            cell = [row for row in rows if (row["theta"], row["tol"]) == (theta, tol)]
            found = {"Θ": theta, "tolerance": tol}
            found["fast / Θ"] = mean([row["fast"] / theta for row in cell])
            for code in RATIOS:
                ratios = np.array([row[code] / row["fast"] for row in cell])
                ratios = ratios[np.isfinite(ratios)]
                found[code] = mean(ratios)
                if code in ("Lanczos", "QuTiP"):
                    text = f"{ratios.min():.2g} to {ratios.max():.2g}" if ratios.size else "-"
                    found[f"{code} range"] = text
            yield found


def mean(values):
    """Return the mean of the finite ones."""
    values = np.asarray(values, dtype=float)
    values = values[np.isfinite(values)]
    return float(values.mean()) if values.size else float("nan")


def honesty(rows):
    """Return for each method how its errors compare with tolerances and bounds."""
    for code in (*OURS, "real Chebyshev"):
        cells = [row for row in rows if np.isfinite(row[code])]
        beyond = sum(row[f"{code} error"] > row["tol"] for row in cells)
        bounds = [row.get(f"{code} bound", np.nan) / row[f"{code} error"] for row in cells]
        yield {
            "method": code,
            "runs": len(cells),
            "refused": len(rows) - len(cells),
            "error beyond tol": beyond,
            "least bound / error": float(np.min(bounds)),
            "median": float(np.median(bounds)),
            "largest": float(np.max(bounds)),
        }


def main():
    parser = argparse.ArgumentParser(description="products of a wave function against its error")
    parser.add_argument("--qutip", action="store_true", help="run QuTiP too")
    is_wide = parser.parse_args().qutip
    packages = ("qutip", "scipy") if is_wide else ()
    rows = [
        row
        for name, (system, start) in problems().items()
        for theta in THETAS
        for row in measure(name, system, start, theta, is_wide=is_wide)
    ]
    show(rows)
    print("\nProducts of fast splittings by theta, and of the others by those of fast ones:\n")
    columns = ("Θ", "tolerance", "fast / Θ", *RATIOS)
    publish("schrodinger_products", list(summary(rows)), packages, columns)
    print("\nErrors and bounds:\n")
    show(list(honesty(rows)))


if __name__ == "__main__":
    main()
