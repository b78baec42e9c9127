r"""A polymer of N beads on rigid bonds in space, held together by a weak trap.

Beads of mass m at r_1, ..., r_N, bonds b_i = r_{i+1} - r_i of length l:

.. math::

    L = \sum_{i=1}^{N} \left(\tfrac m2 |v_i|^2 - \tfrac a2 |r_i|^2\right)
        - \tfrac k2 \sum_{i=1}^{N-2} \left(\frac{b_i \cdot b_{i+1}}{l^2} - c\right)^2, \qquad
    0 = \frac{|b_i|^2 - l^2}{2 l}

Units are of mass a bead's, of length a bond's, of energy the thermal energy of the start, so that
m = l = 1. The angles between bonds have stiffness k = 20 and rest at the cosine c = 1/3, that of
saturated carbon; the trap has stiffness a = 0.02. Beads pass through each other.

The chain starts with its angles at rest, turned at random about its bonds, and with random
velocities of that temperature, less what would stretch bonds or move the centre of mass. Besides
the energy the angular momentum is constant.

The reference is for twenty beads: accelerations with the tensions of the bonds eliminated,
extrapolation in 45 digits, two tolerances 2e-33 apart (``tools/polymer_reference.py``).
"""

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters

REST = 1 / 3  # cosine of the angle between bonds at rest


def build(beads: int) -> Lagrangian:
    """Make the system of a polymer.

    Parameters
    ----------
    beads : int
        Number of beads N, at least 2.

    Returns
    -------
    Lagrangian
        With coordinates x1, y1, z1, ..., zN and constraints bond1, ..., bond(N-1).
    """

    def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        bonds = bonds_of(q)
        cosines = ca.sum1(bonds[:, :-1] * bonds[:, 1:]) / params.l**2
        potential = params.k * ca.sumsqr(cosines - params.c) + params.a * ca.dot(q, q)
        return params.m / 2 * ca.dot(v, v) - potential / 2

    def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
        excess = (ca.sum1(bonds_of(q) ** 2) - params.l**2) / (2 * params.l)
        return {f"bond{i}": x for i, x in enumerate(ca.horzsplit(excess), start=1)}

    def bonds_of(q: ca.SX) -> ca.SX:
        places = ca.reshape(q, 3, beads)
        return places[:, 1:] - places[:, :-1]

    return Lagrangian(
        lagrangian,
        constraint,
        q=tuple(f"{axis}{i}" for i in range(1, beads + 1) for axis in "xyz"),
        params={"m": 1.0, "l": 1.0, "k": 20.0, "c": REST, "a": 0.02},
        invariants={f"spin_{axis}": partial(spin, k) for k, axis in enumerate("xyz")},
    )


