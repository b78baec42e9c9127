r"""Twenty Fekete points: particles that repel each other on a sphere, until they rest.

.. math::

    p_i'' = -\alpha p_i' + \sum_{j \ne i} \frac{p_i - p_j}{|p_i - p_j|^2} + 2 \lambda_i p_i,
    \qquad 0 = 1 - |p_i|^2

without units, :math:`\alpha = 1/2`: the potential is :math:`-\sum_{i < j} \log |p_i - p_j|`. In the
limit :math:`v = 0` and all :math:`\lambda_i = -(20 - 1) / 4`. Forces and damping are the same in
all frames, so the angular momentum, zero at the start, stays zero.

``system`` is the index-3 form, and :func:`stabilised` the one of index 2 and dimension 160 in which
the problem was published: its velocities are constrained too, and further unknowns
:math:`\mu_i`, which are zero along the motion, keep the positions on the sphere,

.. math::

    p_i' = v_i + 2 \mu_i p_i, \qquad 0 = 1 - |p_i|^2, \qquad 0 = -2 p_i \cdot v_i

The references are computed in both forms with 7 to 10 stages, which agree to 6e-15. The end state
of the test set, at t = 1000, is off by 2.5e-12.
"""

from collections.abc import Callable
from math import cos, pi, sin
from typing import Any

import casadi as ca

from liouville._systems import Lagrangian, SemiExplicit
from liouville.problems import Parameters

#: The particles stand in rings: how many, from which azimuth on, and at which latitude.
RINGS = (
    (3, 2 * pi / 3 + pi / 13, 3 * pi / 8),
    (7, 2 * pi / 7 + pi / 29, pi / 8),
    (6, 2 * pi / 6 + pi / 7, -2 * pi / 15),
    (4, pi / 17, -3 * pi / 10),
)
N = 20

_AT_20 = """
    -0.370846101755679 0.346918995557393 0.861464090565629
    0.080444009781787 -0.305564541350674 0.948767132841026
    0.672738565048505 0.13763369327115 0.726966154351783
    0.250785408225763 0.769286309318324 0.587626797650031
    -0.466240329688401 0.853950112438258 0.231060945290929
    -0.961832186403949 0.20873767759936 0.176939049245281
    -0.659712686408183 -0.384265474567617 0.645847672789353
    -0.162079059309872 -0.931251853825488 0.326343934032516
    0.563880367647956 -0.700274104177905 0.437784319041966
    0.988942552136308 -0.14506715194869 0.030792044420943
    0.131450073362652 0.944658269015859 -0.300568849006204
    -0.676326493603883 0.555213545599237 -0.484066516950513
    -0.843377530001615 -0.522839273229535 -0.123908983763029
    -0.192291245599731 -0.876080173496173 -0.442162420918625
    0.58955294118835 -0.720467899976927 -0.365175758558811
    0.773033845487136 0.634281052901397 -0.01030629233362
    0.728386737576222 0.170457957060022 -0.663624024126607
    0.01378012467293 0.460509301086251 -0.887547909567169
    -0.620130892140713 -0.161345284103284 -0.767727409899109
    0.159856472628556 -0.334509127630834 -0.928735458400515
"""
_SPEED_AT_20 = """
    0.000198178264535 -0.001581957421418 0.000722380332882
    0.00010686892243 0.000515228959661 0.000156875940319
    0.00053184518133 0.000807041297596 -0.000644966530725
    -0.000317924985871 0.000683944136679 -0.000759696315934
    -0.000207896227186 0.000360214902038 -0.001750772555232
    0.00044054594695 0.001035261191844 0.001173473325178
    0.000274122947481 -0.001182219566219 -0.000423387414847
    0.000648753762778 -0.000318403397707 -0.000586388576062
    -0.000677438857669 0.00024817262957 0.001269536878779
    0.000007735044712 -0.000353102819672 -0.00191195928559
    -0.001590908462413 -0.000202076718731 -0.00133087137521
    -0.001142077121073 -0.000051218087253 0.001536937616723
    -0.000477365778625 0.000765781926203 0.000017905929568
    0.000151910216786 0.001002998538016 -0.002053358890428
    -0.00146556299341 -0.001298524989648 0.000195847061096
    0.000074350125757 -0.000080356818499 0.000631299401412
    0.000507730240297 -0.000355718732294 0.000465909722468
    0.000335544544828 -0.001635544627835 -0.000843401983971
    0.000999230014019 0.001469540878942 -0.001115964963103
    0.002067364105526 0.000399859009635 0.000211820323301
"""
_AT_1000 = """
    -0.407026338033129 0.346375877281722 0.845194245002093
    0.077529347524637 -0.262866271994993 0.961712287183573
    0.710057783334315 0.121294805559436 0.693617700517121
    0.234826774456495 0.744927797693562 0.624450928593896
    -0.43411147387728 0.878543044227296 0.199272044421518
    -0.951505960031051 0.220350876280372 0.21466694982661
    -0.638519164361681 -0.431083325936752 0.637542502773085
    -0.146417508792653 -0.938087163521949 0.313933729876702
    0.56669740650605 -0.67392218850719 0.474007313548004
    0.984325953843837 -0.169699535783307 -0.048005042905412
    0.146417508792653 0.938087163521949 -0.313933729876702
    -0.709275754997138 0.526406263713683 -0.468854293886961
    -0.866573181928995 -0.481387805974872 -0.131592935297284
    -0.234789777870972 -0.859434040802129 -0.454144128793738
    0.553097694006572 -0.767437026562967 -0.324227314001773
    0.771105096990452 0.635704181656857 0.035736855196437
    0.710395120938429 0.240357043125588 -0.66148867259145
    -0.03038208738657 0.450192329361918 -0.892414587145305
    -0.577299615810708 -0.176676341498416 -0.797189202096682
    0.241448176696737 -0.341645681839808 -0.908284650343731
"""


