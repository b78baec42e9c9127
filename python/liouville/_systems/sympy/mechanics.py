r"""Models of SymPy's mechanics as systems.

Lagrange's method becomes a :class:`Lagrangian` of its own function. Of Kane's method the bodies,
loads and kinematical equations are taken, with all speeds independent: with :math:`q' = v(t, q, u)`
linear in the speeds, velocities y of all bodies and their partial velocities
:math:`N = y_u v_u^{-1}`,

.. math::

    p = N^T \mu y, \quad f = N^T Q + (dN/dt)^T \mu y

with masses and inertias :math:`\mu` and loads Q, gyroscopic torques among them; this is Kane's
equation times :math:`v_u^{-T}`, and p the canonical momentum whatever speeds were chosen.
Constraints on the configuration are holonomic; those on speeds that are not their rates are
nonholonomic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.mechanics.mechanical import Lagrangian, Mechanical
from liouville._systems.sympy.expressions import Reader, imported, name_of
from liouville._systems.tracing.trace import Parameters

#: Rates of constraints are those of others where they miss by less than this.
SAME = 1e-9


def from_sympy(
    method: Any,
    params: Mapping[Any, ArrayLike] | None = None,
    *,
    inputs: Mapping[Any, Callable[..., Any]] | None = None,
    invariants: Mapping[str, Callable[..., Any]] | None = None,
) -> Lagrangian | Mechanical:
    r"""Make a system of a model of ``sympy.physics.mechanics``.

    Nothing of SymPy's equations of motion is used, so they need not be formed. Constraints are not
    solved for dependent coordinates and speeds: all are unknowns, and constraints are kept to
    roundoff.

    Parameters
    ----------
    method : LagrangesMethod, KanesMethod or System
        The model with its constraints. A System of which Lagrange's equations have been formed is
        taken as that, any other as Kane's method.
    params : mapping of str or Symbol to float
        Values of all symbols.
    inputs : mapping of str or dynamicsymbol to callable, optional
        Functions of time that are no coordinates, as ``f(t, q, v, params)``; for Kane's method of
        the speeds u instead of v.
    invariants : mapping of str to callable, optional
        As for :class:`~liouville.Lagrangian`, or :class:`~liouville.Mechanical`.

    Returns
    -------
    Lagrangian or Mechanical
        Of Lagrange's method a Lagrangian, with states q and v; else a system with states y, the
        coordinates, and z, the speeds in the order of ``method.u``.

    Raises
    ------
    ImportError
        SymPy is not installed.
    TypeError, ValueError
        The model is none of these; a symbol has no value; there are more coordinates than speeds;
        bodies are unknown; an expression has what a model cannot have.

    Examples
    --------
    >>> import sympy
    >>> from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols
    >>> import liouville as lv
    >>> angle, g = dynamicsymbols("angle"), sympy.Symbol("g")
    >>> lagrangian = sympy.diff(angle, "t") ** 2 / 2 + g * sympy.cos(angle)
    >>> lv.from_sympy(LagrangesMethod(lagrangian, [angle]), params={"g": 9.81})
    Lagrangian(angle; 0 constraints)
    """
    mechanics = imported("sympy.physics.mechanics")
    if isinstance(method, mechanics.System):
        formed = method.eom_method
        if isinstance(formed, mechanics.LagrangesMethod):
            method = formed
        else:
            return _Kane(_of_system(method), params, inputs).system(invariants)
    if isinstance(method, mechanics.LagrangesMethod):
        return _lagrange(method, params, inputs, invariants)
    if isinstance(method, mechanics.KanesMethod):
        return _Kane(_of_kane(method), params, inputs).system(invariants)
    raise TypeError(
        hinted(
            "a model must be a LagrangesMethod, a KanesMethod or a System of SymPy's, "
            f"not {method!r}",
            "they are in sympy.physics.mechanics",
        )
    )


def _lagrange(method: Any, params: Any, inputs: Any, invariants: Any) -> Lagrangian:
    """Return the Lagrangian of Lagrange's method."""
    q = list(method.q)
    reader = Reader(q, [], [], params, inputs)
    none = ca.SX(0, 1)
    energy = reader.function("the Lagrangian", [method._L[0]])
    count = len(method._hol_coneqs)
    holonomic = reader.function("a holonomic constraint", list(method._hol_coneqs))
    others = list(method.coneqs)[count:]
    rolling = reader.function("a nonholonomic constraint", others)
    loads = _Loads(reader, method.forcelist, method.inertial)
    reader.check_params()

    def constraint(t: Any, q: Any, params: Any) -> Any:
        return holonomic(t, q, ca.SX.zeros(q.numel()), none, params)

    def force(t: Any, q: Any, v: Any, params: Any) -> Any:
        y, acting = loads.at(t, q, v, none, params)
        return ca.jtimes(y, v, acting, True)

    return Lagrangian(
        lambda t, q, v, params: energy(t, q, v, none, params)[0],
        constraint if count else None,
        nonholonomic=(lambda t, q, v, params: rolling(t, q, v, none, params)) if others else None,
        q=[name_of(x) for x in q],
        params=reader.params,
        force=force if loads.count else None,
        invariants=invariants,
    )


