r"""Bricard's mechanism: five bars and the ground in a loop of six hinges, mobile against the count.

Bars of length 1 m, 1 kg and radius r, each by its centre x and the directors a (along its axis), b
and c. A bar's first hinge has the direction c, its second b, a right angle apart. The ground is the
sixth bar, along x with its hinges along z and y. It starts along six edges of a cube, all angles
right. The five joints and the closing one are 30 constraints, rigidity is 30 more, on 60
coordinates; their rank is 59: one is redundant, and one freedom is left.

With equal angles at every second hinge, p at the ground's first, the loop closes where
:math:`\cos p + \cos s + \cos p \cos s = 0`. Gravity is along -y. It starts with p = 90 degrees
and -3 rad/s.

The mechanism and its place among tests: M. González, D. Dopico, U. Lugrís, J. Cuadrado, Multibody
Syst. Dyn. 16 (2006) 179-190; here bars have a radius, and it starts in motion. The reference has
one degree of freedom, the angle p by a quadrature in 30 digits (``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters
from liouville.problems._directors import coordinates, ends, frames, hinge, kinetic, rigid, row

BARS = 5
RADIUS = 0.1


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of the five bars less the potential of gravity."""
    height = sum(x[1] for x, *_ in frames(q))
    return kinetic(v, [(1.0, 1.0, RADIUS)] * BARS) - params.g * height


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Join each bar to the one before, the last to the ground, and keep the bars rigid."""
    x, y, z = (ca.SX(ca.DM(np.eye(3)[k])) for k in range(3))
    before = (x / 2, x, y, z)
    found: dict[str, ca.SX] = {}
    for k, bar in enumerate(frames(q), start=1):
        points = (bar[0] - bar[1] / 2, before[0] + before[1] / 2)
        found |= hinge(f"joint{k}", points, bar[3], (before[1], before[3]))
        before = bar
    closing = (before[0] + before[1] / 2, ca.SX(3, 1))
    return {**found, **hinge("joint6", closing, z, (before[1], before[3])), **rigid(q)}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the bars, and the ground as the last."""
    return [*(ends(q, bar, 1.0) for bar in range(BARS)), np.array([(0.0, 0, 0), (1.0, 0, 0)])]


def turn(axis: int, angle: float) -> NDArray[np.float64]:
    """Return the matrix of a turn about x (0) or z (2)."""
    c, s = np.cos(angle), np.sin(angle)
    if axis == 0:
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def bars(angle: float) -> NDArray[np.float64]:
    """Return x, a, b and c of all bars, shape (5, 4, 3), from the ground's first angle."""
    other = np.arccos(-np.cos(angle) / (1 + np.cos(angle)))
    place, found = np.array([1.0, 0.0, 0.0]), []
    attitude = turn(0, np.pi / 2)
    for k in range(1, BARS + 1):
        attitude = attitude @ turn(2, other if k % 2 else angle)
        a = attitude[:, 0]
        found.append([place + a / 2, *attitude.T])
        place = place + a
        attitude = attitude @ turn(0, -np.pi / 2 if k % 2 else np.pi / 2)
    return np.array(found)


def start_for(angle: float, rate: float) -> dict[str, Any]:
    """Return the start with the ground's first angle and its rate, in radians and seconds."""
    # differences of order 8, whose error is below roundoff
    h, weights = 1e-2, (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    slope = np.zeros((BARS, 4, 3))
    for k, weight in enumerate(weights, start=1):
        slope += weight * (bars(angle + k * h) - bars(angle - k * h)) / h
    q, v = (row(*values.reshape(-1, 3)) for values in (bars(angle), rate * slope))
    return {name: tuple(x.tolist()) for name, x in system.consistent(q=q, v=v).items()}


system = Lagrangian(lagrangian, constraint, q=coordinates(BARS), params={"g": 9.81})
# along the edges of a cube all of it is in halves, which no processor rounds
start: dict[str, Any] = {
    name: tuple((np.round(2 * np.array(x)) / 2 + 0.0).tolist())
    for name, x in start_for(np.pi / 2, -3.0).items()
}
interval = (0.0, 0.4)
h = 0.005
conserved = ("energy",)
reference = {
    0.2: {
        "q": (
            0.78509248444788659940,
            0.0,
            0.45145848065931615285,
            -0.4298150311042268011,
            0.0,
            0.90291696131863230571,
            -0.9029169613186323057,
            0.0,
            -0.4298150311042268011,
            0.0,
            -1.0,
            0.0,
            0.40818406476732964047,
            0.32854230043314840051,
            1.24323396631200858466,
            -0.3240018082568871166,
            0.65708460086629680102,
            0.68063400998675255789,
            0.28242483815945581245,
            0.75381683936111391785,
            -0.5932928311434630563,
            -0.9029169613186323057,
            0.0,
            -0.4298150311042268011,
            -0.0918159352326703595,
            0.51587218178656889480,
            1.24323396631200858466,
            -0.6759981917431128833,
            -0.2824248381594558124,
            -0.6806340099867525578,
            0.68063400998675255789,
            -0.5932928311434630563,
            -0.4298150311042268011,
            -0.2824248381594558124,
            -0.7538168393611139178,
            0.59329283114346305633,
            -0.5918159352326703595,
            0.51587218178656889480,
            0.45145848065931615285,
            -0.3240018082568871166,
            0.28242483815945581245,
            -0.9029169613186323057,
            0.65708460086629680102,
            0.75381683936111391785,
            0.0,
            0.68063400998675255789,
            -0.5932928311434630563,
            -0.4298150311042268011,
            -0.3769084196805569589,
            0.32854230043314840051,
            0.0,
            0.75381683936111391785,
            -0.6570846008662968010,
            0.0,
            0.0,
            0.0,
            1.0,
            -0.6570846008662968010,
            -0.7538168393611139178,
            0.0,
        ),
        "v": (
            -0.6133547286910336634,
            0.0,
            -0.2919748914731358025,
            -1.2267094573820673269,
            0.0,
            -0.5839497829462716051,
            0.58394978294627160512,
            0.0,
            -1.2267094573820673269,
            0.0,
            0.0,
            0.0,
            -2.4999562884679218581,
            -2.1643362560160501553,
            0.89939917476338484551,
            -2.5464936621717090623,
            -4.3286725120321003106,
            2.96669791541931290126,
            -1.0544766162162815219,
            3.77320311955377638929,
            4.29213624116072637819,
            0.58394978294627160512,
            0.0,
            -1.2267094573820673269,
            -2.4999562884679218581,
            -3.8014342039239595496,
            0.89939917476338484551,
            2.54649366217170906230,
            1.05447661621628152191,
            -2.9666979154193129012,
            2.96669791541931290126,
            4.29213624116072637819,
            -1.2267094573820673269,
            1.05447661621628152191,
            -3.7732031195537763892,
            -4.2921362411607263781,
            -2.4999562884679218581,
            -3.8014342039239595496,
            -0.2919748914731358025,
            -2.5464936621717090623,
            -1.0544766162162815219,
            0.58394978294627160512,
            -4.3286725120321003106,
            3.77320311955377638929,
            0.0,
            2.96669791541931290126,
            4.29213624116072637819,
            -1.2267094573820673269,
            -1.8866015597768881946,
            -2.1643362560160501553,
            0.0,
            3.77320311955377638929,
            4.32867251203210031062,
            0.0,
            0.0,
            0.0,
            0.0,
            4.32867251203210031062,
            -3.7732031195537763892,
            0.0,
        ),
    },
}
source = "mechanism of González et al. (2006); quadrature in 30-digit arithmetic"
