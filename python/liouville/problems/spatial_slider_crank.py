r"""A slider-crank in space: a crank, a rod on a ball joint, and a slider that runs across its axis.

The crank of 0.08 m turns about x at (0, 0.1, 0.12). The rod of 0.3 m has a ball joint at its end
and a universal one, about x and across the rod, on the slider that moves along x:

.. math::

    L = \sum_k \left( \tfrac12 m_k |\dot x_k|^2 + \tfrac12 \Omega_k^T J_k \Omega_k
        - m_k g z_k \right)

in kg, m, s. Each body has its centre of mass and a unit quaternion, 21 coordinates with 20
constraints, those of the quaternions among them. The crank starts upright with 6 rad/s and turns
freely; two seconds are three turns and a third.

It is the spatial rigid slider-crank of the IFToMM library of computational benchmark problems,
after E. J. Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems, Boston (1989).
Lengths, masses, moments and the speed at first are those of Exudyn's model of it
(``TestModels/sliderCrank3Dbenchmark.py``) and of MBDyn's (``tests/benchmarks/srskm``), which has
the crank's centre of mass in its bearing. Solutions of the library are printed with Exudyn
(``docs/verification/Slidercrank3DiftommBenchmark``): F. Gonzalez has the slider at 0.184952803,
0.211754668 and 0.289063554 after 0.5, 1 and 2 s, which is this motion to 4e-5. B. Masoudi has the
crank's angle 5.278250602 after 0.501672241 s and 51.50682085 after 5 s. This is the motion to 3e-4
where the rod's small moment is not about its length but across it and its second pin, which is
``build(rod=(4e-4, 4e-3, 4e-3))``.

The reference is the crank's angle, t = int sqrt(I(a) / (2 (E - V(a)))) da, extrapolated in 32
digits (``tools/mechanism_references.py``).
"""

from typing import Any

import numpy as np

from liouville.bodies import Assembly
from liouville.bodies import rotations as rot

CRANK, ROD = 0.08, 0.3
CENTRE = (0.0, 0.1, 0.12)
MASSES = (0.12, 0.5, 2.0)
INERTIAS = ((1e-4, 1e-4, 1e-5), (4e-3, 4e-3, 4e-4), (1e-4, 1e-4, 1e-4))


def build(rod: tuple[float, ...] = INERTIAS[1]) -> Assembly:
    """Return the mechanism with the crank upright.

    Parameters
    ----------
    rod : tuple of three float
        Moments of inertia of the rod: across it and its second pin, about that pin, about its
        length.

    Returns
    -------
    Assembly
    """
    m = Assembly(gravity=lambda params: (0.0, 0.0, -params.g))
    centre = np.array(CENTRE)
    pin = centre + np.array([0.0, 0.0, CRANK])
    place = np.array([np.sqrt(ROD**2 - pin[1] ** 2 - pin[2] ** 2), 0.0, 0.0])
    along = (pin - place) / ROD
    across = np.cross(along, (1.0, 0.0, 0.0))
    second = across / np.linalg.norm(across)
    turn = rot.of_frame(np.cross(second, along), along)
    still = 1.0, 0.0, 0.0, 0.0
    places = (centre + pin) / 2, (pin + place) / 2, place
    turns = still, turn, still
    moments = INERTIAS[0], rod, INERTIAS[2]
    for k, name in enumerate(("crank", "rod", "slider")):
        m.body(name, mass=MASSES[k], inertia=moments[k], at=places[k], rotation=turns[k])
    m.revolute("A", m.ground, "crank", at=centre, axis=(1.0, 0.0, 0.0))
    m.spherical("B", "crank", "rod", at=pin)
    m.universal("C", "slider", "rod", at=place, axes=((1.0, 0.0, 0.0), second))
    m.prismatic("D", m.ground, "slider", axis=(1.0, 0.0, 0.0))
    return m


assembly = build()
system = assembly.system(params={"g": 9.81})
drawn = assembly.start(rates={"A": 6.0})
start: dict[str, Any] = system.consistent(q=drawn["q"], v=drawn["v"])
interval = (0.0, 2.0)
h = 0.0025
conserved = ("energy",)
reference = {
    1.0: {
        "q": (
            0.0,
            0.1398656492016778279809905,
            0.1167243300336016821822884,
            0.6775353314920344633928084,
            -0.7354902273857749720803375,
            0.0,
            0.0,
            0.1058608306967218887977968,
            0.08986564920167782798099053,
            0.05672433003360168218228844,
            0.8093833711965380491398563,
            -0.4462449813625768994503699,
            -0.334341616459434777886915,
            0.1843357223723408114349883,
            0.2117216613934437775955936,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
        ),
        "v": (
            0.0,
            0.03415735321327506849579017,
            0.4157027645722978823245261,
            3.834696373479686466902288,
            3.532531340099097721156588,
            0.0,
            0.0,
            -0.2517459324625050153283513,
            0.03415735321327506849579017,
            0.4157027645722978823245261,
            1.095793378814931864755154,
            1.050900442135627627054927,
            0.6696112051795854057042603,
            -1.05285614545304200651348,
            -0.5034918649250100306567026,
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
            0.06821465000100614909358801,
            0.095716435075519459426992,
            -0.4432329392587979159310897,
            -0.896406471170309410971217,
            0.0,
            0.0,
            0.1445425985335708912424013,
            0.01821465000100614909358801,
            0.035716435075519459426992,
            0.7739893615769389381433832,
            -0.1859659268360636315677333,
            -0.5885251825291242060951883,
            0.1414045676447099189833775,
            0.2890851970671417824848026,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
        ),
        "v": (
            0.0,
            0.548425858985921996710623,
            -0.7178479737459416887628383,
            10.12232945370627742939626,
            -5.005039544231190872451964,
            0.0,
            0.0,
            0.1082697117267176483824965,
            0.548425858985921996710623,
            -0.7178479737459416887628383,
            -2.684064676329910008893628,
            -7.672812380611438534563707,
            0.3916032534625744437219559,
            6.230521618657138053971079,
            0.216539423453435296764993,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ),
    },
}
source = "IFToMM multibody benchmark (spatial slider-crank); its angle extrapolated in 32 digits"