class _Loads:
    """Forces at points and torques on frames, with the velocities that they act along."""

    def __init__(self, reader: Reader, loads: Any, frame: Any) -> None:
        mechanics = imported("sympy.physics.mechanics")
        rates: list[Any] = []
        acting: list[Any] = []
        loads = list(loads or [])
        if loads and frame is None:
            raise ValueError("the method has loads and no inertial frame that they are of: frame=")
        for place, load in loads:
            what = place.frame if hasattr(place, "frame") else place
            is_frame = isinstance(what, mechanics.ReferenceFrame)
            rate = what.ang_vel_in(frame) if is_frame else what.vel(frame)
            along = list(rate.to_matrix(frame))
            if not reader.is_zero(along):  # else a reaction of the ground
                rates += along
                acting += list(load.to_matrix(frame))
        self.count = len(rates)
        self._rates = reader.function("the velocity of a load", rates)
        self._acting = reader.function("a load", acting)

    def at(self, *state: Any) -> tuple[ca.SX, ca.SX]:
        """Return velocities and loads, a column each."""
        return tuple(ca.vertcat(ca.SX(0, 1), *x(*state)) for x in (self._rates, self._acting))  # type: ignore[return-value]


def _of_kane(method: Any) -> dict[str, Any]:
    """Return the parts of a KanesMethod."""
    if not method.bodies:
        hint = "give them to KanesMethod(..., bodies=...), or call kanes_equations first"
        raise ValueError(hinted("the bodies of the method are not known", hint))
    rates = method.kindiffdict()
    speeds = list(method.u)
    rows = list(method._k_nh * method.u + method._f_nh) if method._f_nh else []
    return {
        "q": list(method.q),
        "u": speeds,
        "zeros": list(method._uaux),
        "kinematics": [rate - value for rate, value in rates.items()],
        "holonomic": list(method._f_h),
        "rows": rows,
        "bodies": method.bodies,
        "loads": method.forcelist,
        "frame": method._inertial,
    }


def _of_system(system: Any) -> dict[str, Any]:
    """Return the parts of a System."""
    if not system.bodies:
        raise ValueError("the system has no bodies")
    loads = [*system.loads, *(load for each in system.actuators for load in each.to_loads())]
    return {
        "q": list(system.q),
        "u": list(system.u),
        "zeros": list(system.u_aux),
        "kinematics": list(system.kdes),
        "holonomic": list(system.holonomic_constraints),
        "rows": list(system.velocity_constraints),
        "bodies": system.bodies,
        "loads": loads,
        "frame": system.frame,
    }


