r"""The Sabra and GOY shell models of turbulence without viscosity and forcing, without units.

Complex velocities :math:`u_1, \dots, u_N` on shells of wave numbers
:math:`k_n = \lambda^n / 16`, and :math:`u_{-1} = u_0 = u_{N+1} = u_{N+2} = 0`. Sabra:

.. math::

    u_n' = i \left(k_{n+1} u_{n+1}^* u_{n+2} - \epsilon k_n u_{n-1}^* u_{n+1}
        + (1 - \epsilon) k_{n-1} u_{n-1} u_{n-2}\right)

and GOY, in which all velocities on the right are conjugate:

.. math::

    u_n' = i \left(k_n u_{n+1}^* u_{n+2}^* - \epsilon k_{n-1} u_{n-1}^* u_{n+1}^*
        - (1 - \epsilon) k_{n-2} u_{n-1}^* u_{n-2}^*\right)

with :math:`\lambda = 2, \epsilon = \tfrac12`. Constant in both are the "energy"
:math:`\tfrac12 \sum |u_n|^2` and the "helicity"
:math:`\tfrac12 \sum (\epsilon - 1)^{-n} |u_n|^2`. No shell drives itself.

V. S. L'vov, E. Podivilov, A. Pomyalov, I. Procaccia, D. Vandembroucq, Phys. Rev. E 58 (1998)
1811-1822; M. Yamada, K. Ohkitani, J. Phys. Soc. Japan 56 (1987) 4210-4213. The references, for
Sabra with eight shells, are by extrapolation in 45 digits, two tolerances 4e-32 apart
(``tools/field_references.py``).
"""

from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np

from liouville._systems import PolynomialField
from liouville.problems import Parameters


class Complex(NamedTuple):
    """A complex expression."""

    real: ca.SX
    imag: ca.SX

    def conjugate(self) -> "Complex":
        """Return the conjugate."""
        return Complex(self.real, -self.imag)

    def times(self, other: "Complex", factor: ca.SX) -> ca.SX:
        """Return i factor times the product, as a column."""
        real = self.real * other.real - self.imag * other.imag
        imag = self.real * other.imag + self.imag * other.real
        return factor * ca.vertcat(-imag, real)


def shells_of(x: ca.SX) -> list[Complex]:
    """Return u_1, ..., u_N and four zeros: u_{N+1}, u_{N+2}, u_{-1} and u_0."""
    parts = ca.vertsplit(x)
    found = [Complex(a, b) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return [*found, *([Complex(ca.SX(0), ca.SX(0))] * 4)]


def sabra(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return u' of the Sabra model."""
    u, eps = shells_of(x), params.eps
    rows = []
    for n in range(x.numel() // 2):
        k = params.ratio ** (n + 1) / 16
        rows.append(
            u[n + 1].conjugate().times(u[n + 2], params.ratio * k)
            + u[n - 1].conjugate().times(u[n + 1], -eps * k)
            + u[n - 1].times(u[n - 2], (1 - eps) * k / params.ratio)
        )
    return ca.vertcat(*rows)


def goy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return u' of the GOY model."""
    u, eps = [each.conjugate() for each in shells_of(x)], params.eps
    rows = []
    for n in range(x.numel() // 2):
        k = params.ratio ** (n + 1) / 16
        rows.append(
            u[n + 1].times(u[n + 2], k)
            + u[n - 1].times(u[n + 1], -eps * k / params.ratio)
            + u[n - 1].times(u[n - 2], -(1 - eps) * k / params.ratio**2)
        )
    return ca.vertcat(*rows)


def energy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the energy."""
    return ca.dot(x, x) / 2


def helicity(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the helicity."""
    weights = [(params.eps - 1) ** -(n // 2 + 1) for n in range(x.numel())]
    return ca.dot(x, ca.vertcat(*weights) * x) / 2


def build(shells: int, model: Literal["sabra", "goy"] = "sabra") -> PolynomialField:
    """Make the system of a shell model.

    Parameters
    ----------
    shells : int
        Number of shells N, at least 3.
    model : {"sabra", "goy"}
        Which of the two.

    Returns
    -------
    PolynomialField
        With coordinates a1, b1, ..., aN, bN, real and imaginary parts.
    """
    models = {"sabra": sabra, "goy": goy}
    if model not in models:
        raise ValueError(f"model must be 'sabra' or 'goy', not {model!r}")
    if shells < 3:
        raise ValueError(f"a shell model has at least 3 shells, not {shells}")
    return PolynomialField(
        models[model],
        x=tuple(f"{part}{n}" for n in range(1, shells + 1) for part in "ab"),
        params={"eps": 0.5, "ratio": 2.0},
        invariants={"energy": energy, "helicity": helicity},
    )


def start_for(shells: int) -> dict[str, Any]:
    """Start with the amplitudes of Kolmogorov's spectrum, k^(-1/3), and phases n^2."""
    n = np.arange(1, shells + 1)
    size = 2.0 ** (-n / 3)
    return {"x": np.column_stack([size * np.cos(n**2), size * np.sin(n**2)]).ravel()}


system = build(8)
start: dict[str, Any] = start_for(8)
interval = (0.0, 10.0)
h = 0.05
conserved = ("energy", "helicity")
reference = {
    1.0: {
        "x": (
            0.4925547803325003465245,
            0.6985763989314120587517,
            -0.4081868299881605709647,
            -0.3952339556178634550245,
            -0.4340436268424217484450,
            0.09504956073868230423218,
            -0.3011754393687437476839,
            -0.07858648651397561935052,
            0.08039327172546162355662,
            0.02457682926272004116343,
            -0.1732435221625446034154,
            -0.1784697822700109321197,
            0.3793320979658931809989,
            -0.1409871294371731308807,
            0.2229069296592215168106,
            -0.1733298418449686039922,
        ),
    },
    10.0: {
        "x": (
            0.5115161605592549566841,
            0.4770600498318802575702,
            -0.7105280180935644307741,
            -0.4261923944947113186093,
            0.3649580131684251741489,
            0.2717655067391324694305,
            0.05563878724395155024059,
            0.1925249254607996205320,
            -0.1010591217171249303867,
            -0.08495809506000841366545,
            0.3393364417901020814081,
            0.01233300577506182821609,
            -0.2149837093836765314098,
            -0.1882071467110984414299,
            0.07578644375749037898507,
            -0.1309047061962468249096,
        ),
    },
}
source = "Sabra model of L'vov et al. (1998); extrapolation in 45-digit arithmetic"
