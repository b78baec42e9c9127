"""Other codes for the Schrödinger equation: QuTiP and SciPy, on one complex state.

Each code has ``run(setting) -> (seconds, psi)``; the matrix is read before. ``products`` are those
of H with a complex vector that the last run took.
"""

import time

import qutip
import scipy.sparse as sp
from scipy.sparse.linalg import expm_multiply


class QuTiP:
    """``sesolve`` with one of its integrators; a setting is the relative and absolute tolerance.

    A coefficient that is always 1 counts the products. With ``counted=False`` it is left out.
    """

    def __init__(self, matrix, psi, span, integrator, *, counted=True):
        hamiltonian = qutip.Qobj(sp.csr_array(matrix).astype(complex))
        self.hamiltonian = [[hamiltonian, self._one]] if counted else hamiltonian
        self.start, self.span, self.integrator = qutip.Qobj(psi), span, integrator
        self.products = 0

    def _one(self, t):
        self.products += 1
        return 1.0

    def run(self, tolerance):
        """Integrate to the end."""
        options = {
            "method": self.integrator,
            "atol": tolerance,
            "nsteps": 10**8,
            "store_final_state": True,
            "normalize_output": False,
            "progress_bar": "",
        }
        if self.integrator == "krylov":
            options["krylov_dim"] = 20
        else:
            options["rtol"] = tolerance
        self.products = 0
        begin = time.perf_counter()
        found = qutip.sesolve(self.hamiltonian, self.start, [0.0, self.span], options=options)
        seconds = time.perf_counter() - begin
        return seconds, found.final_state.full()[:, 0]


class SciPy:
    """``expm_multiply``, which always goes for the last digit; a setting is not looked at."""

    def __init__(self, matrix, psi, span):
        self.exponent = -1j * span * sp.csr_array(matrix)
        self.trace, self.psi = complex(self.exponent.trace()), psi

    def run(self, tolerance):
        """Multiply the state with the exponential."""
        del tolerance
        begin = time.perf_counter()
        found = expm_multiply(self.exponent, self.psi, traceA=self.trace)
        return time.perf_counter() - begin, found
