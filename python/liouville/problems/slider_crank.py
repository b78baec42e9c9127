r"""A slider-crank mechanism turning freely: crank angle, rod angle and slider position.

Uniform crank (length l1, mass m1, inertia j1 about its centre) turning about the origin, uniform
rod (l2, m2, j2) from its pin to a slider (m3) on the x-axis; with r the rod's centre,

.. math::

    L &= \tfrac12 (j_1 + \tfrac14 m_1 l_1^2)\, \dot a^2 + \tfrac12 j_2 \dot b^2
         + \tfrac12 m_2 |\dot r|^2 + \tfrac12 m_3 \dot s^2
         - g (\tfrac12 m_1 l_1 \sin a + m_2 r_y), \\
    r &= (l_1 \cos a + \tfrac12 l_2 \cos b,\; l_1 \sin a + \tfrac12 l_2 \sin b), \\
    0 &= l_1 \cos a + l_2 \cos b - s, \qquad 0 = l_1 \sin a + l_2 \sin b

in kg, m, s, rad, so the mass matrix depends on the angles. It starts stretched along the axis with
the crank at 150 rad/s, enough for full turns; as l2 > l1 no configuration is singular. 0.1 s are
one turn and a half.

Data: P. Flores, R. Leine, C. Glocker, Multibody Syst. Dyn. 23 (2010) 165-190, without their
clearance. The reference is a quadrature in 45 digits, t = int sqrt(I(a) / (2 (E - V(a)))) da,
solved for the crank's angle a (``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of the three bodies less the potential of gravity; y points up."""
    a, b = q[0], q[1]
    l1, l2, m2 = params.l1, params.l2, params.m2
    crank = (params.j1 + params.m1 * l1**2 / 4) * v[0] ** 2
    rod_x = -l1 * ca.sin(a) * v[0] - l2 / 2 * ca.sin(b) * v[1]
    rod_y = l1 * ca.cos(a) * v[0] + l2 / 2 * ca.cos(b) * v[1]
    rod = params.j2 * v[1] ** 2 + m2 * (rod_x**2 + rod_y**2)
    slider = params.m3 * v[2] ** 2
    height = params.m1 * l1 / 2 * ca.sin(a) + m2 * (l1 * ca.sin(a) + l2 / 2 * ca.sin(b))
    return (crank + rod + slider) / 2 - params.g * height


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Pin the rod's far end to the slider, and the slider to the x-axis."""
    return {
        "pin": params.l1 * ca.cos(q[0]) + params.l2 * ca.cos(q[1]) - q[2],
        "guide": params.l1 * ca.sin(q[0]) + params.l2 * ca.sin(q[1]),
    }


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the crank with the rod, and the slider as a box."""
    l1 = params.l1
    crank_pin = (l1 * np.cos(q[0]), l1 * np.sin(q[0]))
    wrist = np.array([q[2], 0.0])
    box = 0.1 * l1 * np.array([(-2, -1), (2, -1), (2, 1), (-2, 1), (-2, -1)])
    return [np.array([(0.0, 0.0), crank_pin, wrist]), wrist + box]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("crank", "rod", "slider"),
    params={
        "l1": 0.153,
        "l2": 0.306,
        "m1": 0.038,
        "m2": 0.038,
        "m3": 0.076,
        "j1": 7.4e-5,
        "j2": 5.9e-4,
        "g": 9.81,
    },
)
start: dict[str, Any] = {"q": (0.0, 0.0, 0.459), "v": (150.0, -75.0, 0.0)}
interval = (0.0, 0.1)
h = 2.5e-4
conserved = ("energy",)
reference = {
    0.05: {
        "q": (4.80923813522695401925, 0.520895294848000433949, 0.280211203977471418493),
        "v": (68.7495094225281418031, -3.83221540552909922825, 11.0529634660162902928),
    },
    0.1: {
        "q": (9.14015241694162831171, -0.140864435419984918584, 0.156124739498743733462),
        "v": (144.406332089062999687, 69.9914719393898474957, -3.19701913171789726876),
    },
}
source = "data of Flores, Leine and Glocker (2010), ideal joints; quadrature in 45-digit arithmetic"