def spin(k: int, t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return a component of the angular momentum about the origin."""
    i, j = (k + 1) % 3, (k + 2) % 3
    return params.m * (ca.dot(q[i::3], v[j::3]) - ca.dot(q[j::3], v[i::3]))


def start_for(beads: int, seed: int = 1) -> dict[str, Any]:
    """Fold the chain at random and give it random velocities.

    Parameters
    ----------
    beads : int
        Number of beads N, at least 2.
    seed : int, default 1
        From 1 to 2147483646; another seed gives another start.

    Returns
    -------
    dict
        ``q`` and ``v``, each of shape (3 N,).
    """
    random = uniform(seed)
    bond, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    bonds = [bond]
    for _ in range(beads - 2):
        turn = 2 * np.pi * next(random)
        across = np.cos(turn) * np.cross(normal, bond) + np.sin(turn) * normal
        after = REST * bond + np.sqrt(1 - REST**2) * across
        normal = np.cross(bond, after) / np.sqrt(1 - REST**2)
        bond = after / np.sqrt(after @ after)
        bonds.append(bond)
    q = np.cumsum([np.zeros(3), *bonds], axis=0)
    v = np.array([gauss(random) for _ in range(3 * beads)]).reshape(-1, 3)
    v -= v.mean(axis=0)
    pulls = np.diff(q, axis=0)
    along = (pulls * np.diff(v, axis=0)).sum(axis=1)
    impulses = pulls * tensions(pulls, along)[:, np.newaxis]
    v[:-1] += impulses
    v[1:] -= impulses
    return {"q": (q - q.mean(axis=0)).ravel(), "v": v.ravel()}


def tensions(bonds: NDArray[np.float64], rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve for impulses along bonds that take away these rates: 2 x_i - cos x_{i-1} - cos x_{i+1}.

    Bonds have length 1 and beads mass 1; the matrix is tridiagonal.
    """
    beside = [-float(one @ other) for one, other in pairwise(bonds)]
    pivots, x = [2.0], list(rates)
    for i, c in enumerate(beside):
        factor = c / pivots[i]
        pivots.append(2.0 - factor * c)
        x[i + 1] -= factor * x[i]
    x[-1] /= pivots[-1]
    for i in reversed(range(len(beside))):
        x[i] = (x[i] - beside[i] * x[i + 1]) / pivots[i]
    return np.array(x)


def uniform(seed: int) -> Iterator[float]:
    """Draw numbers between 0 and 1 by x <- 48271 x mod 2^31 - 1, the same on every machine."""
    while True:
        seed = 48271 * seed % (2**31 - 1)
        yield seed / (2**31 - 1)


def gauss(random: Iterator[float]) -> float:
    """Draw from the normal distribution (Box and Muller)."""
    radius = np.sqrt(-2 * np.log(next(random)))
    return float(radius * np.cos(2 * np.pi * next(random)))


system = build(20)
start: dict[str, Any] = start_for(20)
interval = (0.0, 1.0)
h = 0.02
conserved = ("energy", "spin_x", "spin_y", "spin_z")
reference = {
    1.0: {
        "q": (
            -0.56824001721030847059,
            -1.53699403516453894891,
            0.44131929217991120397,
            0.12782582994592050379,
            -0.81917534419169953405,
            0.42619767478227299451,
            -0.35757808821541476349,
            -0.13208160762323518679,
            0.96683177785200115653,
            -0.47653239490289388844,
            0.51239176370418931477,
            0.21151466129077508393,
            -0.65325180432586890507,
            1.41674871824978842873,
            0.59998441442247529635,
            0.30422436661233460709,
            1.60433845586328463628,
            0.81918631319987123314,
            1.06839496334464859585,
            0.96689130022137155469,
            0.72067528410254737257,
            1.16130087154338174517,
            0.26354851429585557233,
            0.01592183947932145106,
            1.87950366144739936215,
            -0.40272043426552227810,
            0.21659680243434871956,
            1.69021798481123241979,
            -0.99958483759490910598,
            0.99629149695178834061,
            1.23534096915815882043,
            -1.83822792618451482642,
            0.69668396935703619710,
            0.51723013164146532571,
            -1.51779082516210218357,
            0.07891630321593331751,
            0.90789665110626749380,
            -0.83208259278996416574,
            -0.53523668312080617034,
            0.22668171907601150333,
            -0.65048494919547525660,
            -1.24443941310705114170,
            -0.57180679070704825813,
            -0.35001356145378846247,
            -0.72277568531584905670,
            -1.19883791750568192243,
            0.00849460790072100248,
            -1.41437084039699488782,
            -1.42359702244772431480,
            0.95438242022066619296,
            -1.64842124362296696084,
            -1.03862960851095318282,
            1.51981058506418052780,
            -0.91897550841812645508,
            -1.62560771094034924858,
            1.25577775986809031198,
            -0.15363677655663475671,
            -1.20453579392057742275,
            0.57677198823760240661,
            0.44773632127014706234,
        ),
        "v": (
            0.58327747742621646425,
            -0.58674950547150612173,
            -0.35635886505222017856,
            -0.09393353204241642440,
            0.08341805597727114663,
            0.28347657238077713229,
            -0.42705072812605777145,
            0.12785934718612178322,
            -0.07209057354849234192,
            0.64463755585668232485,
            0.12558384296628671844,
            -0.24281150103039378115,
            0.23220778123621553991,
            0.07608258129236148287,
            -0.31519174613084378938,
            0.19806143736395684582,
            -0.57220570466113339312,
            0.38875534968774777347,
            -0.13980966940939530807,
            -0.97684145970060748730,
            0.38614392472318793912,
            -1.16866192716995437345,
            -0.39311843185631404687,
            -0.33204175834649676619,
            0.26548413210623047259,
            1.23196019655110085413,
            -0.06926992373360898285,
            0.26697050937573581708,
            0.97203013392292256984,
            -0.26788824562252240775,
            -0.64804128560765592832,
            1.20178075150595156052,
            0.47821806501919295562,
            -0.62294434868131251006,
            1.00583540471698790168,
            0.34740749381537539953,
            0.56396629701278556215,
            -0.18031319872742207813,
            -0.22193861229928391653,
            -0.07408903514960419069,
            1.21597077625375063701,
            0.74846754982761593427,
            -0.78413565301606714815,
            -0.78494372084403396746,
            0.81412956175965323586,
            0.36066927018687237234,
            -0.78800621040437595879,
            -0.22538935795018094007,
            0.12247045026474899198,
            -0.71078147685098683745,
            0.31544836801408013440,
            0.67029945760356142374,
            -0.29319293953344521428,
            -0.29736299680168290252,
            -0.21691449246504816532,
            -1.00916693446730115233,
            -1.22481612044411542697,
            0.26753630323450600520,
            0.25479849214437160312,
            -0.13688718426778907067,
        ),
    },
}
source = "seeded start; tensions eliminated, accelerations extrapolated in 45-digit arithmetic"
