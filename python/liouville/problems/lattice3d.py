r"""A packet in a bowl, on a lattice of three dimensions; no units.

.. math::

    (H \psi)_j = \tfrac12 \omega^2 |j - c|^2 \psi_j - \sum_{k \text{ next to } j} \psi_k

The lattice has 16 by 16 by 16 sites, c is its middle and :math:`\omega = 0.2`. A packet of Gauss's
shape starts beside the middle. Near the bottom of the band a particle on the lattice has mass 1/2,
and so the packet swings, but the band has a top, and it falls apart. The Hamiltonian is a sum over
the axes, so a product of packets stays a product of states on chains; the reference is that
of one by Taylor series in 40 digits (``tools/quantum_references.py``).
"""

from typing import Any

from liouville.problems import lattice2d
from liouville.problems.lattice2d import chain as chain
from liouville.problems.lattice2d import packet as packet

#: Number of sites along each axis.
SITES = 16

system = lattice2d.build(SITES, 3)
start: dict[str, Any] = lattice2d.start_for(SITES, 3)
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
