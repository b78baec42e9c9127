r"""A packet in a bowl, on a lattice of two dimensions; no units.

.. math::

    (H \psi)_j = \tfrac12 \omega^2 |j - c|^2 \psi_j - \sum_{k \text{ next to } j} \psi_k

The lattice has 32 by 32 sites, c is its middle and :math:`\omega = 0.2`. A packet of Gauss's
shape starts beside the middle. Near the bottom of the band a particle on the lattice has mass 1/2,
and so the packet swings, but the band has a top, and it falls apart. The Hamiltonian is a sum over
the axes, so a product of packets stays a product of states on chains; the reference is that
of one by Taylor series in 40 digits (``tools/quantum_references.py``).
"""

from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lattice, Schrodinger

#: Number of sites along each axis.
SITES = 32

OMEGA = 0.2


def bowl(sites: int) -> NDArray[np.float64]:
    """Return the potential along an axis."""
    x = np.arange(float(sites)) - (sites - 1) / 2
    return OMEGA**2 / 2 * x**2


def packet(sites: int) -> NDArray[np.float64]:
    """Return the start along an axis, not normalised: wide by 2, a quarter from the beginning."""
    x = np.arange(sites) - (3 * sites // 8)
    return np.exp(-(x**2) / 8.0)


def chain(sites: int) -> Lattice:
    """Return the lattice of one axis."""
    return Lattice(sites, potential=bowl(sites))


def build(sites: int, axes: int = 2) -> Schrodinger:
    """Make the system of a lattice with so many sites along each axis."""
    potentials = np.meshgrid(*[bowl(sites)] * axes, indexing="ij")
    return Schrodinger(Lattice((sites,) * axes, potential=sum(potentials)))


def start_for(sites: int, axes: int = 2) -> dict[str, Any]:
    """Start with a packet, as it is in the reference: of norm 1 up to roundoff."""
    line = packet(sites) / np.linalg.norm(packet(sites))
    return {"psi": reduce(np.multiply.outer, [line] * axes).ravel()}


system = build(SITES)
start: dict[str, Any] = start_for(SITES)
interval = (0.0, 10.0)
tol = 1e-10
conserved = ("norm", "energy")
reference = {
    10.0: {
        "psi": {
            560: complex(0.053849452113799778278, -0.07650752855603947574),
            592: complex(0.092283939944596957424, -0.072618418492487216269),
            624: complex(0.10794416193457542143, -0.052760771729373540151),
            656: complex(0.096632494219031670534, -0.031736579385908990856),
        }
    }
}
source = "product of states on chains, Taylor series in 40-digit arithmetic"
