r"""Watt's governor, without units: two arms with balls on a spindle, and a sleeve that they lift.

Arms hang at (e, H) and (-e, H) on the spindle, which turns about the vertical. Each has its centre
of mass at l along it, and at s a rod without mass of length r that ends at the sleeve, which slides
on the spindle and has a spring of stiffness k. With c the angle of the arms from the vertical,

.. math::

    L &= \sum_k \left( \tfrac12 m_k |\dot x_k|^2 + \tfrac12 \Omega_k^T J_k \Omega_k
        - m_k g z_k \right) - \tfrac12 k (z - z_0)^2, \\
    z &= H - s \cos c - \sqrt{r^2 - s^2 \sin^2 c}

for the sleeve's height z. The model has 28 coordinates and 26 constraints; the two freedoms are
the turn of the spindle and c, which swings as the spindle speeds up and slows down. It starts with
c = 0.5 at rest and the spindle at 6.

A mechanism of textbooks, here between bodies and rods. The reference is from the equations of c and
of the angle of the spindle, extrapolation in 32 digits (``tools/mechanism_references.py``).
"""

from typing import Any

import numpy as np

from liouville.bodies import Assembly
from liouville.bodies import rotations as rot

OFFSET, HEIGHT, ARM, LEVER, ROD = 0.1, 1.0, 0.6, 0.35, 0.4
ANGLE = 0.5
#: Mass and moments of inertia of the spindle, an arm and the sleeve.
SPINDLE = (1.0, (0.1, 0.1, 0.02))
BALL = (1.0, (0.02, 0.02, 0.004))
SLEEVE = (0.8, (0.005, 0.005, 0.008))


def build() -> Assembly:
    """Return the governor with its arms at rest."""
    m = Assembly(gravity=lambda params: (0.0, 0.0, -params.g))
    z, y = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    down = np.sqrt(ROD**2 - (LEVER * np.sin(ANGLE)) ** 2)
    low = HEIGHT - LEVER * np.cos(ANGLE) - down
    m.body("spindle", mass=SPINDLE[0], inertia=SPINDLE[1], at=(0.0, 0.0, HEIGHT / 2))
    m.body("sleeve", mass=SLEEVE[0], inertia=SLEEVE[1], at=(0.0, 0.0, low))
    m.revolute("spindle bearing", m.ground, "spindle", at=(0.0, 0.0, 0.0), axis=z)
    m.prismatic("slide", "spindle", "sleeve", axis=z, spring=lambda params: params.k)
    for name, side in (("right", 1.0), ("left", -1.0)):
        hook = np.array([side * OFFSET, 0.0, HEIGHT])
        along = np.array([side * np.sin(ANGLE), 0.0, -np.cos(ANGLE)])
        turn = rot.of_frame(np.cross(y, along), along)
        place = hook + ARM * along
        m.body(name, mass=BALL[0], inertia=BALL[1], at=place, rotation=turn)
        m.revolute(f"{name} hinge", "spindle", name, at=hook, axis=y)
        ends = (hook + LEVER * along, (side * OFFSET, 0.0, low))
        m.distance(f"{name} rod", name, "sleeve", at=ends)
    return m


assembly = build()
system = assembly.system(params={"g": 9.81, "k": 40.0})
drawn = assembly.start(rates={"spindle bearing": 6.0, "right hinge": 0.0, "left hinge": 0.0})
start: dict[str, Any] = system.consistent(q=drawn["q"], v=drawn["v"])
interval = (0.0, 2.0)
h = 0.02
conserved = ("energy",)
reference = {
    1.0: {
        "q": (
            0.0,
            0.0,
            0.5,
            -0.760813374900984356429,
            0.0,
            0.0,
            0.648970730134860725459,
            0.0,
            0.0,
            0.380515941348233825128,
            -0.760813374900984356429,
            0.0,
            0.0,
            0.648970730134860725459,
            0.0727187832664139491996,
            -0.455428085903731210133,
            0.520900160031430137874,
            -0.24149100206802745892,
            -0.61541106529869054221,
            -0.721470087632471240102,
            0.2059908475629562345,
            -0.0727187832664139491996,
            0.455428085903731210133,
            0.520900160031430137874,
            -0.24149100206802745892,
            0.61541106529869054221,
            0.721470087632471240102,
            0.2059908475629562345,
        ),
        "v": (
            0.0,
            0.0,
            0.0,
            -1.41555257499664768705,
            0.0,
            0.0,
            -1.65950678809378044199,
            0.0,
            0.0,
            0.321834723537832184327,
            -1.41555257499664768705,
            0.0,
            0.0,
            -1.65950678809378044199,
            2.05011550814184192199,
            -0.079403143623377483211,
            0.30281443747655497673,
            -0.751739897447513135256,
            1.6600377384990997547,
            -1.24112271063413849741,
            -0.268777664164409090112,
            -2.05011550814184192199,
            0.079403143623377483211,
            0.30281443747655497673,
            -0.751739897447513135256,
            -1.6600377384990997547,
            1.24112271063413849741,
            -0.268777664164409090112,
        ),
    },
    2.0: {
        "q": (
            0.0,
            0.0,
            0.5,
            0.00527499161000054102499,
            0.0,
            0.0,
            -0.999986087134973305325,
            0.0,
            0.0,
            0.406327805258924273607,
            0.00527499161000054102499,
            0.0,
            0.0,
            -0.999986087134973305325,
            -0.49141897324059708779,
            -0.00518467832387124139787,
            0.54528055198728465015,
            0.00183541759552761007835,
            0.937501155500724625353,
            0.00494537953403009769817,
            -0.347942176084361134522,
            0.49141897324059708779,
            0.00518467832387124139787,
            0.54528055198728465015,
            0.00183541759552761007835,
            -0.937501155500724625353,
            -0.00494537953403009769817,
            -0.347942176084361134522,
        ),
        "v": (
            0.0,
            0.0,
            0.0,
            1.93690556074321047766,
            0.0,
            0.0,
            0.0102173027342377068761,
            0.0,
            0.0,
            -0.158337161283617091531,
            1.93690556074321047766,
            0.0,
            0.0,
            0.0102173027342377068761,
            0.19450423325232550467,
            -1.90185057014892310214,
            -0.150157790313041031756,
            0.672991994761076849864,
            0.0571559900656309718729,
            1.81622849604235423296,
            0.183366581282551355214,
            -0.19450423325232550467,
            1.90185057014892310214,
            -0.150157790313041031756,
            0.672991994761076849864,
            -0.0571559900656309718729,
            -1.81622849604235423296,
            0.183366581282551355214,
        ),
    },
}
source = "its two angles extrapolated in 32-digit arithmetic"
