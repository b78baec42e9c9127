r"""Andrews' squeezing mechanism: seven bodies in the plane, three closed loops, one spring.

The angles are beta (crank on the motor at O), Theta (rod to the joint P), gamma (the body on B that
the spring pulls), Phi with delta and Omega with epsilon (two pairs of arms on A). The mass matrix
is block diagonal, for the pairs (beta, Theta), gamma, (Phi, delta), (Omega, epsilon):

.. math::

    L = \tfrac12 \dot q^T M(q) \dot q - \tfrac{c_0}2 (|D(\gamma) - C| - l_0)^2 + \mathrm{mom}\,\beta

and all loops meet in P, seen from the crank, from B, and from A on both ways. In kg, m, s, rad; the
motor's constant torque belongs to the potential, so the energy is conserved.

Source: F. Mazzia, C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4 (2008);
after W. Schiehlen, Multibody Systems Handbook (1990). The reference is a Taylor solution in
quadruple precision; the test set's own end state is off by up to 1.4e-9 in the angles and 5e-7 in
the velocities.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters

# fmt: off
PARAMS = {  # lengths, masses, inertias and stiffness by the letters of the test set
    "m1": 0.04325, "m2": 0.00365, "m3": 0.02373, "m4": 0.00706, "m5": 0.0705, "m6": 0.00706,
    "m7": 0.05498, "xa": -0.06934, "ya": -0.00227, "xb": -0.03635, "yb": 0.03273, "xc": 0.014,
    "yc": 0.072, "c0": 4530.0, "i1": 2.194e-06, "i2": 4.41e-07, "i3": 5.255e-06, "i4": 5.667e-07,
    "i5": 1.169e-05, "i6": 5.667e-07, "i7": 1.912e-05, "d": 0.028, "da": 0.0115, "e": 0.02,
    "ea": 0.01421, "rr": 0.007, "ra": 0.00092, "l0": 0.07785, "ss": 0.035, "sa": 0.01874,
    "sb": 0.01043, "sc": 0.018, "sd": 0.02, "ta": 0.02308, "tb": 0.00916, "u": 0.04,
    "ua": 0.01228, "ub": 0.00449, "zf": 0.02, "zt": 0.04, "fa": 0.01421, "mom": 0.033,
}
# fmt: on


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the spring's, plus the motor's work."""
    p = params
    _, theta, gamma, phi, _, omega, _ = ca.vertsplit(q)
    be, th, ga, ph, de, om, ep = ca.vertsplit(v)
    a, b = p.e - p.ea, p.zf - p.fa
    c2, s4, s6 = ca.cos(theta), ca.sin(phi), ca.sin(omega)
    m22 = p.m2 * p.da**2 + p.i2
    m12 = m22 - p.m2 * p.da * p.rr * c2
    m11 = p.m1 * p.ra**2 + p.m2 * (p.rr**2 - 2 * p.da * p.rr * c2) + p.i1 + m22
    m33 = p.m3 * (p.sa**2 + p.sb**2) + p.i3
    m44 = p.m4 * a**2 + p.i4
    m45 = m44 + p.m4 * p.zt * a * s4
    m55 = m44 + p.m4 * (p.zt**2 + 2 * p.zt * a * s4) + p.m5 * (p.ta**2 + p.tb**2) + p.i5
    m66 = p.m6 * b**2 + p.i6
    m67 = m66 - p.m6 * p.u * b * s6
    m77 = m66 + p.m6 * (p.u**2 - 2 * p.u * b * s6) + p.m7 * (p.ua**2 + p.ub**2) + p.i7
    crank_and_rod = m11 * be**2 + 2 * m12 * be * th + m22 * th**2
    left_arms = m44 * ph**2 + 2 * m45 * ph * de + m55 * de**2
    right_arms = m66 * om**2 + 2 * m67 * om * ep + m77 * ep**2
    kinetic = (crank_and_rod + m33 * ga**2 + left_arms + right_arms) / 2
    spring_x = p.xb + p.sc * ca.sin(gamma) + p.sd * ca.cos(gamma) - p.xc
    spring_y = p.yb - p.sc * ca.cos(gamma) + p.sd * ca.sin(gamma) - p.yc
    stretch = ca.hypot(spring_x, spring_y) - p.l0
    return kinetic - p.c0 * stretch**2 / 2 + p.mom * q[0]


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Close the three loops: each of the other ways to P ends where the crank's does."""
    p = params
    beta, theta, gamma, phi, delta, omega, epsilon = ca.vertsplit(q)
    x = p.rr * ca.cos(beta) - p.d * ca.cos(beta + theta)
    y = p.rr * ca.sin(beta) - p.d * ca.sin(beta + theta)
    return {
        "B_x": x - p.xb - p.ss * ca.sin(gamma),
        "B_y": y - p.yb + p.ss * ca.cos(gamma),
        "left_x": x - p.xa - p.e * ca.sin(phi + delta) - p.zt * ca.cos(delta),
        "left_y": y - p.ya + p.e * ca.cos(phi + delta) - p.zt * ca.sin(delta),
        "right_x": x - p.xa - p.zf * ca.cos(omega + epsilon) - p.u * ca.sin(epsilon),
        "right_y": y - p.ya - p.zf * ca.sin(omega + epsilon) + p.u * ca.cos(epsilon),
    }


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw crank and rod, the body on B as a triangle, the two pairs of arms, and the spring."""
    beta, theta, gamma, _, delta, _, epsilon = q
    p = params

    def at(x: float, y: float, angle: float, *arm: float) -> tuple[float, float]:
        c, s = np.cos(angle), np.sin(angle)
        return x + c * arm[0] - s * arm[1], y + s * arm[0] + c * arm[1]

    pin = at(0.0, 0.0, beta, p.rr, 0.0)
    joint = at(*pin, beta + theta, -p.d, 0.0)
    hook = at(p.xb, p.yb, gamma, p.sd, -p.sc)
    left = at(p.xa, p.ya, delta, p.zt, 0.0)
    right = at(p.xa, p.ya, epsilon, 0.0, -p.u)
    a, b, c = (p.xa, p.ya), (p.xb, p.yb), (p.xc, p.yc)
    lines = [((0.0, 0.0), pin, joint), (b, joint, hook, b), (a, left, joint), (a, right, joint)]
    return [np.array(line) for line in (*lines, (c, hook))]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon"),
    params=PARAMS,
)
start: dict[str, Any] = {
    "q": (
        -0.06171389001427644963589485,
        0.0,
        0.4552798191630703802559124,
        0.2226683901658858846744732,
        0.4873649795438425502255990,
        -0.2226683901658858846744732,
        1.230547444549821192497350,
    ),
    "v": (0.0,) * 7,
}
interval = (0.0, 0.03)
h = 1e-4
conserved = ("energy",)
reference = {
    0.03: {
        "q": (
            15.8107711951537070971,
            -15.7563710584118394697,
            0.0408222401196458048583,
            -0.534730116342079593770,
            0.524409965879954069372,
            0.534730116342079593770,
            1.04808074104193787307,
        ),
        "v": (
            1139.92030225910606420,
            -1424.37929517754007320,
            11.0329119106185937453,
            19.2933741050320408316,
            0.573569914829502453818,
            -19.2933741050320408316,
            0.323179149249130874991,
        ),
    },
}
source = "Test Set for IVP Solvers 2.4 (Mazzia, Magherini 2008); quadruple precision"
