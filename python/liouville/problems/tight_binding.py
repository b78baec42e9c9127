r"""A particle that hops on a chain, and in two dimensions with disorder; no units.

.. math::

    (H \psi)_j = V_j \psi_j - \sum_{k \text{ next to } j} \psi_k

The clean chain of 50 sites, V = 0, is the system: from a site in the middle the particle spreads
with velocity 2 and is reflected at the ends. The energies lie between :math:`\pm 2 \cos(\pi/51)`.
With disorder the :math:`V_j` are spread evenly over [-W/2, W/2]; in two dimensions every state is
then localised. ``disordered`` is a square of 16 by 16 sites with W = 4.

P. W. Anderson, Phys. Rev. 109 (1958) 1492-1505. The references are by Taylor series in 40 digits
(``tools/quantum_references.py``).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lattice, Schrodinger


def disorder(sites: int, width: float) -> NDArray[np.float64]:
    """Return energies of the sites, the same on every machine: a linear congruential generator."""
    state, found = 1, np.empty(sites)
    for j in range(sites):
        state = (1103515245 * state + 12345) % 2**31
        found[j] = width * (state / 2**31 - 0.5)
    return found


def build(shape: int | tuple[int, ...], width: float = 0.0, periodic: bool = False) -> Schrodinger:
    """Make the system of a lattice.

    Parameters
    ----------
    shape : int or tuple of int
        Number of sites along each axis.
    width : float, default 0.0
        Width W of the disorder.
    periodic : bool, default False
        Whether the ends of the axes are neighbours.

    Returns
    -------
    Schrodinger
    """
    sites = int(np.prod(shape))
    potential = disorder(sites, width) if width else None
    return Schrodinger(Lattice(shape, potential=potential, periodic=periodic))


def start_for(shape: int | tuple[int, ...]) -> dict[str, Any]:
    """Start on the site in the middle, of two the first."""
    along = shape if isinstance(shape, tuple) else (shape,)
    psi = np.zeros(along)
    psi[tuple((n - 1) // 2 for n in along)] = 1.0
    return {"psi": psi.ravel()}


system = build(50)
start: dict[str, Any] = start_for(50)
disordered = build((16, 16), width=4.0)
disordered_start = start_for((16, 16))
interval = (0.0, 10.0)
tol = 1e-10
conserved = ("norm", "energy")
reference = {
    10.0: {
        "psi": {
            0: complex(0.024452914481425112298, 0.0),
            9: complex(0.0, 0.00081260483925030351563),
            19: complex(0.0, 0.15116976798149382997),
            24: complex(0.16702466434058358168, 0.0),
            29: complex(0.0, 0.15116976798244091135),
            43: complex(0.0, -0.21886719276425369212),
        }
    }
}
disordered_reference = {
    10.0: {
        "psi": {
            55: complex(-0.082127545746313778006, -0.10264516637052826856),
            118: complex(-0.1298208428147013357, 0.065665305022029308997),
            119: complex(0.051853396292239092602, -0.16712005241511888656),
            121: complex(0.021334531785659354571, -0.12880472891049201237),
            137: complex(-0.13877907294031648775, 0.10769743628499440165),
            151: complex(0.074163737911258549926, -0.12329059656493512352),
        }
    }
}
source = "Taylor series in 40-digit arithmetic"
