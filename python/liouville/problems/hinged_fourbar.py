r"""A planar four-bar of bodies in space, whose four hinges constrain more than the plane needs.

Three cylinders of lengths l, masses m and radius r, each by its centre x and the directors a (along
its axis), b and c; all hinges have the direction z. With d the second hinge of the ground,

.. math::

    0 &= x_1 - \tfrac12 l_1 a_1, \quad 0 = x_1 + \tfrac12 l_1 a_1 - x_2 + \tfrac12 l_2 a_2, \\
    0 &= x_2 + \tfrac12 l_2 a_2 - x_3 - \tfrac12 l_3 a_3, \quad 0 = x_3 - \tfrac12 l_3 a_3 - d,

with :math:`c_1, c_2, c_3` normal to two directions of the body, or of the ground, before each, and
six constraints that keep the directors of each body orthonormal. These are 38 constraints on 36
coordinates, of rank 35: one freedom is left, and three constraints are redundant.

Gravity is along -y. The crank starts at 1 rad with 6 rad/s, enough for full turns.

The reference has one degree of freedom, the crank's angle by a quadrature in 30 digits
(``tools/references.py``), and shares no equation with the model.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters
from liouville.problems._directors import coordinates, ends, frames, hinge, kinetic, rigid, row

LENGTHS = (0.5, 1.0, 0.9)
MASSES = (1.0, 2.0, 1.8)
RADIUS = 0.1
GROUND = (1.1, 0.0, 0.0)


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of the three cylinders less the potential of gravity."""
    rods = list(zip(MASSES, LENGTHS, (RADIUS,) * 3, strict=True))
    height = sum(m * x[1] for m, (x, *_) in zip(MASSES, frames(q), strict=True))
    return kinetic(v, rods) - params.g * height


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Join the bodies and the ground by hinges of direction z, and keep the bodies rigid."""
    bodies = frames(q)
    one, two, three = bodies
    halves = [length / 2 * a for (_, a, _, _), length in zip(bodies, LENGTHS, strict=True)]
    z, ground = ca.SX([0, 0, 1]), ca.SX(GROUND)
    return {
        **hinge("A", (one[0] - halves[0], ca.SX(3, 1)), z, one[1:3]),
        **hinge("B", (two[0] - halves[1], one[0] + halves[0]), one[3], two[1:3]),
        **hinge("C", (three[0] + halves[2], two[0] + halves[1]), two[3], three[1:3]),
        **hinge("D", (three[0] - halves[2], ground), z, three[1:3]),
        **rigid(q),
    }


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the three bodies, seen along the hinges."""
    return [ends(q, body, length)[:, :2] for body, length in enumerate(LENGTHS)]


def start_for(angle: float, rate: float) -> dict[str, Any]:
    """Return the start with the crank at an angle and turning at a rate, in radians and seconds."""
    l1, l2, l3 = LENGTHS
    pin = l1 * np.exp(1j * angle)
    across = GROUND[0] - pin
    gap = abs(across)
    # the triangle of coupler and rocker on the diagonal, coupler above
    lift = np.arccos((l2**2 + gap**2 - l3**2) / (2 * l2 * gap))
    coupler = across / gap * np.exp(1j * lift)
    rocker = (pin + l2 * coupler - GROUND[0]) / l3
    crank = np.exp(1j * angle)
    # the velocity of the pin between coupler and rocker: l1 w1 e1 + l2 w2 e2 = l3 w3 e3
    columns = l2 * coupler, -l3 * rocker
    matrix = [[z.real for z in columns], [z.imag for z in columns]]
    wanted = -l1 * rate * crank
    rates = (rate, *np.linalg.solve(matrix, [wanted.real, wanted.imag]))
    centres = (l1 / 2 * crank, pin + l2 / 2 * coupler, GROUND[0] + l3 / 2 * rocker)
    moving = (
        l1 / 2 * rate * 1j * crank,
        l1 * rate * 1j * crank + l2 / 2 * rates[1] * 1j * coupler,
        l3 / 2 * rates[2] * 1j * rocker,
    )
    q: list[tuple[float, ...]] = []
    v: list[tuple[float, ...]] = []
    for x, dx, a, w in zip(centres, moving, (crank, coupler, rocker), rates, strict=True):
        b = 1j * a
        q += [(x.real, x.imag, 0), (a.real, a.imag, 0), (b.real, b.imag, 0), (0, 0, 1)]
        da, db = w * b, -w * a
        v += [(dx.real, dx.imag, 0), (da.real, da.imag, 0), (db.real, db.imag, 0), (0, 0, 0)]
    return {"q": row(*q), "v": row(*v)}


