"""
Products against error
======================

A particle on a square lattice with disorder, for a time in which a Chebyshev series takes more than
five hundred products with the Hamiltonian. A splitting into shears takes fewer for the same
error. Lanczos' method, with restarts, takes more, because the state has components at all energies.
In the well of Pöschl and Teller it has twelve of them, and Lanczos is best where three digits are
enough.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import poschl_teller, tight_binding

plt.style.use(plot.STYLE)

THETA = 500.0
METHODS = {
    "splitting": lv.SchrodingerSplitting(mode="fast"),
    "Chebyshev": lv.Chebyshev(),
    "Lanczos": lv.Lanczos(dimension=20),
}
PROBLEMS = {
    "disorder": (tight_binding.disordered, tight_binding.disordered_start["psi"]),
    "well": (poschl_teller.system, poschl_teller.start["psi"]),
}


# %%
# A method takes a tolerance, and the error is measured against a run to eleven digits.


def measure(system, psi):
    """Return products and errors of each method, for tolerances of one to nine digits."""
    low, high = system.bounds
    span = (0.0, 2 * THETA / (high - low))
    psi = (
        psi * np.exp(1j) / np.linalg.norm(psi)
    )  # not a real state, which would be a special case
    exact = lv.integrate(system, lv.Chebyshev(tol=1e-11), t=span, psi=psi).psi[-1]
    runs = {}
    for code, method in METHODS.items():
        points = []
        for tol in 10.0 ** -np.arange(1, 10):
            found = lv.integrate(system, replace(method, tol=tol), t=span, psi=psi)
            error = np.linalg.norm(found.psi[-1] - exact)
            points.append((found.stats["products"], error))
        runs[code] = np.transpose(points)
    return runs


# %%
# The lattice with disorder.

fig, ax = plt.subplots()
plot.cost(measure(*PROBLEMS["disorder"]), ax=ax)
plt.show()

# %%
# The well.

fig, ax = plt.subplots()
plot.cost(measure(*PROBLEMS["well"]), ax=ax)
plt.show()
