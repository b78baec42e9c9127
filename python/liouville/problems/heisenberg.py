r"""A chain of spins one half with exchange between neighbours, in a field; no units.

.. math::

    H = \sum_i S^x_i S^x_{i+1} + S^y_i S^y_{i+1} + \Delta S^z_i S^z_{i+1} + \sum_i h_i S^z_i

The system has 8 spins, :math:`\Delta = 1` and :math:`h_i = \cos(i + 1)`, and starts in Neel's
state, every other spin down: it lives in the sector of four spins up, which has 70 states.

W. Heisenberg, Z. Phys. 49 (1928) 619-636. The references are by Taylor series in 40 digits
(``tools/quantum_references.py``).
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._systems import Schrodinger, SpinChain


def build(
    length: int, delta: float = 1.0, field: ArrayLike = 0.0, up: int | None = None
) -> Schrodinger:
    r"""Make the system of a chain.

    Parameters
    ----------
    length : int
        Number of spins.
    delta : float, default 1.0
        The anisotropy :math:`\Delta`.
    field : float or array_like, default 0.0
        The field of all spins or of each.
    up : int, optional
        Number of spins that are up, half of them by default.

    Returns
    -------
    Schrodinger
    """
    half = length - length // 2
    return Schrodinger(SpinChain(length, z=delta, field=field, up=half if up is None else up))


def start_for(length: int) -> dict[str, Any]:
    """Start with every other spin up, where half of them are, the first one down."""
    chain = SpinChain(length, up=length // 2)
    psi = np.zeros(chain.size)
    psi[chain.index(sum(1 << i for i in range(0, length, 2)))] = 1.0
    return {"psi": psi}


system = build(8, field=np.cos(np.arange(1, 9)), up=4)
start: dict[str, Any] = start_for(8)
interval = (0.0, 5.0)
tol = 1e-10
conserved = ("norm", "energy")
chain = system.source
reference = {
    5.0: {
        "psi": {
            chain.index(85): complex(-0.028515343217815055239, -0.38778850225565067552),
            chain.index(170): complex(-0.00039381103247419890131, 0.093534307928467047365),
        },
        "z component of spin 0": -0.27582791127408456057,
        "energy": -2.1714972268216134848,
    }
}
source = "Taylor series in 40-digit arithmetic"
