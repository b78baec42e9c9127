r"""A leg of Jansen's walking machine: seven bodies in the plane whose foot walks as a crank turns.

With the lengths a to m of the machine, in units of 10 cm, the crank m turns about the origin, and
the leg's fixed pivot is at (-a, -l). Rods j and k hang on the crank's pin. Rod j ends at a corner
of the plate of sides b, d, e about the pivot, rod k at the end of rod c from the pivot, where the
plate of sides g, h, i hangs, the foot its far corner. Rod f joins the plates.

.. math::

    L = \sum_k \left( \tfrac12 m_k |\dot x_k|^2 + \tfrac12 j_k \dot\alpha_k^2 - m_k g y_k \right)

in kg, m, s. Rods and plates are uniform, of 1 kg/m along their edges; plates have their mass in
their face. The crank is a flywheel of 1 kg and 0.05 kg m^2 with its centre on the axis. It starts
with 8 rad/s and turns freely: a second is a turn and a quarter. Seven bodies with 21 coordinates
and ten hinges leave one freedom.

Lengths: T. Jansen, The Great Pretender, 010 Publishers, Rotterdam (2007). The reference is the
crank's angle, t = int sqrt(I(a) / (2 (E - V(a)))) da, extrapolated in 32 digits with the corners
by intersections of circles (``tools/mechanism_references.py``).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville.bodies import Assembly, Body

#: The lengths of the machine in metres.
LENGTHS = {
    name: size / 100
    for name, size in {
        "a": 38.0,
        "b": 41.5,
        "c": 39.3,
        "d": 40.1,
        "e": 55.8,
        "f": 39.4,
        "g": 36.7,
        "h": 65.7,
        "i": 49.0,
        "j": 50.0,
        "k": 61.9,
        "l": 7.8,
        "m": 15.0,
    }.items()
}

Point = NDArray[np.float64]


def meet(p: Point, q: Point, to_p: float, to_q: float) -> Point:
    """Return the point at these distances from two others, on the left of the way to q."""
    across = q - p
    gap = float(np.hypot(*across))
    along = (gap**2 + to_p**2 - to_q**2) / (2 * gap)
    normal = np.array([-across[1], across[0]]) / gap
    found: Point = p + along / gap * across + np.sqrt(to_p**2 - along**2) * normal
    return found


def corners(angle: float) -> dict[str, Point]:
    """Return the joints and the foot at an angle of the crank, in radians."""
    n = LENGTHS
    pin, pivot = n["m"] * np.array([np.cos(angle), np.sin(angle)]), np.array([-n["a"], -n["l"]])
    top = meet(pivot, pin, n["b"], n["j"])
    low = meet(pin, pivot, n["k"], n["c"])
    back = meet(pivot, top, n["d"], n["e"])
    knee = meet(low, back, n["g"], n["f"])
    foot = meet(low, knee, n["i"], n["h"])
    return {
        "crank": np.zeros(2),
        "pin": pin,
        "pivot": pivot,
        "top": top,
        "low": low,
        "back": back,
        "knee": knee,
        "foot": foot,
    }


def build(angle: float = 0.0) -> Assembly:
    """Return the leg as drawn at an angle of the crank."""
    leg = Assembly(gravity=lambda params: (0.0, -params.g, 0.0))
    at = corners(angle)

    def rod(name: str, a: str, b: str) -> Body:
        along = at[b] - at[a]
        length = float(np.hypot(*along))
        turn = float(np.arctan2(along[1], along[0]))
        middle, moment = (at[a] + at[b]) / 2, length**3 / 12
        return leg.planar_body(name, mass=length, inertia=moment, at=middle, angle=turn)

    def plate(name: str, *names: str) -> Body:
        three = np.array([at[each] for each in names])
        sides = np.hypot(*(three - np.roll(three, 1, axis=0)).T)
        mass, moment = sides.sum(), sides.sum() * (sides**2).sum() / 36
        return leg.planar_body(name, mass=mass, inertia=moment, at=three.mean(axis=0))

    leg.planar_body("crank", mass=1.0, inertia=0.05, at=(0.0, 0.0), angle=angle)
    rod("j", "pin", "top")
    rod("k", "pin", "low")
    rod("c", "pivot", "low")
    plate("upper", "pivot", "top", "back")
    rod("f", "back", "knee")
    plate("lower", "low", "knee", "foot")
    for name, first, second, where in (
        ("A", "ground", "crank", "crank"),
        ("B", "crank", "j", "pin"),
        ("C", "crank", "k", "pin"),
        ("D", "ground", "upper", "pivot"),
        ("E", "ground", "c", "pivot"),
        ("F", "j", "upper", "top"),
        ("G", "k", "c", "low"),
        ("H", "c", "lower", "low"),
        ("I", "upper", "f", "back"),
        ("J", "f", "lower", "knee"),
    ):
        leg.revolute(name, first, second, at=(*at[where], 0.0), axis=(0.0, 0.0, 1.0))
    return leg


assembly = build()
system = assembly.system(params={"g": 9.81})
#: The foot in the axes of the lower plate, from its centre of mass.
FOOT = (*(corners(0.0)["foot"] - sum(corners(0.0)[x] / 3 for x in ("low", "knee", "foot"))), 0.0)
drawn = assembly.start(rates={"A": 8.0})
start: dict[str, Any] = system.consistent(q=drawn["q"], v=drawn["v"])
interval = (0.0, 1.0)
h = 0.01
conserved = ("energy",)
reference = {
    0.5: {
        "q": (
            0.0,
            0.0,
            3.58107300652269101393,
            -0.288125493009483395804,
            0.134372621946895338585,
            2.22624909086758751059,
            -0.424665005532050622664,
            -0.174797948677496793729,
            -2.77485657352999306734,
            -0.546792039588499163106,
            -0.181887754475243750574,
            -2.58453514334038871257,
            -0.533394744764411526053,
            0.0480151977201116027922,
            0.490070205352254443147,
            -0.924211121603492477537,
            -0.244383842695798616144,
            -2.39449579644954100893,
            -0.76634439340042059004,
            -0.466168950315438989803,
            0.750598128501447598428,
        ),
        "v": (
            0.0,
            0.0,
            4.94840053821755131096,
            0.893681502082477247033,
            -0.227431158493474858437,
            -2.91570654650122486026,
            0.23328873124413330874,
            -0.456892310679292227378,
            -0.743574763069117567101,
            0.0753843090790777646,
            -0.121029689473800654553,
            0.725632289001315343071,
            0.451665151243614689811,
            0.549799245229738352979,
            -3.58421174124405192238,
            -0.233882493756316442853,
            1.55920859627788996176,
            -0.876441461650435315463,
            -0.82847747966721106005,
            0.0443442254872351916292,
            -5.42839080188213320407,
        ),
    },
    1.0: {
        "q": (
            0.0,
            0.0,
            7.15216584170877223739,
            -0.127298180869244613913,
            0.225283286845622302843,
            2.6827280453062841617,
            -0.0521809518519865395086,
            -0.156710756210364664175,
            -2.07315253139450472969,
            -0.290601358275292225991,
            -0.252986093326805082536,
            -1.09847473605947714136,
            -0.502947266302962952776,
            0.07786451644426991966,
            0.274872839316937739184,
            -0.668972347730927103059,
            -0.188895574064556479408,
            -0.98793192828251963183,
            -0.3284836824737538878,
            -0.566265354084649307112,
            0.291179456724455669227,
        ),
        "v": (
            0.0,
            0.0,
            8.19603212235384849189,
            -1.11298699212109683979,
            0.441253964230062016619,
            1.57249054603339481828,
            -0.338362020248488351928,
            0.463816780868501021249,
            2.21372785810452066278,
            0.131068482576502962919,
            0.0669615744456589976253,
            0.749022279911802333407,
            -0.484559270018068806,
            -0.382224504778688611251,
            3.10884915356167815844,
            -0.0829173612529215070702,
            -1.18032475502026430545,
            0.508578042101830907888,
            0.746709888525545316561,
            -0.312063524874227248305,
            3.5039541893071114874,
        ),
    },
}
source = "leg of Jansen (2007); its angle extrapolated in 32-digit arithmetic"
