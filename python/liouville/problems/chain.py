r"""A hanging chain of N links in the plane, in Cartesian coordinates, without units.

Point masses m/N at r_1, ..., r_N on massless links of length l/N, the first from the origin:

.. math::

    L = \frac mN \sum_i \left(\tfrac12 |v_i|^2 - g y_i\right), \qquad
    0 = \frac{|r_i - r_{i-1}|^2 - (l/N)^2}{2 l/N}, \quad r_0 = 0

with m = l = g = 1. It starts hanging, moving sideways in the first mode of a continuous chain,
:math:`v_{x,i} = J_0(j_{01} \sqrt{1 - i/N})`. Link against link it swings with frequencies up to
about 2N, so the step must shrink as 1/N.

The reference is for ten links: link angles as coordinates, extrapolation in 45 digits, two
tolerances 3e-35 apart (``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters

J0_ZERO = 2.404825557695772768622  # the first zero of the Bessel function J0


def build(links: int) -> Lagrangian:
    """Make the system of a chain.

    Parameters
    ----------
    links : int
        Number of links N, at least 1.

    Returns
    -------
    Lagrangian
        With coordinates x1, y1, ..., xN, yN and constraints link1, ..., linkN.
    """

    def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        return params.m / links * (ca.dot(v, v) / 2 - params.g * ca.sum1(q[1::2]))

    def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
        length = params.l / links
        ends = ca.horzcat(ca.SX(2, 1), ca.reshape(q, 2, links))  # column i is r_i, i = 0..N
        arms = ends[:, 1:] - ends[:, :-1]
        excess = (ca.sum1(arms**2) - length**2) / (2 * length)
        return {f"link{i}": x for i, x in enumerate(ca.horzsplit(excess), start=1)}

    names = tuple(f"{axis}{i}" for i in range(1, links + 1) for axis in "xy")
    return Lagrangian(lagrangian, constraint, q=names, params={"m": 1.0, "l": 1.0, "g": 1.0})


def start_for(links: int) -> dict[str, Any]:
    """Hang the chain and give it the velocity of the first mode.

    Parameters
    ----------
    links : int
        Number of links N, at least 1.

    Returns
    -------
    dict
        ``q`` and ``v``, each of shape (2 N,).
    """
    hanging = np.arange(1, links + 1) / links
    q, v = np.zeros((links, 2)), np.zeros((links, 2))
    q[:, 1] = -hanging
    v[:, 0] = bessel_j0(J0_ZERO * np.sqrt(1 - hanging))
    return {"q": q.ravel(), "v": v.ravel()}


def bessel_j0(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """J0(x), the mean of cos(x sin a) over the circle: 32 points reach roundoff for |x| < 3."""
    angle = np.arange(32) * (2 * np.pi / 32)
    mean: NDArray[np.float64] = np.cos(np.outer(x, np.sin(angle))).mean(axis=1)
    return mean


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the links as one line from the origin."""
    return [np.vstack([(0.0, 0.0), np.reshape(q, (-1, 2))])]


system = build(10)
start: dict[str, Any] = start_for(10)
interval = (0.0, 1.0)
h = 0.02
conserved = ("energy",)
reference = {
    1.0: {
        "q": (
            0.0525648900407814023352,
            -0.0850701612494096554051,
            0.109714761714386599721,
            -0.167130457176797452482,
            0.171109052110829187839,
            -0.246065500767824102376,
            0.236358578891544048632,
            -0.321844780619857363663,
            0.305062009104823400261,
            -0.394507279041870447814,
            0.376882794865285873530,
            -0.464090141391372504177,
            0.451473099521097011914,
            -0.530695595007073367539,
            0.528856759467656695409,
            -0.594034123354953495426,
            0.609273507253435875556,
            -0.653474401580735542375,
            0.692742573235267119464,
            -0.708546309338872105791,
        ),
        "v": (
            0.0184911814799194612164,
            0.0114257091668889378640,
            0.0414291363115164148298,
            0.0274005622948948067675,
            0.0683135623004175397922,
            0.0483107965991411240470,
            0.0986726958720936722983,
            0.0744514395676719295607,
            0.130978586789333435001,
            0.104997120906892060821,
            0.164467593856208323910,
            0.139563201126468528406,
            0.197227731303834606396,
            0.176250716939868316578,
            0.226584288427879321225,
            0.212117003905231039194,
            0.252974550989597206480,
            0.247820388071182867070,
            0.277699183890971230070,
            0.285293976676190613709,
        ),
    },
}
source = "first-mode start; angle equations extrapolated in 45-digit arithmetic"
