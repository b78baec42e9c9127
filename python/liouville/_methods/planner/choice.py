"""The planner of all systems that leave something to plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import count, interval, number, times_of
from liouville._basics.errors import hinted
from liouville._methods import SplitOperator, VolumeSplitting
from liouville._methods.control import equal_steps
from liouville._methods.planner.fields.choice import plan_field
from liouville._methods.planner.fields.plan import FieldPlan
from liouville._methods.planner.waves.choice import AUTO, plan_run
from liouville._methods.planner.waves.driven import Planned
from liouville._methods.planner.waves.plan import WavePlan
from liouville._systems import Field, PolynomialField, Schrodinger


@overload
def plan(
    system: Field,
    method: VolumeSplitting | None = None,
    *,
    h: float,
    x: ArrayLike,
    t: float | tuple[float, float] = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    trials: int = 50,
) -> FieldPlan: ...
@overload
def plan(
    system: Schrodinger,
    method: Planned | SplitOperator | str | None = None,
    *,
    t: ArrayLike,
    psi: ArrayLike | None = None,
    params: Mapping[str, ArrayLike] | None = None,
) -> WavePlan: ...
def plan(
    system: Field | Schrodinger,
    method: VolumeSplitting | Planned | SplitOperator | str | None = None,
    *,
    t: ArrayLike = 0.0,
    h: float | None = None,
    x: ArrayLike | None = None,
    psi: ArrayLike | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    trials: int = 50,
) -> FieldPlan | WavePlan:
    r"""Choose the open settings of a method, with reasons and costs, without a run.

    How to split a polynomial field is chosen by its structure, then by trial runs on the user's own
    states; how to propagate a wave function by bounds of the error and the number of products.
    :func:`liouville.integrate` does the same for a method that leaves something open. A plan of
    one's own can be printed, saved, and used for many runs.

    Parameters
    ----------
    system : PolynomialField, GriddedField, PotentialField or Schrodinger
        What is to be integrated.
    method : Method, optional
        What is fixed already; nothing by default. A ``VolumeSplitting`` for a field; for a wave
        function a ``SchrodingerSplitting``, ``Chebyshev``, ``Lanczos``, ``Magnus`` or
        ``SplitOperator``, with its ``tol``.
    t : float, or sequence of float
        Of a field the interval (t0, t1) of a run from the states x, whose own plan this is; or the
        time of the states, 0 by default. Of a wave function the times of the start and of all
        states to keep.
    h : float
        The step that the splitting of a field is to be good for.
    x : array_like, shape (n,) or (P, n)
        Typical states of a field, or starts of a run; up to 32 of them are tried.
    psi : array_like, shape (N,), optional
        Start of a wave function: a real one makes a Chebyshev series shorter, and on a grid a
        split operator, whose steps depend on the state, is tried with some steps.
    params : mapping, optional
        Parameters that differ from the system's defaults.
    seed : int, default 0
        Of the random search of a field. The same seed gives the same plan.
    trials : int, default 50
        How many orders of the pieces of a field are tried.

    Returns
    -------
    FieldPlan or WavePlan
        ``print`` it for the reasons, the pieces or the steps, and the cost.

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind or out of range, or the tolerance out of reach.

    Notes
    -----
    Splittings of a field are compared by cost times error to the power 1/order, the cost at equal
    error, over four steps of h and eight of h/2. Fields of more than 2000 variables are split by
    their structure alone. With an interval, states are tried that x passes through, over all of it
    or its first 16,000 steps; else x itself, and of a single state those of its next 128 steps. The
    bounds for wave functions are those of :doc:`/theory/schrodinger`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import euler_top
    >>> lv.plan(euler_top.system, h=0.1, x=[1.0, 0.5, 0.2]).method.composition
    'BM4'
    >>> chain = lv.Schrodinger(lv.Lattice(50))
    >>> lv.plan(chain, lv.SchrodingerSplitting(tol=1e-6), t=(0, 10)).products
    20.0
    """
    if isinstance(system, Field):
        _refuse(system, psi=psi)
        return _of_field(system.with_params(params), method, h, x, t, seed, trials)
    if isinstance(system, Schrodinger):
        _refuse(system, h=h, x=x)
        return _of_wave(system.with_params(params), method, t, psi)
    raise TypeError(f"a plan must be for a field or a Schrodinger equation, not {system!r}")


def _refuse(system: Any, **given: Any) -> None:
    """Refuse arguments that are for another kind of system."""
    for name, value in given.items():
        if value is not None:
            hint = f"leave {name} out"
            if name == "h":
                hint = "steps of a given size leave nothing to plan: give h to lv.integrate"
            raise TypeError(hinted(f"a plan for {system!r} takes no {name}=", hint))


def _of_field(
    system: Field, method: Any, h: Any, x: Any, t: Any, seed: Any, trials: Any
) -> FieldPlan:
    if not isinstance(method, VolumeSplitting | None):
        raise TypeError(f"{method!r} does not split fields: method is a VolumeSplitting")
    for name, value in (("h", h), ("x", x)):
        if value is None:
            raise TypeError(f"{name} is missing: a plan for a field takes h= and x=")
    t, h = system.in_time(t), system.in_time(h)
    if np.ndim(t) == 0:
        step, time, steps = number("h must be a number", h), number("t must be a number", t), None
        if not (np.isfinite(step) and step > 0):
            raise ValueError(f"h must be positive and finite, not {step}")
        if not np.isfinite(time):
            raise ValueError(f"t must be finite, not {time}")
    else:
        run = equal_steps(*interval(t, "of a run"), h, None)
        step, time, steps = run.mean(run.t1, run.count), run.t0, run.count
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed must be an integer from 0 on, not {seed!r}")
    states = np.atleast_2d(system.start({"x": x}, np.ndim(x) == 2))
    rows = system.extended(states, time)
    if not isinstance(system, PolynomialField):
        from liouville._methods.planner.fields.planes import plan_planes
        from liouville._systems.fields.plane_field import PlaneField

        assert isinstance(system, PlaneField)
        return plan_planes(system, method or VolumeSplitting(), step, rows)[0]
    from liouville._methods.planner.fields.particles import plan_particles
    from liouville._systems.fields.particles import ChargedParticles

    if isinstance(system, ChargedParticles):
        return plan_particles(system, method or VolumeSplitting(), step, rows)[0]
    found, _ = plan_field(
        system.terms, method or VolumeSplitting(), step, rows, steps, seed,
        count("trials", trials), system.variables,
    )  # fmt: skip
    return found


def _of_wave(system: Schrodinger, method: Any, t: Any, psi: Any) -> WavePlan:
    if method is None or (isinstance(method, str) and method == "auto"):
        method = AUTO
    if isinstance(method, SplitOperator) and method.tol is None:
        hint = "give it a tol=, or call lv.integrate with h= or steps="
        raise TypeError(hinted(f"{method!r} leaves nothing to plan", hint))
    if not isinstance(method, Planned | SplitOperator):
        kinds = "'auto', SchrodingerSplitting, Chebyshev, Lanczos, Magnus or SplitOperator"
        raise TypeError(f"method must be {kinds}, not {method!r}")
    return plan_run(system, method, times_of(t), None if psi is None else system.inward(psi))
