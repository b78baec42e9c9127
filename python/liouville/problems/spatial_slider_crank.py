r"""A slider-crank in space: a crank, a rod on a ball joint, and a slider that runs across its axis.

The crank of 0.08 m turns about x at (0, 0.1, 0.12). The rod of 0.3 m has a ball joint at its end
and a universal one, about z and across the rod, on the slider that moves along x:

.. math::

    L = \sum_k \left( \tfrac12 m_k |\dot x_k|^2 + \tfrac12 \Omega_k^T J_k \Omega_k
        - m_k g z_k \right)

in kg, m, s. Each body has its centre of mass and a unit quaternion, 21 coordinates with 20
constraints, those of the quaternions among them. The crank starts upright with 6 rad/s and turns
freely; two seconds are two turns and a half.

Mechanism and data: E. J. Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems, Boston
(1989), but for the rod, which is as stiff to turn both ways across. The reference is the crank's
angle, t = int sqrt(I(a) / (2 (E - V(a)))) da, extrapolated in 32 digits
(``tools/mechanism_references.py``).
"""

import numpy as np

from liouville.bodies import Assembly
from liouville.bodies import rotations as rot

CRANK, ROD = 0.08, 0.3
CENTRE = (0.0, 0.1, 0.12)
MASSES = (0.12, 0.5, 2.0)
INERTIAS = ((1e-4, 1e-5, 1e-4), (4e-3, 4e-3, 4e-4), (1e-4, 1e-4, 1e-4))


def build() -> Assembly:
    """Return the mechanism with the crank upright."""
    m = Assembly(gravity=lambda params: (0.0, 0.0, -params.g))
    centre = np.array(CENTRE)
    pin = centre + np.array([0.0, 0.0, CRANK])
    place = np.array([np.sqrt(ROD**2 - pin[1] ** 2 - pin[2] ** 2), 0.0, 0.0])
    along = (pin - place) / ROD
    across = np.cross(along, (0.0, 0.0, 1.0))
    second = across / np.linalg.norm(across)
    turn = rot.of_frame(np.cross(second, along), along)
    still = 1.0, 0.0, 0.0, 0.0
    places = (centre + pin) / 2, (pin + place) / 2, place
    turns = still, turn, still
    for k, name in enumerate(("crank", "rod", "slider")):
        m.body(name, mass=MASSES[k], inertia=INERTIAS[k], at=places[k], rotation=turns[k])
    m.revolute("A", m.ground, "crank", at=centre, axis=(1.0, 0.0, 0.0))
    m.spherical("B", "crank", "rod", at=pin)
    m.universal("C", "slider", "rod", at=place, axes=((0.0, 0.0, 1.0), second))
    m.prismatic("D", m.ground, "slider", axis=(1.0, 0.0, 0.0))
    return m


assembly = build()
system = assembly.system(params={"g": 9.81})
drawn = assembly.start(rates={"A": 6.0})
start = system.consistent(q=drawn["q"], v=drawn["v"])
interval = (0.0, 2.0)
h = 0.0025
conserved = ("energy",)
reference = {
    1.0: {
        "q": (
            0.0,
            0.139999976817318821821,
            0.119956934770907174032,
            0.706726032233382270079,
            -0.70748732523180959429,
            0.0,
            0.0,
            0.103947920353219462252,
            0.0899999768173188218214,
            0.0599569347709071740319,
            0.783885357797249886794,
            -0.19135446257562980953,
            -0.513348829175673336188,
            -0.292198896417208894432,
            0.207895840706438924504,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
        ),
        "v": (
            0.0,
            0.000452141601043208277977,
            0.41995953442835742032,
            3.71395274896349531028,
            3.70995634348252161575,
            0.0,
            0.0,
            -0.242623219974525342535,
            0.000452141601043208277977,
            0.41995953442835742032,
            0.614857758936569915757,
            0.149131764643737549423,
            1.3078738872013272319,
            -0.745911657075481884321,
            -0.48524643994905068507,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ),
    },
    2.0: {
        "q": (
            0.0,
            0.0783492369032966196597,
            0.086366022279093615173,
            -0.282090904654280177064,
            -0.95938768050842189785,
            0.0,
            0.0,
            0.144917747830205752937,
            0.0283492369032966196597,
            0.026366022279093615173,
            0.763163694002805518009,
            -0.0619116561013807065355,
            -0.638968078943285177438,
            -0.0739453655498725329165,
            0.289835495660411505873,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
        ),
        "v": (
            0.0,
            0.918135695565378719552,
            -0.591019551724234771255,
            13.0946164421838974147,
            -3.85023934883020524449,
            0.0,
            0.0,
            -0.0720795888096021835288,
            0.918135695565378719552,
            -0.591019551724234771255,
            -1.50779152323118425994,
            -2.12742828608475276759,
            -1.33546573905512683926,
            -2.24029134505313353465,
            -0.144159177619204367058,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ),
    },
}
source = "mechanism of Haug (1989); its angle extrapolated in 32-digit arithmetic"