def points(q: ca.SX) -> list[ca.SX]:
    """Cut a column into the particles."""
    return [q[3 * i : 3 * i + 3] for i in range(N)]


def potential(q: ca.SX) -> ca.SX:
    """Repel each from each."""
    p = points(q)
    apart = [p[i] - p[j] for i in range(N) for j in range(i)]
    return -ca.sum(ca.log(ca.vertcat(*(ca.dot(x, x) for x in apart)))) / 2


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of the repulsion."""
    return ca.dot(v, v) / 2 - potential(q)


def damping(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Slow every particle down."""
    return -params.alpha * v


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> list[ca.SX]:
    """Keep the particles on the sphere."""
    return [1 - ca.dot(p, p) for p in points(q)]


def momentum_about(axis: int) -> Callable[..., ca.SX]:
    """Return the function that adds up the particles' angular momenta about an axis."""

    def momentum(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        pairs = zip(points(q), points(v), strict=True)
        return ca.sum(ca.vertcat(*(ca.cross(p, u)[axis] for p, u in pairs)))

    return momentum


def stabilised() -> SemiExplicit:
    """Return the form of index 2: y has positions and then velocities, z has lambda and then mu."""

    def field(t: ca.SX, y: ca.SX, z: ca.SX, params: Parameters) -> ca.SX:
        q, v, lam, mu = y[: 3 * N], y[3 * N :], z[:N], z[N:]
        force = -ca.gradient(potential(q), q) - params.alpha * v
        outward = [2 * p for p in points(q)]
        moved = ca.vertcat(*(mu[i] * p for i, p in enumerate(outward)))
        held = ca.vertcat(*(lam[i] * p for i, p in enumerate(outward)))
        return ca.vertcat(v + moved, force + held)

    def both(t: ca.SX, y: ca.SX, params: Parameters) -> ca.SX:
        q, v = y[: 3 * N], y[3 * N :]
        hidden = [-2 * ca.dot(p, u) for p, u in zip(points(q), points(v), strict=True)]
        return ca.vertcat(*constraint(t, q, params), *hidden)

    positions = system.coordinates
    return SemiExplicit(
        field=field,
        constraint=both,
        y=(*positions, *(f"{name}'" for name in positions)),
        z=(*(f"lam{i}" for i in range(1, N + 1)), *(f"mu{i}" for i in range(1, N + 1))),
        params={"alpha": 0.5},
    )


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(digits) for digits in text.split())


def _rings() -> tuple[float, ...]:
    """Return the positions at the start."""
    places = []
    for count, first, latitude in RINGS:
        for k in range(count):
            azimuth = first + 2 * pi * k / count
            places += [
                cos(azimuth) * cos(latitude), sin(azimuth) * cos(latitude), sin(latitude),
            ]  # fmt: skip
    return tuple(places)


system = Lagrangian(
    lagrangian,
    constraint,
    q=tuple(f"{axis}{i}" for i in range(1, N + 1) for axis in "xyz"),
    params={"alpha": 0.5},
    force=damping,
    invariants={f"angular_momentum_{axis}": momentum_about(k) for k, axis in enumerate("xyz")},
)
start: dict[str, Any] = {"q": _rings(), "v": (0.0,) * (3 * N)}
interval = (0.0, 20.0)
h = 0.1
conserved = ("angular_momentum_x", "angular_momentum_y", "angular_momentum_z")
reference = {
    20.0: {"q": _numbers(_AT_20), "v": _numbers(_SPEED_AT_20)},
    1000.0: {
        "q": _numbers(_AT_1000),
        "v": (0.0,) * (3 * N),
        "lam": (-(N - 1) / 4,) * N,
    },
}
source = "Test Set for IVP Solvers 2.4 (Mazzia, Magherini 2008); both forms, 7 to 10 stages"
