"""The way of each kind of system, with a method it takes, to a run of the core and back.

A route checks what was asked, starts the run, and knows what its records mean.
"""

from __future__ import annotations

from typing import Any

from liouville.errors import hinted
from liouville.methods import (
    HHT,
    METHODS,
    ArnoldBruls,
    Composition,
    GeneralizedAlpha,
    LobattoPair,
    Method,
    SchrodingerSplitting,
    Spark,
    VolumeSplitting,
    WaveMethod,
)
from liouville.planner import Plan
from liouville.propagation import Propagation
from liouville.routes.field import FieldRoute as FieldRoute
from liouville.routes.mechanical import MechanicalRoute as MechanicalRoute
from liouville.routes.members import MembersRoute as MembersRoute
from liouville.routes.route import Asked as Asked
from liouville.routes.route import Route as Route
from liouville.routes.route import threads_of
from liouville.routes.semi_explicit import SemiExplicitRoute as SemiExplicitRoute
from liouville.routes.wave import WaveRoute as WaveRoute
from liouville.systems import Mechanics, PolynomialField, Schrodinger, SemiExplicit, System


def route(system: System, method: Method | Plan | Propagation | str, asked: Asked) -> Route:
    """Find the route of a system by a method.

    Raises
    ------
    TypeError
        One of them is no such thing, or the method does not step such a system.
    """
    if not isinstance(system, Mechanics | SemiExplicit | PolynomialField | Schrodinger):
        raise TypeError(
            "system is a Lagrangian, Hamiltonian, Mechanical, Structure, SemiExplicit, "
            f"PolynomialField or Schrodinger, not {system!r}"
        )
    if not isinstance(asked.states, bool):
        raise TypeError(f"states is True or False, not {asked.states!r}")
    threads_of(asked.threads)
    if not isinstance(system, Mechanics):
        for name, value in (("t_eval", asked.t_eval), ("events", asked.events)):
            if value is not None:
                raise TypeError(f"{name} is for a mechanical system, not for {system!r}")
    if isinstance(system, Schrodinger):
        if isinstance(method, str) and method == "auto":
            method = SchrodingerSplitting()
        if isinstance(method, WaveMethod | Propagation):
            return WaveRoute(system, method, asked)
        raise _no_route(method, "wave", "Schrödinger equations")
    if asked.tol is not None:
        hint = "give h or steps; HHT and its relatives take rtol= too"
        raise TypeError(hinted("tol is for a Schrodinger equation", hint))
    if isinstance(system, PolynomialField):
        if isinstance(method, VolumeSplitting | Plan):
            return FieldRoute(system, method, asked)
        raise _no_route(method, "field", "polynomial fields")
    if isinstance(system, SemiExplicit):
        if asked.is_ensemble:
            raise TypeError(
                hinted(
                    f"there are no ensembles of {system!r} so far",
                    "integrate its members one by one",
                )
            )
        if isinstance(method, Spark | Composition):
            base = method.base if isinstance(method, Composition) else method
            if isinstance(base, Spark) and base.points == "gauss" and base.newton_tol is None:
                return SemiExplicitRoute(system, method, asked)
        raise TypeError(
            f"{method!r} does not step semi-explicit systems; methods that do: Spark on Gauss "
            "points without a newton_tol, alone or in a Composition"
        )
    if isinstance(method, Spark | LobattoPair | HHT | GeneralizedAlpha | ArnoldBruls | Composition):
        way = MembersRoute if asked.is_ensemble else MechanicalRoute
        return way(system, method, asked)
    raise _no_route(method, "mechanical", "mechanical systems")


def _no_route(method: Any, form: str, systems: str) -> TypeError:
    mechanical = ("general", "second order")
    forms = mechanical if form == "mechanical" else (form,)
    known = [cls.__name__ for cls in METHODS.values() if cls.form in forms]
    known += {"field": ["Plan"], "mechanical": ["Composition"], "wave": ["Propagation"]}[form]
    return TypeError(f"{method!r} does not step {systems}; methods that do: {', '.join(known)}")