class _Kane:
    """The functions of a system, by Kane's method."""

    def __init__(self, parts: Mapping[str, Any], params: Any, inputs: Any) -> None:
        q, u = parts["q"], parts["u"]
        if len(q) != len(u):
            raise ValueError(
                hinted(
                    f"the speeds of the method must be as many as its {len(q)} coordinates, not "
                    f"{len(u)}",
                    "give dependent speeds and their constraints: u_dependent=, "
                    "velocity_constraints=",
                )
            )
        if len(parts["kinematics"]) != len(q):
            raise ValueError(
                f"the method must have {len(q)} kinematical differential equations, one for each "
                f"coordinate, not {len(parts['kinematics'])}"
            )
        self.coordinates = [name_of(x) for x in q]
        self.reader = Reader(q, u, parts["zeros"], params, inputs)
        read = self.reader.function
        self._kinematics = read("a kinematical differential equation", parts["kinematics"])
        self.holonomic = read("a holonomic constraint", parts["holonomic"])
        self._rows = read("a velocity constraint", parts["rows"])
        self._is_free = not parts["holonomic"]
        self.loads = _Loads(self.reader, parts["loads"], parts["frame"])
        self._read_bodies(parts["bodies"], parts["frame"])
        self.reader.check_params()
        self._nonholonomic = self._no_rates(len(parts["rows"]))

    def _read_bodies(self, bodies: Sequence[Any], frame: Any) -> None:
        """Read velocities of centres by the inertial frame and angular ones by the body's own."""
        velocities: list[Any] = []
        spins: list[Any] = []
        masses: list[Any] = []
        inertias: list[Any] = []
        for body in bodies:
            own = getattr(body, "frame", None) if hasattr(body, "central_inertia") else None
            velocity = list(body.masscenter.vel(frame).to_matrix(frame))
            spin = [] if own is None else list(own.ang_vel_in(frame).to_matrix(own))
            if not self.reader.is_zero(velocity):
                velocities += velocity
                masses.append(body.mass)
            if not self.reader.is_zero(spin):
                spins += spin
                inertias += list(body.central_inertia.to_matrix(own))
        read = self.reader.function
        self._velocities = read("the velocity of a body", velocities)
        self._spins = read("the angular velocity of a body", spins)
        self._masses, self._inertias = read("a mass", masses), read("an inertia", inertias)

    def velocity(self, t: Any, q: Any, u: Any, params: Any) -> Any:
        """Return q' by the kinematical differential equations."""
        rates = ca.SX.sym("rates", q.numel())
        rows = ca.vertcat(*self._kinematics(t, q, rates, u, params))
        slopes = ca.jacobian(rows, rates)
        if ca.depends_on(slopes, rates):
            raise ValueError("the kinematical differential equations are not linear in the rates")
        still = ca.substitute(rows, rates, ca.SX.zeros(q.numel()))
        return ca.densify(-ca.solve(slopes, still))

    def _momenta(self, t: Any, q: Any, u: Any, params: Any) -> tuple[Any, ...]:
        """Return q', N^T, mu y, and what turns act on mu y by gyroscopic torques."""
        rates = self.velocity(t, q, u, params)
        state = t, q, rates, u, params
        velocities = ca.vertcat(ca.SX(0, 1), *self._velocities(*state))
        spins = ca.vertcat(ca.SX(0, 1), *self._spins(*state))
        y = ca.vertcat(velocities, spins)
        own = (ca.repmat(ca.SX(x), 3, 1) for x in self._masses(*state))
        masses = ca.vertcat(ca.SX(0, 1), *own)
        entries = self._inertias(*state)
        momenta, gyration = [masses * velocities], [ca.SX(velocities.numel(), 1)]
        for k in range(len(entries) // 9):
            inertia = ca.reshape(ca.vertcat(*entries[9 * k : 9 * k + 9]), 3, 3).T
            spin = spins[3 * k : 3 * k + 3]
            momenta.append(ca.mtimes(inertia, spin))
            gyration.append(-ca.cross(spin, momenta[-1]))
        return rates, y, ca.vertcat(*momenta), ca.vertcat(*gyration)

    def _partial(self, rates: Any, y: Any, u: Any) -> Any:
        """Return N^T, the velocities' slopes by q'."""
        slopes = ca.jacobian(rates, u)
        found = ca.solve(slopes.T, ca.jacobian(y, u).T)
        if ca.depends_on(found, u):
            raise ValueError("velocities are not linear in the speeds")
        return found

    def momentum(self, t: Any, q: Any, u: Any, params: Any) -> Any:
        """Return p."""
        rates, y, momenta, _ = self._momenta(t, q, u, params)
        return ca.densify(ca.mtimes(self._partial(rates, y, u), momenta))

    def force(self, t: Any, q: Any, u: Any, params: Any) -> Any:
        """Return f."""
        rates, y, momenta, gyration = self._momenta(t, q, u, params)
        partial = self._partial(rates, y, u)
        along, loads = self.loads.at(t, q, rates, u, params)
        found = ca.mtimes(partial, gyration)
        if loads.numel():
            found += ca.mtimes(self._partial(rates, along, u), loads)
        # (dN/dt)^T momenta, with the momenta held
        held = ca.SX.sym("held", momenta.numel())
        product = ca.mtimes(partial, held)
        change = ca.jtimes(product, q, rates) + ca.jacobian(product, t)
        return ca.densify(found + ca.substitute(change, held, momenta))

    def nonholonomic(self, t: Any, q: Any, u: Any, params: Any) -> list[Any]:
        """Return the constraints on speeds that are no rates of holonomic ones."""
        found = self._rows(t, q, self.velocity(t, q, u, params), u, params)
        return [found[k] for k in self._nonholonomic]

    def _no_rates(self, count: int) -> list[int]:
        """Return the constraints on speeds that are no rates of holonomic ones."""
        if not count or self._is_free:
            return list(range(count))
        n = len(self.coordinates)
        params = Parameters(self.reader.params)
        t, q, u = ca.SX.sym("t"), ca.SX.sym("q", n), ca.SX.sym("u", n)
        rates = self.velocity(t, q, u, params.namespace)
        rows = ca.vertcat(*self._rows(t, q, rates, u, params.namespace))
        none = ca.SX.zeros(n)
        g = ca.vertcat(*self.holonomic(t, q, none, none, params.namespace))
        hidden = ca.jtimes(g, q, rates) + ca.jacobian(g, t)

        def wide(x: Any) -> Any:
            return ca.horzcat(ca.jacobian(x, u), ca.substitute(x, u, none))

        both = [ca.densify(wide(x)) for x in (rows, hidden)]
        function = ca.Function("rows", [t, q, u, params.vector], both)
        rng = np.random.default_rng(0)
        missed = np.zeros(count)
        for _ in range(3):
            at = rng.uniform(0.1, 1.0, 2 * n + 1)
            own, others = (
                np.array(x)
                for x in function(at[0], at[1 : n + 1], at[n + 1 :], params.values(None))
            )
            kept = others.T @ np.linalg.lstsq(others.T, own.T, rcond=1e-12)[0]
            scale = np.maximum(np.abs(own).max(axis=1), 1e-300)
            missed = np.maximum(missed, np.abs(kept.T - own).max(axis=1) / scale)
        return [k for k in range(count) if not missed[k] < SAME]

    def system(self, invariants: Any) -> Mechanical:
        """Return the system."""

        def constraint(t: Any, q: Any, params: Any) -> Any:
            still = ca.SX.zeros(q.numel())
            return self.holonomic(t, q, still, still, params)

        return Mechanical(
            velocity=self.velocity,
            momentum=self.momentum,
            force=self.force,
            constraint=None if self._is_free else constraint,
            nonholonomic=self.nonholonomic if self._nonholonomic else None,
            y=self.coordinates,
            params=self.reader.params,
            invariants=invariants,
        )
