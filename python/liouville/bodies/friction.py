r"""Friction in joints, whose normal force is the joint's own reaction.

The multipliers that a method finds are no arguments of forces. But the motion determines them: with
all forces, friction among them, they solve

.. math::

    M a + G^T \lambda = F + \sum_j N_j d_j(t, q, v), \qquad G a = -\gamma,

where the normal force :math:`N_j = |E_j \lambda|` is a length of the joint's own multipliers. So
:math:`\lambda` is affine in the :math:`N_j`, and these are found from :math:`(t, q, v)` alone: the
one of a single joint by a quadratic equation, several one after another in turn, and then all by
Newton's method. Friction is then a force as any other: it keeps the order of a method and its
constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville.bodies.body import EXCESS, Value, check_size, column, given
from liouville.bodies.compound import Compound
from liouville.bodies.joints import ALONG, AT, SPINS, Group, Joint
from liouville.bodies.turns import is_planar

#: Normal forces are rounded off below these parts of a body's weight, and of what turns it on a
#: path of the joint's size at the velocity v_s.
OF_WEIGHT, OF_TURNING = 1e-7, 1e-4
#: The slip of several coordinates is rounded off below this part of the velocity v_s.
ROUNDED = 1e-4

#: Controlled steps end where a slip passes so many v_s, the flanks of a reversal, and so many
#: v_stribeck, over which friction falls.
EDGES = {"v_s": (1, 3, 8), "v_stribeck": (1, 2, 4)}

#: Several normal forces turn together where their size is below so many of what rounds it off.
WIDTH = 10


@dataclass(frozen=True, kw_only=True)
class Coulomb:
    r"""Dry friction by the joint's own normal force N, regularised: ``friction=`` of a joint.

    .. math::

        F = -\mu N \tanh\!\left(\frac{|s|}{v_s}\right) \frac{s}{|s|}

    N is the size of the joint's force across its axis, of a ball joint and of a guide of all of it,
    of a planar joint along its normal, of a screw across its thread and its axis. The slip s is the
    velocity of a slide, of a turn the rate times the radius, of both together in a cylindrical
    joint and along the thread of a screw. A universal and a compound joint slip on each axis by
    itself. Torques that a joint holds add nothing to N.
    Planar bodies do not know the force across their plane: N is of the part in it. Friction that
    gravity along z would press, and that of a planar joint between them, is refused.
    A joint does not stick: at rest under a load it creeps, slower than ``v_s``. What sticks is
    :class:`~liouville.bodies.Dry`.

    Attributes
    ----------
    mu : float or callable
        The coefficient of friction, or a function of the parameters.
    v_s : float or callable
        The velocity below which friction is smoothed, above zero.
    radius : float or callable, optional
        Of the pin or ball, for joints that turn.
    force_s : float or callable, optional
        Normal forces are rounded off below this: :math:`N = \sqrt{|n|^2 + f_s^2}`. By default
        :math:`f_s^2 = m^2 ((10^{-7} g)^2 + (10^{-4} v_s^2 / L)^2)` with the mass m of the lighter
        body, gravity g, and the size L of the joint: radius, and distance of its bodies as drawn.

    Raises
    ------
    TypeError, ValueError
        A value is no number, or negative.

    References
    ----------
    :cite:t:`armstrong1994`.
    """

    mu: Value
    v_s: Value
    radius: Value | None = None
    force_s: Value | None = None

    def __post_init__(self) -> None:
        """Refuse what is no friction."""
        for name in ("mu", "v_s", "radius", "force_s", "mu_static", "v_stribeck"):
            value = getattr(self, name, None)
            if value is None or callable(value):
                continue
            what = f"{name}= of friction"
            check_size(what, name, given(what, value, ()))

    def functions(self) -> dict[str, Callable[[Any], Any]]:
        """Return the values that are functions of the parameters, by name."""
        return {name: x for name, x in vars(self).items() if callable(x)}

    def coefficient(self, square: ca.SX, params: Any) -> ca.SX:
        """Return the coefficient of friction at the square of a slip."""
        return column(self.mu, params, 1)

    def forces(self, slips: Sequence[ca.SX], params: Any) -> list[ca.SX]:
        """Return the forces along these parts of the slip, for a normal force of one."""
        v_s, square = column(self.v_s, params, 1), sum(x**2 for x in slips)
        mu = self.coefficient(ca.SX(square), params)
        if len(slips) == 1:
            return [-mu * ca.tanh(slips[0] / v_s)]
        speed = ca.sqrt(square + (ROUNDED * v_s) ** 2)
        return [-mu * ca.tanh(speed / v_s) / speed * x for x in slips]


@dataclass(frozen=True, kw_only=True)
class Stribeck(Coulomb):
    r"""Dry friction, see :class:`~liouville.bodies.Coulomb`, that is higher at slow slips.

    .. math::

        \mu(s) = \mu + (\mu_\text{static} - \mu) \, e^{-(s / v_\text{stribeck})^2}

    Attributes
    ----------
    mu_static : float or callable
        The coefficient of friction at slow slips, not below `mu`.
    v_stribeck : float or callable
        The velocity by which it has fallen, well above ``v_s``.
    """

    mu_static: Value
    v_stribeck: Value

    def __post_init__(self) -> None:
        """Refuse what is no friction, and one that is lower at slow slips."""
        super().__post_init__()
        if not self.functions():
            check_size(f"{EXCESS} of friction", EXCESS, self._excess(None))

    def functions(self) -> dict[str, Callable[[Any], Any]]:
        """Return functions of the parameters, with the excess of the coefficient at slow slips."""
        found = super().functions()
        return found | {EXCESS: self._excess} if {"mu", "mu_static"} & {*found} else found

    def _excess(self, params: Any) -> ca.SX:
        mu, static = (column(x, params, 1) for x in (self.mu, self.mu_static))
        return static - mu

    def coefficient(self, square: ca.SX, params: Any) -> ca.SX:
        """Return the coefficient of friction at the square of a slip."""
        mu, static, v = (column(x, params, 1) for x in (self.mu, self.mu_static, self.v_stribeck))
        return mu + (static - mu) * ca.exp(-square / v**2)


def _ways(joint: Joint, names: Sequence[str], params: Any) -> ca.SX:
    """Return the matrix from rates to the parts of a slip."""
    friction = joint.friction[tuple(names)]
    if joint.kind == "screw":
        radius, pitch = column(friction.radius, params, 1), column(joint.sizes["pitch"], params, 1)
        along: ca.SX = ca.horzcat(radius**2, pitch) / ca.sqrt(radius**2 + pitch**2)
        return along
    turning = {*joint.angles, *SPINS}
    arms = [column(friction.radius, params, 1) if x in turning else ca.SX(1) for x in names]
    return ca.diag(ca.vertcat(*arms))


def _slips(
    joint: Joint, names: Sequence[str], at: Mapping[tuple[str, str], Any], params: Any
) -> list[ca.SX]:
    """Return the parts of a slip."""
    rates = ca.vertcat(*(at[joint.name, name][1] for name in names))
    return list(ca.vertsplit(ca.mtimes(_ways(joint, names, params), rates)))


def switches(joint: Joint) -> dict[str, tuple[tuple[str, ...], str, int]]:
    """Return where controlled steps end: by name the slip, a velocity and how many it passes.

    One slip passes them on both sides; several together are measured by their size, whose least
    value on the way through a reversal the search for events follows.
    """
    found = {}
    for names, friction in joint.friction.items():
        of = joint.name if len(joint.friction) == 1 else f"{joint.name}.{names[0]}"
        has_sides = len(names) == 1 or joint.kind == "screw"
        for velocity, edges in EDGES.items():
            if not hasattr(friction, velocity):
                continue
            both = [-k for k in edges] if has_sides else []
            for k in sorted([*both, *edges]):
                count = f"{k:+d}" if has_sides else f"{k}"
                found[f"slip {count} {velocity} of {of}"] = names, velocity, k
    return found


def edge(
    joint: Joint,
    names: tuple[str, ...],
    velocity: str,
    k: int,
    at: Mapping[tuple[str, str], Any],
    params: Any,
) -> ca.SX:
    """Return a slip beyond k of a velocity; of several in its units, their square beyond k^2."""
    unit = column(getattr(joint.friction[names], velocity), params, 1)
    slips = _slips(joint, names, at, params)
    if len(slips) == 1:
        return slips[0] - k * unit
    return ca.SX(sum(x**2 for x in slips) / unit**2 - k**2)


def reversal(slip: Rubbing, n: ca.SX) -> dict[str, Callable[..., ca.SX]]:
    """Return where controlled steps end as what presses a slip turns, where |n| has a kink.

    A single direction passes zero; several together are measured by their size, whose least value
    on the way through zero the search for events follows.
    """
    one = [k for k in range(n.numel()) if slip.press[k, :].nnz()]
    own = n[one[0]] if len(one) == 1 else ca.dot(n, n) / slip.least - WIDTH**2
    of = f"{slip.name}.{next(iter(slip.forces))}"
    return {f"normal force of {of}": lambda *_: own}


@dataclass(frozen=True)
class Rubbing:
    """A slip with friction in the expressions of a model.

    Attributes
    ----------
    name : str
        The joint's.
    forces : dict of str to SX
        The effort along each coordinate for a normal force of one.
    rates : list of SX
        Their rates.
    press : SX
        The matrix from multipliers to what presses, one row a direction.
    least : SX
        The square of what normal forces are rounded off below.
    """

    name: str
    forces: dict[str, ca.SX]
    rates: list[ca.SX]
    press: ca.SX
    least: ca.SX


def rubbed(
    group: Group,
    k: int,
    rows: Sequence[str],
    coordinates: Mapping[tuple[str, str], Any],
    gravity: ca.SX,
) -> list[Rubbing]:
    """Return the slips of joint k of a group, of a system with constraints named `rows`."""
    joint: Joint = group.items[k]
    _check_plane(joint, gravity)
    params, found = group.params, []
    for names, friction in joint.friction.items():
        slips = _slips(joint, names, coordinates, params)
        along = ca.vertcat(*friction.forces(slips, params))
        forces = ca.vertsplit(ca.mtimes(_ways(joint, names, params).T, along))
        rates = [coordinates[joint.name, name][1] for name in names]
        pressing, directions = _pressing(group, k, names, friction)
        own = [j for j, name in enumerate(pressing) if f"{joint.name}.{name}" in rows]
        press = ca.SX(directions.shape[0], len(rows))
        for j in own:
            press[:, rows.index(f"{joint.name}.{pressing[j]}")] = directions[:, j]
        least = _least(joint, friction, gravity, params)
        efforts = dict(zip(names, forces, strict=True))
        found.append(Rubbing(joint.name, efforts, rates, press, least))
    return found


def _check_plane(joint: Joint, gravity: ca.SX) -> None:
    """Refuse friction that a force across the plane of planar bodies presses."""
    is_pressed = joint.kind == "planar" or (joint.kind != "revolute" and not gravity[2].is_zero())
    if not (joint.friction and is_planar(joint) and is_pressed):
        return
    why = "" if joint.kind == "planar" else ", where gravity has a part along z"
    what = f"friction= of joint '{joint.name}': planar bodies do not know the force across their "
    hint = "take spatial bodies, m.body: they slide on what holds them in the plane"
    raise ValueError(hinted(f"{what}plane, which presses it{why}", hint))


def _least(joint: Joint, friction: Coulomb, gravity: ca.SX, params: Any) -> ca.SX:
    """Return the square of what normal forces are rounded off below."""
    if friction.force_s is not None:
        return column(friction.force_s, params, 1) ** 2
    masses = [column(x.mass, params, 1) for x in (joint.a, joint.b) if x.kind != "ground"]
    mass = masses[0] if len(masses) == 1 else ca.fmin(*masses)
    v_s, places = column(friction.v_s, params, 1), (joint.a.at, joint.b.at, *joint.points)
    spread = np.array([x for x in places if not callable(x)] or [np.zeros(3)])
    size = ca.SX(float(np.ptp(spread, axis=0).max()))
    if friction.radius is not None:
        size = size + column(friction.radius, params, 1)
    elif size.is_zero():
        size = ca.SX(1)
    turning = OF_TURNING * v_s**2 / size
    found: ca.SX = mass**2 * (OF_WEIGHT**2 * ca.sumsqr(gravity) + turning**2)
    return found


def _pressing(
    group: Group, k: int, names: tuple[str, ...], friction: Coulomb
) -> tuple[tuple[str, ...], ca.SX]:
    """Return the rows whose reactions press a slip, and what they press, one row a direction."""
    joint: Joint = group.items[k]
    if joint.kind == "guide":
        place = ca.SX.sym("place", 3)
        rows = group.guiding(k, place)
        slopes = ca.densify(ca.jacobian(rows, place))
        at = ca.vertcat(*(group.along(group.axis(0, axis))[k] for axis in range(3)))
        names = tuple(str(j) for j in range(rows.numel()))
        return names, ca.substitute(slopes.T, place, at)
    if joint.kind in ("revolute", "universal"):  # rows are the world's
        second = names == ("second angle",)
        across = (
            [group.axis(1, axis) for axis in (1, 2)]
            if second
            else [group.axis(0, axis) for axis in (0, 1)]
        )
        return AT, ca.vertcat(*(ca.horzcat(*(x[k] for x in axis)) for axis in across))
    if isinstance(group, Compound):
        along = group.along_of(joint.coordinates.index(names[0]))
        own = ca.vertcat(*(x[k] for x in along))
        return AT, ca.SX.eye(3) - ca.mtimes(own, own.T)
    if joint.kind == "screw":
        radius, pitch = (
            column(x, group.params, 1) for x in (friction.radius, joint.sizes["pitch"])
        )
        steep = ca.sqrt(1 + (pitch / radius) ** 2)
        return (*ALONG, "thread"), ca.diag(ca.vertcat(1, 1, steep))
    pressing = {"spherical": AT, "planar": ("off_z",)}.get(joint.kind, ALONG)
    return pressing, ca.SX.eye(len(pressing))
