"""Mechanisms with closed loops as all codes take them: bodies at a reference, joints, closings.

A model has bodies in a tree of joints, each drawn with its axes along those of the world, and
points that close its loops. MuJoCo's files have these parts, liouville and Drake read them.
"""

from dataclasses import dataclass

import numpy as np

from liouville.problems import bricard, stewart_platform


@dataclass
class Link:
    """A body on a chain of joints: (kind, axis, point), in the world as drawn."""

    name: str
    parent: str
    mass: float
    at: np.ndarray
    inertia: np.ndarray
    joints: list
    stiffness: float = 0.0


@dataclass
class Model:
    """Links, the points that close loops, gravity, and rates of joints that it starts with."""

    links: list
    closings: list
    gravity: tuple
    rates: dict
    seconds: float
    size: float = 1.0


def rod(mass, a, b, radius):
    """Return place and inertia of a cylinder between two points, in the world's axes."""
    along = b - a
    length = np.linalg.norm(along)
    e = along / length
    across, own = mass * (length**2 / 12 + radius**2 / 4), mass * radius**2 / 2
    return (a + b) / 2, across * np.eye(3) + (own - across) * np.outer(e, e)


def four_bar():
    """Return the four-bar of spatial hinges of the guide."""
    points = [np.array((*p, 0.0)) for p in ((0, 0), (0, 0.5), (0.9, 0.9), (1.1, 0))]
    z = np.array([0.0, 0.0, 1.0])
    hinges = {"crank": ("world", points[0]), "coupler": ("crank", points[1])}
    hinges["rocker"] = "world", points[3]
    links = []
    for k, (name, mass) in enumerate((("crank", 1.0), ("coupler", 2.0), ("rocker", 1.8))):
        parent, point = hinges[name]
        at, inertia = rod(mass, points[k], points[k + 1], 0.05)
        links.append(Link(name, parent, mass, at, inertia, [(f"{name} hinge", "hinge", z, point)]))
    ends = [("coupler", "rocker", points[2] + height * z) for height in (-0.1, 0.1)]
    return Model(links, ends, (0.0, -9.81, 0.0), {"crank hinge": 6.0}, 5.0)


def bricard_loop():
    """Return Bricard's mechanism of five bars and six hinges."""
    links, parent = [], "world"
    for k, (x, a, b, c) in enumerate(bricard.bars(np.pi / 2), start=1):
        axis, point = (c, x - a / 2) if k < bricard.BARS else (b, x + a / 2)
        at, inertia = rod(1.0, x - a / 2, x + a / 2, bricard.RADIUS)
        own = parent if k < bricard.BARS else "world"
        links.append(Link(f"bar{k}", own, 1.0, at, inertia, [(f"hinge{k}", "hinge", axis, point)]))
        parent, last = f"bar{k}", (x - a / 2, c)
    ends = [("bar4", "bar5", last[0] + height * last[1]) for height in (-0.2, 0.2)]
    return Model(links, ends, (0.0, -9.81, 0.0), {"hinge1": -3.0}, 2.0)


def stewart():
    """Return the library's Stewart platform, whose legs are closed by balls at the plate."""
    p = stewart_platform
    height = np.array([0.0, 0.0, p.HEIGHT])
    mass, moments = p.PLATE_BODY
    links = [
        Link("plate", "world", mass, height, np.diag(moments), [("flight", "free", None, None)])
    ]
    ends = p.ring(p.BASE, p.BASE_ANGLES, 0.0), p.ring(p.PLATE, p.PLATE_ANGLES, p.HEIGHT)
    closings = []
    for k, (foot, head) in enumerate(zip(*ends, strict=True), start=1):
        leg = head - foot
        z = leg / np.linalg.norm(leg)
        x = np.cross(z, (0, 0, 1))
        x /= np.linalg.norm(x)
        frame = np.array([x, np.cross(z, x), z]).T
        turned = [frame @ np.diag(j) @ frame.T for _, j in (p.LOWER_BODY, p.UPPER_BODY)]
        feet = [(f"foot{k} {i}", "hinge", frame[:, i], foot) for i in range(2)]
        slide = [(f"leg{k}", "slide", z, head)]
        low, high = f"lower{k}", f"upper{k}"
        links.append(Link(low, "world", p.LOWER_BODY[0], foot + p.LOWER * leg, turned[0], feet))
        links.append(
            Link(high, low, p.UPPER_BODY[0], foot + p.UPPER * leg, turned[1], slide, 5000.0)
        )
        closings.append((high, "plate", head))
    rates = {"flight": (*p.VELOCITY, *p.SPIN)}
    return Model(links, closings, (0.0, 0.0, -9.81), rates, 2.0)


