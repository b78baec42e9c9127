r"""A packet in a bowl, on a lattice of three dimensions; no units.

.. math::

    (H \psi)_j = \tfrac12 \omega^2 |j - c|^2 \psi_j - \sum_{k \text{ next to } j} \psi_k

The lattice has 16 by 16 by 16 sites, c is its middle and :math:`\omega = 0.2`. A packet of Gauss's
shape starts beside the middle. Near the bottom of the band a particle on the lattice has mass 1/2,
and so the packet swings, but the band has a top, and it falls apart. The Hamiltonian is a sum over
the axes, so a product of packets stays a product of states on chains; the reference is that
of one by Taylor series in 40 digits (``tools/quantum_references.py``).
"""

import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lattice, Schrodinger

#: Number of sites along each axis.
SITES = 16

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


def build(sites: int) -> Schrodinger:
    """Make the system of a lattice with so many sites along each axis."""
    axes = np.meshgrid(*[bowl(sites)] * 3, indexing="ij")
    return Schrodinger(Lattice((sites,) * 3, potential=sum(axes)))


def start_for(sites: int) -> dict[str, NDArray[np.float64]]:
    """Start with a packet, as it is in the reference: of norm 1 up to roundoff."""
    line = packet(sites) / np.linalg.norm(packet(sites))
    psi = np.multiply.outer(np.multiply.outer(line, line), line)
    return {"psi": psi.ravel()}


system = build(SITES)
start = start_for(SITES)
interval = (0.0, 10.0)
tol = 1e-10
conserved = ("norm", "energy")
reference = {
    10.0: {
        "psi": {
            1928: complex(0.053091346398079754792, -0.050248339028491670452),
            2184: complex(0.082769316600357239014, -0.053703832974516941188),
            2440: complex(0.096943405527447662321, -0.04931603591072004507),
            2696: complex(0.087077727145627052261, -0.040940389902342891785),
        }
    }
}
source = "product of states on chains, Taylor series in 40-digit arithmetic"
