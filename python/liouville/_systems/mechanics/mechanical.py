"""Mechanical systems by their Lagrangian, their Hamiltonian, or their own functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._systems.mechanics.form import Model
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.mechanics.nonholonomic import check_felt, rolling, rolling_of_z
from liouville._systems.mechanics.traced import (
    Function,
    check_moved,
    traced_invariants,
    traced_switches,
)
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Symbols
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._systems.mechanics.contact import Contact


class Lagrangian(Mechanics):
    r"""A system with Lagrangian :math:`L(t, q, v)`, constraints and extra forces.

    .. math::

        q' = v, \quad \frac{d}{dt} L_v(t, q, v) = L_q + Q(t, q, v) - g_q^T \lambda, \quad
        0 = g(t, q)

    Parameters
    ----------
    lagrangian : callable
        ``lagrangian(t, q, v, params)``, a scalar.
    constraint : callable, optional
        ``constraint(t, q, params)``: a scalar, a sequence of m, or a dict that names them.
    nonholonomic : callable, optional
        ``nonholonomic(t, q, v, params)``, constraints :math:`0 = k(t, q, v)` on the velocities that
        are no derivatives of such on q alone: a scalar, a sequence of l, or a dict that names them.
        They add the reactions :math:`-k_v^T \nu`; their multipliers :math:`\nu` come after
        :math:`\lambda` in ``solution.lam``. Methods: :class:`~liouville.Spark`,
        :class:`~liouville.LobattoPair` and compositions of them.
    q : sequence of str, or int
        Names of the n coordinates, or their number.
    params : mapping of str to float or 1-D array_like, optional
        Parameters by name, with default values; the functions see ``params.name``.
    force : callable, optional
        ``force(t, q, v, params)``: the n generalised forces Q that do not come from L.
    invariants : mapping of str to callable, optional
        Quantities ``f(t, q, v, params)`` to record besides "energy", :math:`v^T L_v - L`, whose
        name is taken.
    switches : mapping of str to callable, optional
        Functions ``f(t, q, v, params)`` at whose zeros forces bend sharply, such as the edges of a
        regularised friction. Steps controlled by their errors end there, and the next one is as
        short as the first; equal and reversible steps do not see them.
    contacts : mapping of str to Contact, optional
        Unilateral contacts by name, with impacts and dry friction; see :class:`~liouville.Contact`.
    impacts : {"poisson", "newton", "sequence"}
        The law of their impacts. Newton's may gain energy where several contacts with friction hit
        at once, which ``solution.message`` says then. In a sequence contacts that touch hit one
        after another by Poisson's law, those that approach fastest first, as in Newton's cradle.

    Raises
    ------
    TypeError, ValueError
        A function returns the wrong number of values, or uses an operation without a place on a
        tape.

    References
    ----------
    :cite:t:`jay2007`; :cite:t:`jay2009lagrange` for nonholonomic constraints.

    Examples
    --------
    >>> import casadi as ca
    >>> import liouville as lv
    >>> pendulum = lv.Lagrangian(
    ...     lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
    ...     lambda t, q, params: ca.dot(q, q) - 1,
    ...     q=("x", "y"),
    ...     params={"g": 9.81},
    ... )
    >>> pendulum
    Lagrangian(x, y; 1 constraint)
    """

    def __init__(
        self,
        lagrangian: Function,
        constraint: Function | None = None,
        *,
        nonholonomic: Function | None = None,
        q: Sequence[str] | int,
        params: Mapping[str, ArrayLike] | None = None,
        force: Function | None = None,
        invariants: Mapping[str, Function] | None = None,
        switches: Mapping[str, Function] | None = None,
        contacts: Mapping[str, Contact] | None = None,
        impacts: str = "poisson",
    ) -> None:
        coordinates, s = declared(q, ("q", "v"), params)
        args = s.args
        L = _trace.scalar("lagrangian", lagrangian, args)
        p, extra = ca.gradient(L, s.z), _force(force, args, len(coordinates))
        own_force = ca.gradient(L, s.y)
        f = own_force + extra
        names, g, lam, g_y = holonomic(constraint, s)
        more, own = rolling(nonholonomic, s, s.z, names)
        super().__init__(
            s,
            Model(
                v=s.z,
                p=p,
                f=f,
                r=ideal(g, s, lam),
                g=g,
                lam=lam,
                is_ideal=True,
                nonholonomic=own,
                g_y=g_y,
                force=(own_force, extra),
            ),
            states=("q", "v"),
            coordinates=coordinates,
            constraints=names + more,
            invariants=traced_invariants(invariants, args, ca.dot(s.z, p) - L),
            power=extra_power(extra, s.z, -jacobian(L, s.t), g, s, lam),
            switches=traced_switches(switches, args),
        )
        self._touch(contacts, impacts)


class Hamiltonian(Mechanics):
    r"""A system with Hamiltonian :math:`H(t, q, p)`, constraints and extra forces.

    .. math::

        q' = H_p, \quad p' = -H_q + Q(t, q, p) - g_q^T \lambda, \quad 0 = g(t, q)

    Parameters
    ----------
    hamiltonian : callable
        ``hamiltonian(t, q, p, params)``, a scalar.
    constraint, q, params
        As for :class:`Lagrangian`.
    nonholonomic : callable, optional
        ``nonholonomic(t, q, v, params)`` as for :class:`Lagrangian`, with :math:`v = H_p`.
    force : callable, optional
        ``force(t, q, p, params)``: the n generalised forces Q that do not come from H.
    invariants : mapping of str to callable, optional
        Quantities ``f(t, q, p, params)`` to record besides "energy", which is H; that name is
        taken.
    contacts, impacts
        As for :class:`Lagrangian`; slips are functions of the velocities :math:`v = H_p`.

    Raises
    ------
    TypeError, ValueError
        As for :class:`Lagrangian`.

    Examples
    --------
    >>> import liouville as lv
    >>> system = lv.Hamiltonian(lambda t, q, p, params: (p[0] ** 2 + q[0] ** 2) / 2, q=("x",))
    >>> run = lv.integrate(system, lv.Spark(2), t=(0, 10), h=0.1, q=[1.0], p=[0.0])
    >>> bool(run.invariant_drift("energy").max() < 1e-14)
    True
    """

    def __init__(
        self,
        hamiltonian: Function,
        constraint: Function | None = None,
        *,
        nonholonomic: Function | None = None,
        q: Sequence[str] | int,
        params: Mapping[str, ArrayLike] | None = None,
        force: Function | None = None,
        invariants: Mapping[str, Function] | None = None,
        contacts: Mapping[str, Contact] | None = None,
        impacts: str = "poisson",
    ) -> None:
        coordinates, s = declared(q, ("q", "p"), params)
        args = s.args
        H = _trace.scalar("hamiltonian", hamiltonian, args)
        v, extra = ca.gradient(H, s.z), _force(force, args, len(coordinates))
        f = -ca.gradient(H, s.y) + extra
        names, g, lam, g_y = holonomic(constraint, s)
        more, own = rolling(nonholonomic, s, v, names)
        super().__init__(
            s,
            Model(
                v=v,
                p=s.z,
                f=f,
                r=ideal(g, s, lam),
                g=g,
                lam=lam,
                is_ideal=True,
                nonholonomic=own,
                g_y=g_y,
            ),
            states=("q", "p"),
            coordinates=coordinates,
            constraints=names + more,
            invariants=traced_invariants(invariants, args, H),
            power=extra_power(extra, v, jacobian(H, s.t), g, s, lam),
        )
        self._touch(contacts, impacts)


class Mechanical(Mechanics):
    r"""The general system, from its own functions v, p, f, r and g.

    .. math::

        y' = v(t, y, z), \quad \frac{d}{dt} p(t, y, z) = f(t, y, z) + r(t, y, \lambda), \quad
        0 = g(t, y)

    where p may be nonlinear in z and r nonlinear in :math:`\lambda`; :math:`p_z` and
    :math:`g_y v_z p_z^{-1} r_\lambda` are invertible. Nonholonomic constraints
    :math:`0 = k(t, y, z)` add reactions :math:`r_n(t, y, z, \nu)`.

    Parameters
    ----------
    velocity, momentum, force : callable
        ``f(t, y, z, params)``, n values each.
    reaction : callable, optional
        ``reaction(t, y, lam, params)``, n values; :math:`-g_y^T \lambda` unless given.
    constraint : callable, optional
        ``constraint(t, y, params)``: a scalar, a sequence of m, or a dict that names them.
    nonholonomic : callable, optional
        ``nonholonomic(t, y, z, params)``: a scalar, a sequence of l, or a dict that names them.
    nonholonomic_reaction : callable, optional
        ``nonholonomic_reaction(t, y, z, lam, params)`` with the l multipliers of these constraints,
        n values; :math:`-(\partial k / \partial v)^T \nu` unless given.
    y : sequence of str, or int
        Names of the n coordinates, or their number.
    params : mapping of str to float or 1-D array_like, optional
        As for :class:`Lagrangian`.
    invariants : mapping of str to callable, optional
        Quantities ``f(t, y, z, params)`` to record.
    contacts, impacts
        As for :class:`Lagrangian`.

    Raises
    ------
    TypeError, ValueError
        As for :class:`Lagrangian`.

    References
    ----------
    :cite:t:`jay2007`.

    Examples
    --------
    >>> import liouville as lv
    >>> system = lv.Mechanical(
    ...     velocity=lambda t, y, z, params: z,
    ...     momentum=lambda t, y, z, params: z,
    ...     force=lambda t, y, z, params: -y,
    ...     y=("x",),
    ... )
    >>> run = lv.integrate(system, lv.Spark(3), t=(0, 10), h=0.1, y=[1.0], z=[0.0])
    >>> f"{run.y[-1, 0]:.6f}"  # cos 10
    '-0.839072'
    """

    def __init__(
        self,
        *,
        velocity: Function,
        momentum: Function,
        force: Function,
        reaction: Function | None = None,
        constraint: Function | None = None,
        nonholonomic: Function | None = None,
        nonholonomic_reaction: Function | None = None,
        y: Sequence[str] | int,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Function] | None = None,
        contacts: Mapping[str, Contact] | None = None,
        impacts: str = "poisson",
    ) -> None:
        coordinates, s = declared(y, ("y", "z"), params)
        args, n = s.args, len(coordinates)
        v, p, f = (
            _trace.column(what, function, args, n)
            for what, function in (("velocity", velocity), ("momentum", momentum), ("force", force))
        )
        names, g, lam, g_y = holonomic(constraint, s)
        if reaction is None:
            r = ideal(g, s, lam)
        else:
            given = {"t": s.t, "y": s.y, "lam": lam, "params": s.params}
            r = _trace.column("reaction", reaction, given, n)
            check_felt("reaction", r, lam, names)
        more, own = rolling_of_z(nonholonomic, nonholonomic_reaction, s, v, names)
        super().__init__(
            s,
            Model(
                v=v,
                p=p,
                f=f,
                r=r,
                g=g,
                lam=lam,
                is_ideal=reaction is None,
                nonholonomic=own,
                g_y=g_y,
            ),
            states=("y", "z"),
            coordinates=coordinates,
            constraints=names + more,
            invariants=traced_invariants(invariants, args),
        )
        self._touch(contacts, impacts)


def declared(
    coordinates: Sequence[str] | int,
    states: tuple[str, str],
    params: Mapping[str, ArrayLike] | None,
) -> tuple[tuple[str, ...], Symbols]:
    """Return the names of the coordinates and the symbols of a system, in the user's words."""
    found = _trace.names(coordinates, states[0])
    sizes = {"y": len(found), "z": len(found)}
    labels = dict(zip(sizes, states, strict=True))
    return found, Symbols(_trace.Parameters(params), sizes, labels)


