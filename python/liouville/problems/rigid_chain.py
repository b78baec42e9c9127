r"""A hanging chain of N rigid rods in space, by positions and unit quaternions, without units.

Cylinders of mass m/N, length l/N and radius r l/N, whose axes are the third ones of their bodies,
centres at x_i, attitudes :math:`R(e_i)`, angular velocities
:math:`\Omega_i = 2 \bar e_i \circ \dot e_i` in their own frames:

.. math::

    L = \sum_i \left( \tfrac{m}{2N} |\dot x_i|^2 + \tfrac12 \Omega_i^T J \Omega_i
        + \tfrac\mu2 \tfrac{m l^2}{N^3} (e_i \cdot \dot e_i)^2 - \tfrac mN g z_i \right)

    0 = x_i + R(e_i) a - x_{i-1} + R(e_{i-1}) a, \qquad 0 = \tfrac12 (|e_i|^2 - 1)

with a = (0, 0, l/2N) and the first rod on a hook at the origin. The term with mu completes the mass
matrix, see :mod:`~liouville.problems.heavy_top`. With ``revolute=True`` each joint is a hinge,
about the first axes of its two bodies and the second in turn: two more constraints a joint.

It starts hanging, with angular velocities :math:`\omega_i = (s, 1 - s, 1)`, s = (i - 1/2)/N, of
which hinges leave :math:`(s', 1 - s'', 0)`: s' and s'' are those below the last joint of each kind.
Spherical joints keep, besides the energy, the angular momentum about the vertical.

The reference is for three rods: angular accelerations with the forces of the joints eliminated,
extrapolation in 45 digits, two tolerances 6e-35 apart (``tools/rigid_chain_reference.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters

AXES = "xyzwijk"


def build(rods: int, revolute: bool = False) -> Lagrangian:
    """Make the system of a chain of rods.

    Parameters
    ----------
    rods : int
        Number of rods N, at least 1.
    revolute : bool
        Whether joints are hinges instead of spherical.

    Returns
    -------
    Lagrangian
        With coordinates x1, y1, z1, w1, i1, j1, k1, ..., kN, the last four of each rod its
        quaternion, and constraints joint_x1, joint_y1, joint_z1, unit1, ..., then of hinges
        hinge_a1, hinge_b1, ....
    """

    def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        x, _ = parts(q)
        velocity, _ = parts(v)
        mass, length = params.m / rods, params.l / rods
        kinetic = mass * ca.sumsqr(velocity) / 2
        for moment, rate in zip(moments(params), ca.vertsplit(rates(q, v)), strict=True):
            kinetic += moment * ca.sumsqr(rate) / 2
        completion = params.mu * mass * length**2 / 2 * ca.sumsqr(radial(q, v))
        return kinetic + completion - mass * params.g * ca.sum2(x[2, :])

    def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
        x, e = parts(q)
        arms = params.l / rods / 2 * column(e, 2)
        gaps = x + arms - before(ca.SX(3, 1), x - arms)
        named = {f"joint_{axis}": row for axis, row in zip("xyz", ca.vertsplit(gaps), strict=True)}
        named["unit"] = (ca.sum1(e**2) - 1) / 2
        found = {f"{name}{i + 1}": row[i] for i in range(rods) for name, row in named.items()}
        return found | (hinges(e) if revolute else {})

    def hinges(e: ca.SX) -> dict[str, ca.SX]:
        frames = [column(e, k) for k in range(3)]
        found: dict[str, ca.SX] = {}
        for k in (0, 1):
            axis = ca.SX.zeros(3)
            axis[k] = 1
            pins = before(axis, frames[k])
            for name, other in (("a", frames[1 - k]), ("b", frames[2])):
                tilt = ca.sum1(pins * other)
                found |= {f"hinge_{name}{i + 1}": tilt[i] for i in range(k, rods, 2)}
        return found

    def moments(params: Parameters) -> tuple[ca.SX, ca.SX, ca.SX]:
        scale = params.m / rods * (params.l / rods) ** 2
        across = scale * (3 * params.r**2 + 1) / 12
        return across, across, scale * params.r**2 / 2

    def spin(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        x, e = parts(q)
        dx, _ = parts(v)
        orbital = params.m / rods * ca.sum2(x[0, :] * dx[1, :] - x[1, :] * dx[0, :])
        rows = zip(moments(params), ca.vertsplit(rates(q, v)), range(3), strict=True)
        return orbital + sum(
            moment * ca.sum2(column(e, k)[2, :] * rate) for moment, rate, k in rows
        )

    return Lagrangian(
        lagrangian,
        constraint,
        q=tuple(f"{axis}{i}" for i in range(1, rods + 1) for axis in AXES),
        params={"m": 1.0, "l": 1.0, "g": 1.0, "r": 0.25, "mu": 0.5},
        invariants={} if revolute else {"spin": spin},
    )


def parts(q: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return positions and quaternions, a column a rod."""
    rows = ca.reshape(q, 7, -1)
    return rows[:3, :], rows[3:, :]