MODELS = {"four-bar": four_bar, "Bricard": bricard_loop, "Stewart": stewart}


def words(values):
    """Return numbers as a file has them."""
    return " ".join(f"{x:.17g}" for x in np.ravel(values))


def mjcf(model, h=0.001, integrator="Euler"):
    """Return a model as an MJCF file."""
    places = {"world": np.zeros(3), **{link.name: link.at for link in model.links}}

    def body(link):
        own = f'<body name="{link.name}" pos="{words(link.at - places[link.parent])}">'
        for name, kind, axis, point in link.joints:
            if kind == "free":
                own += f'<freejoint name="{name}"/>'
            else:
                spring = f' stiffness="{link.stiffness}"' if kind == "slide" else ""
                own += f'<joint name="{name}" type="{kind}" axis="{words(axis)}"'
                own += f' pos="{words(point - link.at)}"{spring}/>'
        j = link.inertia
        full = (j[0, 0], j[1, 1], j[2, 2], j[0, 1], j[0, 2], j[1, 2])
        own += f'<inertial pos="0 0 0" mass="{link.mass}" fullinertia="{words(full)}"/>'
        return own + "".join(body(x) for x in model.links if x.parent == link.name) + "</body>"

    ties = "".join(
        f'<connect name="tie{k}" body1="{a}" body2="{b}" anchor="{words(point - places[a])}"'
        ' solref="1e-9 1" solimp="0.9999 0.9999 1e-3"/>'
        for k, (a, b, point) in enumerate(model.closings)
    )
    tree = "".join(body(link) for link in model.links if link.parent == "world")
    option = f'gravity="{words(model.gravity)}" timestep="{h}" integrator="{integrator}"'
    return (
        f'<mujoco><compiler angle="radian"/><option {option}><flag contact="disable"/></option>'
        f"<worldbody>{tree}</worldbody><equality>{ties}</equality></mujoco>"
    )


class Gauge:
    """What is measured of any code: places, turns and velocities of all bodies.

    ``x``, ``v`` and ``omega`` have shape (k, bodies, 3), ``turns`` (k, bodies, 3, 3) from the axes
    as drawn.
    """

    def __init__(self, model):
        self.model, self.names = model, [link.name for link in model.links]
        self.at = np.array([link.at for link in model.links])
        self.mass = np.array([link.mass for link in model.links])
        self.inertia = np.array([link.inertia for link in model.links])

    def gap(self, x, turns):
        """Return the largest gap of a loop, over the size of the mechanism."""

        def ends(name, point):
            if name == "world":
                return point
            k = self.names.index(name)
            return x[:, k] + turns[:, k] @ (point - self.at[k])

        gaps = [ends(a, point) - ends(b, point) for a, b, point in self.model.closings]
        return float(np.linalg.norm(gaps, axis=-1).max() / self.model.size)

    def energy(self, x, turns, v, omega):
        """Return the largest change of the energy, over the kinetic energy's largest."""
        own = np.einsum("tbji,tbj->tbi", turns, omega)
        spin = np.einsum("tbi,bij,tbj->t", own, self.inertia, own)
        kinetic = (spin + (self.mass * (v**2).sum(-1)).sum(-1)) / 2
        potential = -(self.mass * (x @ np.array(self.model.gravity))).sum(-1)
        for k, link in enumerate(self.model.links):
            if link.stiffness:
                other = self.names.index(link.parent)
                rest = np.linalg.norm(self.at[k] - self.at[other])
                slide = np.linalg.norm(x[:, k] - x[:, other], axis=-1) - rest
                potential += link.stiffness / 2 * slide**2
        total = kinetic + potential
        return float(np.abs(total - total[0]).max() / kinetic.max())
