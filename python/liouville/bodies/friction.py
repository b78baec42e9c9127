r"""Friction in joints, whose normal force is the joint's own reaction.

The multipliers that a method finds are no arguments of forces. But the motion determines them: with
all forces, friction among them, they solve

.. math::

    M a + G^T \lambda = F + \sum_j N_j d_j(t, q, v), \qquad G a = -\gamma,

where the normal force :math:`N_j = |E_j \lambda|` is a length of the joint's own multipliers. So
:math:`\lambda` is affine in the :math:`N_j`, and these are found from :math:`(t, q, v)` alone: the
one of a single joint by a quadratic equation, several one after another in turn. Friction is then
a force as any other: it keeps the order of a method and its constraints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from liouville import _casadi as ca
from liouville.bodies.body import Value, column, given
from liouville.bodies.joints import SPINS, Group, Joint
from liouville.errors import hinted
from liouville.systems._derivatives import jacobian, solve

#: Normal forces of several joints are found in turn, this many times.
TURNS = 16
#: The slip of several coordinates is rounded off below this part of the velocity v_s.
ROUNDED = 1e-4

#: Controlled steps end where a slip passes so many v_s, the flanks of a reversal.
EDGES = (-8, -3, -1, 1, 3, 8)

#: The coordinates that friction acts along, and the rows whose reactions press, by kind of joint.
RUBBING: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "revolute": (("angle",), ("x", "y", "z")),
    "prismatic": (("slide",), ("off_x", "off_y")),
    "cylindrical": (("angle", "slide"), ("off_x", "off_y")),
    "spherical": (SPINS, ("x", "y", "z")),
    "planar": (("slide_x", "slide_y"), ("off_z",)),
}
#: Kinds of joints whose slip is a turn about a pin or a ball with a radius.
TURNING = ("revolute", "cylindrical", "spherical")


@dataclass(frozen=True, kw_only=True)
class Coulomb:
    r"""Dry friction that knows its normal force N, regularised: ``friction=`` of a joint.

    .. math::

        F = -\mu N \tanh\!\left(\frac{|s|}{v_s}\right) \frac{s}{|s|}

    N is the size of the joint's force across its axis, of a ball joint of all of it, of a planar
    joint along its normal. The slip s is the velocity of a slide, of a turn the rate times the
    radius, of both together in a cylindrical joint. Torques that a joint holds add nothing to N.
    A joint does not stick: at rest under a load it creeps, slower than ``v_s``.

    Attributes
    ----------
    mu : float or callable
        The coefficient of friction, or a function of the parameters.
    v_s : float or callable
        The velocity below which friction is smoothed, above zero.
    radius : float or callable, optional
        Of the pin or ball, for joints that turn.
    force_s : float or callable, default 1e-6
        Normal forces are rounded off below this: :math:`N = \sqrt{|n|^2 + f_s^2}`.

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
    force_s: Value = 1e-6

    def __post_init__(self) -> None:
        """Refuse what is no friction."""
        for name in ("mu", "v_s", "radius", "force_s", "mu_static", "v_stribeck"):
            value = getattr(self, name, None)
            if value is None or callable(value):
                continue
            number = float(given(f"{name}= of friction", value, ()))
            least = "not negative" if name.startswith("mu") else "positive"
            if number < 0 or (number == 0 and least == "positive"):
                raise ValueError(f"{name}= of friction is {number:g}, and wants to be {least}")

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
        The coefficient of friction at slow slips.
    v_stribeck : float or callable
        The velocity by which it has fallen, well above ``v_s``.
    """

    mu_static: Value
    v_stribeck: Value

    def coefficient(self, square: ca.SX, params: Any) -> ca.SX:
        """Return the coefficient of friction at the square of a slip."""
        mu, static, v = (column(x, params, 1) for x in (self.mu, self.mu_static, self.v_stribeck))
        return mu + (static - mu) * ca.exp(-square / v**2)


def check_friction(of: str, kind: str, friction: Any) -> None:
    """Refuse friction that a joint cannot have."""
    if friction is None:
        return
    if not isinstance(friction, Coulomb):
        hint = "write lv.bodies.Coulomb(mu=0.2, v_s=1e-3, radius=0.01) or lv.bodies.Stribeck"
        raise TypeError(hinted(f"friction= of {of} is {friction!r}", hint))
    turns = kind in TURNING
    if turns == (friction.radius is None):
        missing = "wants the radius of its pin" if turns else "slides, and has no radius"
        raise ValueError(f"friction= of {of}: the joint {missing}")


@dataclass(frozen=True)
class Contact:
    """A joint with friction in the expressions of a model.

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
        Normal forces are rounded off below this.
    """

    name: str
    forces: dict[str, ca.SX]
    rates: list[ca.SX]
    press: ca.SX
    least: ca.SX


def contact(
    group: Group, k: int, rows: Sequence[str], coordinates: Mapping[tuple[str, str], Any]
) -> Contact:
    """Return joint k of a group as a contact, of a system with constraints named `rows`."""
    joint: Joint = group.items[k]
    friction, params = joint.friction, group.params
    assert friction is not None
    names, pressing = RUBBING[joint.kind]
    rates = [coordinates[joint.name, name][1] for name in names]
    arms = [
        ca.SX(1) if name.startswith("slide") else column(friction.radius, params, 1)
        for name in names
    ]
    slips = [arm * rate for arm, rate in zip(arms, rates, strict=True)]
    forces = zip(names, arms, friction.forces(slips, params), strict=True)
    found = {name: arm * force for name, arm, force in forces}
    own = [name for name in pressing if f"{joint.name}.{name}" in rows]
    directions = ca.SX.eye(len(own))
    if joint.kind == "revolute":  # its rows are the world's
        across = [group.axis(0, axis) for axis in (0, 1)]
        directions = ca.vertcat(
            *(ca.horzcat(*(axis["xyz".index(name)][k] for name in own)) for axis in across)
        )
    press = ca.SX(directions.shape[0], len(rows))
    for j, name in enumerate(own):
        press[:, rows.index(f"{joint.name}.{name}")] = directions[:, j]
    return Contact(joint.name, found, rates, press, column(friction.force_s, params, 1))


def normal_forces(
    contacts: Sequence[Contact],
    mass: ca.SX,
    force: ca.SX,
    slopes: ca.SX,
    gamma: ca.SX,
    v: ca.SX,
) -> list[ca.SX]:
    r"""Return the normal forces of contacts, of M a + G^T lam = F + friction and G a = -gamma.

    With S = G M^-1 G^T the multipliers are :math:`\lambda_0 + \sum_j N_j \Lambda_j`, where
    :math:`S \lambda_0 = G M^{-1} F + \gamma` and :math:`S \Lambda_j = G M^{-1} d_j`.
    """
    pushes = [
        ca.jtimes(ca.vertcat(*x.rates), v, ca.vertcat(*x.forces.values()), True) for x in contacts
    ]
    weighted = solve(mass, slopes.T)  # M^-1 G^T
    right = ca.mtimes(weighted.T, ca.horzcat(force, *pushes))
    right[:, 0] += gamma
    parts = ca.horzsplit(ca.ldl_solve(right, *ca.ldl(ca.mtimes(slopes, weighted))))
    found = [ca.SX(0)] * len(contacts)
    for _ in range(1 if len(contacts) == 1 else TURNS):
        for k, x in enumerate(contacts):
            others = [
                N * own for j, (N, own) in enumerate(zip(found, parts[1:], strict=True)) if j != k
            ]
            found[k] = _root(x, sum(others, parts[0]), parts[1 + k])
    return found


def _root(x: Contact, rest: ca.SX, own: ca.SX) -> ca.SX:
    """Return the N > 0 of N^2 = |E (rest + N own)|^2 + least^2, nan where friction can jam."""
    pressed, more = ca.mtimes(x.press, rest), ca.mtimes(x.press, own)
    scale = ca.sqrt(1 - ca.dot(more, more))
    half = ca.dot(pressed, more) / scale
    found: ca.SX = (half + ca.sqrt(half**2 + ca.dot(pressed, pressed) + x.least**2)) / scale
    return found


def multipliers(
    energy: ca.SX, force: ca.SX, g: ca.SX, k: ca.SX, at: tuple[ca.SX, ca.SX, ca.SX]
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return M, F, G and gamma of a Lagrangian, its forces and its constraints at (t, q, v)."""
    t, q, v = at

    def rate(x: ca.SX) -> ca.SX:
        return ca.jtimes(x, ca.vertcat(t, q), ca.vertcat(1, v))

    p = ca.gradient(energy, v)
    w = rate(g)
    slopes = ca.vertcat(jacobian(g, q), jacobian(k, v))
    return (
        jacobian(p, v),
        ca.gradient(energy, q) + force - rate(p),
        slopes,
        ca.vertcat(rate(w), rate(k)),
    )