def rates(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return angular velocities about the rods' own axes, a column a rod."""
    (w, *u), (dw, *du) = (ca.vertsplit(parts(x)[1]) for x in (q, v))
    turned = ca.vertcat(*(u[k - 2] * du[k - 1] - u[k - 1] * du[k - 2] for k in range(3)))  # u x u'
    return 2 * (ca.vertcat(*(w * x for x in du)) - ca.vertcat(*(dw * x for x in u)) - turned)


def radial(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return e . e' of each rod."""
    return ca.sum1(parts(q)[1] * parts(v)[1])


def before(first: ca.SX, columns: ca.SX) -> ca.SX:
    """Return the columns shifted by one, `first` before them."""
    return ca.horzcat(first, columns[:, :-1])


def column(e: ca.SX, k: int) -> ca.SX:
    """Return column k of R(e), of each rod."""
    w, x, y, z = ca.vertsplit(e)
    if k == 0:
        rows = (w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y))
    elif k == 1:
        rows = (2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x))
    else:
        rows = (2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2)
    return ca.vertcat(*rows)


def start_for(rods: int, revolute: bool = False) -> dict[str, Any]:
    """Hang the chain and set it turning.

    Parameters
    ----------
    rods : int
        Number of rods N, at least 1.
    revolute : bool
        Whether joints are hinges instead of spherical.

    Returns
    -------
    dict
        ``q`` and ``v``, each of shape (7 N,).
    """
    s = (np.arange(rods) + 0.5) / rods
    omega = np.stack([s, 1 - s, np.ones(rods)], axis=1)
    if revolute:
        last = np.arange(rods)
        omega[:, 0] = omega[last - last % 2, 0]
        omega[:, 1] = omega[np.maximum(last - (last + 1) % 2, 0), 1]
        omega[0, 1] = omega[:, 2] = 0.0
    across = np.stack([-omega[:, 1], omega[:, 0], np.zeros(rods)], axis=1) / rods
    q, v = np.zeros((rods, 7)), np.zeros((rods, 7))
    q[:, 2], q[:, 3] = -s, 1.0
    v[:, :3] = np.cumsum(across, axis=0) - across / 2
    v[:, 4:] = omega / 2
    return {"q": q.ravel(), "v": v.ravel()}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the rods."""
    rods = q.reshape(-1, 7)
    half = params.l / len(rods) / 2
    found = []
    for x, (w, i, j, k) in zip(rods[:, :3], rods[:, 3:], strict=True):
        axis = np.array([2 * (i * k + w * j), 2 * (j * k - w * i), w * w - i * i - j * j + k * k])
        found.append(np.array([x + half * axis, x - half * axis]))
    return found


system = build(3)
start: dict[str, Any] = start_for(3)
interval = (0.0, 1.0)
h = 0.02
conserved = ("energy", "spin")
reference = {
    1.0: {
        "q": (
            -0.06166441315637195718717909,
            0.04245011431029466548364989,
            -0.1489069028718983024402505,
            0.8597780840196862433659353,
            0.204666425152549066203984,
            0.1067283739198771997381036,
            0.4555242637391912300501513,
            -0.2063002760541256721079923,
            0.136427945625821052605272,
            -0.4328634658167486303656445,
            0.8335128257898630430989321,
            0.2684905622456980731004756,
            0.1508768960647482700793442,
            0.4586996288015213752867213,
            -0.3842140865993841525794192,
            0.2452066231843564123693169,
            -0.6923560984453590227879539,
            0.7961786907660174322698538,
            0.3161648741276018803612423,
            0.1634345578539084809031839,
            0.4893142242333503723025953,
        ),
        "v": (
            0.000631246354080887315829872,
            0.03158218720550072487029592,
            0.008741985737095058153615971,
            -0.2311213107414931479202784,
            0.1393301329906232027855911,
            -0.1443217118733670915049661,
            0.4074427509004472346729719,
            -0.02088387112895765297280804,
            0.09855505294240633105155609,
            0.04459338278316774049326054,
            -0.2586076270416410552173987,
            0.2162456513080321220431193,
            -0.1152979680331502786967305,
            0.3812705440372110106482897,
            -0.1887389852246282070863367,
            0.07529335776477025418112826,
            0.1558861576892331064499535,
            -0.4299220382868583482930457,
            0.2353635285532599738726058,
            0.3173219036253029231356436,
            0.4414744339744324776020286,
        ),
    },
}
source = "rods turning on a hook; minimal equations extrapolated in 45-digit arithmetic"
