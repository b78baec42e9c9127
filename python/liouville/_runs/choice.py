"""Runners: each takes a kind of system with a method through the core, and returns its records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.arguments import count
from liouville._basics.errors import hinted
from liouville._basics.options import check_options
from liouville._methods import (
    HHT,
    METHODS,
    ArnoldBruls,
    Composition,
    GeneralizedAlpha,
    LobattoPair,
    Method,
    Spark,
    VolumeSplitting,
    WaveMethod,
)
from liouville._runs.mechanics.mechanical import MechanicalRunner
from liouville._runs.mechanics.members import MembersRunner, SemiExplicitMembersRunner
from liouville._runs.mechanics.semi_explicit import SemiExplicitRunner
from liouville._runs.runner import Request, Runner
from liouville._systems import (
    Field,
    Mechanics,
    Schrodinger,
    SemiExplicit,
    System,
)

if TYPE_CHECKING:
    from liouville._methods.planner import Plan

#: The systems that can be integrated, and the methods that step mechanical ones.
SYSTEMS = (Mechanics, SemiExplicit, Field, Schrodinger)
MECHANICAL = (Spark, LobattoPair, HHT, GeneralizedAlpha, ArnoldBruls, Composition)

#: Stages of the method that "auto" takes, down to a tolerance and beyond; of equal steps the first.
STAGES, MOST_STAGES = ((3, 1e-3), (5, 1e-6), (7, 1e-9)), 8

#: Hints for systems without these options.
INSTEAD: dict[tuple[str, type], str] = {
    ("t_eval", Schrodinger): "t= takes the times of all states to keep",
    ("events", Schrodinger): "observe= records expectations <psi|A|psi>, of the diagonal or the "
    "matrix A, at each kept state: look for their zeros among these",
}


def runner_of(system: System, method: Method | Plan | str, request: Request) -> Runner:
    """Return the runner of a system by a method.

    Raises
    ------
    TypeError
        One of them is of the wrong kind, the method does not step such a system, or an argument is
        unknown.
    """
    if not isinstance(system, Mechanics):
        check_system(system)
    given, method = method, named(system, method, request.rtol)
    runner = _made(system, method, request)
    if isinstance(given, str) and given == "auto" and given is not method:
        runner.taken = f"the method taken is {method!r}"
    return runner


def _made(system: System, method: Method | Plan | str, request: Request) -> Runner:
    """Return the runner of a system by a method that is no name."""
    check_options(request.start, "ensemble" if request.is_ensemble else "integrate")
    if not isinstance(request.states, bool):
        raise TypeError(f"states must be True or False, not {request.states!r}")
    if request.threads is not None:
        count("threads", request.threads)
    if request.tangents is not None or request.has_pullback:
        from liouville._runs.tangents import check_covered

        check_covered(system, method, request)
    if isinstance(system, Mechanics):
        system.check_smooth("this computation")
        return _of_mechanics(system, method, request)
    if isinstance(system, SemiExplicit):
        return _of_semi_explicit(system, method, request)
    for (name, kind), hint in INSTEAD.items():
        if isinstance(system, kind) and getattr(request, name) is not None:
            raise TypeError(hinted(f"{name} is not for {system!r}", hint))
    if isinstance(system, Schrodinger):
        return _of_waves(system, method, request)
    times = {name: system.in_time(getattr(request, name)) for name in ("t", "h", "t_eval")}
    return _of_fields(system, method, replace(request, **times))


def check_system(system: Any) -> None:
    """Refuse what is no system."""
    if isinstance(system, SYSTEMS):
        return
    sentence = (
        "system must be a Lagrangian, Hamiltonian, Mechanical, Structure, SemiExplicit, "
        "PolynomialField, GriddedField, PotentialField, ChargedParticles or Schrodinger, "
        f"not {system!r}"
    )
    is_assembly = hasattr(system, "system")
    raise TypeError(hinted(sentence, "take its system()") if is_assembly else sentence)


def named(system: Any, method: Any, rtol: Any = None) -> Any:
    """Return the method that a name stands for, and any other as it is.

    "auto" of a wave is left as it is: its plan chooses among several.

    Raises
    ------
    TypeError
        No method is called so, or a class of methods is given.
    """
    if not isinstance(method, str) or (method == "auto" and isinstance(system, Schrodinger)):
        _check_method(method)
        return method
    if method in METHODS:
        cls: Any = METHODS[method]
        return cls()
    if method != "auto":
        _check_method(method)
        known = ", ".join(["auto", *METHODS])
        raise TypeError(hinted(f"method must be a method or its name, not {method!r}", known))
    if isinstance(system, Field):
        return VolumeSplitting()
    rtol = rtol if isinstance(rtol, float) else None
    return Spark(next((s for s, least in STAGES if rtol is None or rtol >= least), MOST_STAGES))


def _check_method(method: Any) -> None:
    """Refuse a class of methods, or its name, where one of them is wanted."""
    if isinstance(method, Method):
        return
    classes = [*METHODS.values(), Composition]
    named = next((cls for cls in classes if method in (cls, cls.__name__)), None)
    if named is not None:
        what = f"{named.__name__} is a class" if method is named else f"{method!r} is a word"
        raise TypeError(f"{what}: write lv.{named.__name__}({'...' * (named is Composition)})")


def _of_mechanics(system: Mechanics, method: Any, request: Request) -> Runner:
    if isinstance(method, MECHANICAL):
        kind = MembersRunner if request.is_ensemble else MechanicalRunner
        return kind(system, method, request)
    raise no_runner(method, "mechanical", "mechanical systems")


def _of_semi_explicit(system: SemiExplicit, method: Any, request: Request) -> Runner:
    kind = SemiExplicitMembersRunner if request.is_ensemble else SemiExplicitRunner
    if isinstance(method, Spark | Composition):
        base = method.base if isinstance(method, Composition) else method
        if isinstance(base, Spark) and base.newton_tol is None:
            return kind(system, method, request)
    raise TypeError(
        f"{method!r} does not step semi-explicit systems; methods that do: Spark without a "
        "newton_tol, alone or in a Composition"
    )


def _of_waves(system: Schrodinger, method: Any, request: Request) -> Runner:
    # imported here: runs of mechanics need neither planner nor splitting
    from liouville._methods.planner import WavePlan
    from liouville._methods.planner.waves.choice import AUTO
    from liouville._runs.waves.wave import WaveRunner

    if isinstance(method, str) and method == "auto":
        method = AUTO
    if not isinstance(method, WaveMethod | WavePlan):
        raise no_runner(method, "wave", "Schrödinger equations")
    if request.is_ensemble and (
        "potential" in request.start or _are_varied(system, request.params)
    ):
        from liouville._runs.waves.members import WaveMembersRunner

        return WaveMembersRunner(system, method, request)
    return WaveRunner(system, method, request)


def _are_varied(system: Schrodinger, params: Any) -> bool:
    """Return whether a parameter has a value for each member."""
    given = params.items() if isinstance(params, Mapping) else ()
    own = system.params
    return any(name in own and np.ndim(x) > np.ndim(own[name]) for name, x in given)


def _of_fields(system: Field, method: Any, request: Request) -> Runner:
    from liouville._methods.planner import FieldPlan
    from liouville._runs.fields.field import FieldRunner
    from liouville._systems.fields.particles import ChargedParticles
    from liouville._systems.fields.plane_field import PlaneField

    if not isinstance(method, VolumeSplitting | FieldPlan):
        kind = system.kind if isinstance(system, PlaneField) else "polynomial"
        raise no_runner(method, "field", f"{kind} fields")
    if isinstance(system, ChargedParticles):
        from liouville._runs.fields.particles import ParticleRunner

        return ParticleRunner(system, method, request)
    if not isinstance(system, PlaneField):
        return FieldRunner(system, method, request)
    from liouville._runs.fields.planes import PlaneRunner

    return PlaneRunner(system, method, request)


def no_runner(method: Any, form: str, systems: str) -> TypeError:
    """Return the error of a method that does not step systems of a form."""
    _check_method(method)
    mechanical = ("general", "second order")
    forms = mechanical if form == "mechanical" else (form,)
    known = [cls.__name__ for cls in METHODS.values() if cls.form in forms]
    known += {"field": ["a plan"], "mechanical": ["Composition"], "wave": ["a plan"]}[form]
    return TypeError(f"{method!r} does not step {systems}; methods that do: {', '.join(known)}")