system = Lagrangian(lagrangian, constraint, q=coordinates(3), params={"g": 9.81})
start: dict[str, Any] = start_for(1.0, 6.0)
interval = (0.0, 1.0)
h = 0.005
conserved = ("energy",)
reference = {
    0.5: {
        "q": (
            0.01520622052984352299,
            -0.2495371131859903627,
            0.0,
            0.06082488211937409197,
            -0.9981484527439614509,
            0.0,
            0.99814845274396145099,
            0.06082488211937409197,
            0.0,
            0.0,
            0.0,
            1.0,
            0.17745049679920689184,
            -0.0211832239830030619,
            0.0,
            0.29407611147903969171,
            0.95578200477795532706,
            0.0,
            -0.9557820047779553270,
            0.29407611147903969171,
            0.0,
            0.0,
            0.0,
            1.0,
            0.71224427626936336885,
            0.22835388920298730078,
            0.0,
            -0.8616793860680814025,
            0.50745308711774955730,
            0.0,
            -0.5074530871177495573,
            -0.8616793860680814025,
            0.0,
            0.0,
            0.0,
            1.0,
        ),
        "v": (
            3.35057987215272521682,
            0.20417666850555558098,
            0.0,
            13.4023194886109008673,
            0.81670667402222232394,
            0.0,
            -0.8167066740222223239,
            13.4023194886109008673,
            0.0,
            0.0,
            0.0,
            0.0,
            3.96635959090488699138,
            1.24979980782132237860,
            0.0,
            -5.4696003068011268845,
            1.68289294162042243327,
            0.0,
            -1.6828929416204224332,
            -5.4696003068011268845,
            0.0,
            0.0,
            0.0,
            0.0,
            0.61577971875216177455,
            1.04562313931576679762,
            0.0,
            1.36839937500480394345,
            2.32360697625725955027,
            0.0,
            -2.3236069762572595502,
            1.36839937500480394345,
            0.0,
            0.0,
            0.0,
            0.0,
        ),
    },
    1.0: {
        "q": (
            -0.0502578629675929178,
            0.24489619680577044924,
            0.0,
            -0.2010314518703716715,
            0.97958478722308179696,
            0.0,
            -0.9795847872230817969,
            -0.2010314518703716715,
            0.0,
            0.0,
            0.0,
            1.0,
            0.36430288189999155506,
            0.67403045105399106582,
            0.0,
            0.92963721567035478165,
            0.36847611488490033469,
            0.0,
            -0.3684761148849003346,
            0.92963721567035478165,
            0.0,
            0.0,
            0.0,
            1.0,
            0.96456074486758447294,
            0.42913425424822061658,
            0.0,
            -0.3009761225164789490,
            0.95363167610715692574,
            0.0,
            -0.9536316761071569257,
            -0.3009761225164789490,
            0.0,
            0.0,
            0.0,
            1.0,
        ),
        "v": (
            -1.1196680114127487685,
            -0.2297794829840054912,
            0.0,
            -4.4786720456509950742,
            -0.9191179319360219648,
            0.0,
            0.91911793193602196488,
            -4.4786720456509950742,
            0.0,
            0.0,
            0.0,
            0.0,
            -2.1957926216972477781,
            -0.5694156555890681278,
            0.0,
            0.08708680225649951794,
            -0.2197133792421142907,
            0.0,
            0.21971337924211429073,
            0.08708680225649951794,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.0761246102844990095,
            -0.3396361726050626365,
            0.0,
            -2.3913880228544422435,
            -0.7547470502334725257,
            0.0,
            0.75474705023347252575,
            -2.3913880228544422435,
            0.0,
            0.0,
            0.0,
            0.0,
        ),
    },
}
source = "one degree of freedom; quadrature in 30-digit arithmetic"