def _force(force: Function | None, args: _trace.Args, n: int) -> ca.SX:
    if force is None:
        return ca.SX(n, 1)
    return _trace.column("force", force, args, n)


def holonomic(
    constraint: Function | None, s: Symbols
) -> tuple[tuple[str, ...], ca.SX, ca.SX, ca.SX]:
    """Trace holonomic constraints g: their names, g, their multipliers, and g_y."""
    if constraint is None:
        return (), ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, s.y.numel())
    t, y, _, params = s.args
    names, g = _trace.named("constraint", constraint, {k: s.args[k] for k in (t, y, params)})
    check_moved(names, g, s.y)
    return names, g, ca.SX.sym("lam", len(names)), jacobian(g, s.y)


def ideal(g: ca.SX, s: Symbols, lam: ca.SX) -> ca.SX:
    """-g_y^T lam: reactions that do no work."""
    if lam.numel() == 0:
        return ca.SX(s.y.numel(), 1)
    return -ca.jtimes(g, s.y, lam, True)


def extra_power(force: ca.SX, v: ca.SX, energy_t: ca.SX, g: ca.SX, s: Symbols, lam: ca.SX) -> ca.SX:
    """Q^T v + E_t + lam^T g_t: what changes the energy."""
    return ca.dot(force, v) + energy_t + ca.dot(lam, jacobian(g, s.t))
