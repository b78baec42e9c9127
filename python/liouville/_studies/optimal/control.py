"""Optimal control of mechanical systems by discrete mechanics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from liouville._basics.options import started
from liouville._methods import Method
from liouville._solution.solution import Solution
from liouville._studies.optimal.arguments import Times
from liouville._studies.optimal.problem import Problem
from liouville._studies.optimal.result import OptimalControl
from liouville._systems import Mechanics
from liouville._systems.tracing import trace as _trace

#: IPOPT's own options that are not its defaults. Steps are solved to roundoff, as those of a run.
#: Guesses are far from the motions of a mechanism, where line searches creep: after two short steps
#: some full ones are tried.
OPTIONS = {
    "watchdog_shortened_iter_trigger": 2,
    "watchdog_trial_iter_max": 8,
    "tol": 1e-11,
    "constr_viol_tol": 1e-10,
    "acceptable_tol": 1e-8,
    "acceptable_iter": 5,
    "acceptable_constr_viol_tol": 1e-8,
    "bound_relax_factor": 0.0,
    "max_iter": 500,
    "print_level": 0,
    "sb": "yes",
}


def optimal_control(
    system: Mechanics,
    method: Method | str = "auto",
    *,
    controls: Sequence[str],
    cost: Callable[..., Any] | None = None,
    final_cost: Callable[..., Any] | None = None,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    final: Mapping[str, Any] | Callable[..., Any] | None = None,
    final_time: tuple[float, float] | None = None,
    bounds: Mapping[str, Any] | None = None,
    path: Mapping[str, tuple[Callable[..., Any], Any, Any]] | None = None,
    free: Sequence[str] = (),
    guess: OptimalControl | Solution | Mapping[str, ArrayLike] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    options: Mapping[str, Any] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> OptimalControl:
    r"""Find the controls that drive a mechanical system at the least cost.

    .. math::

        \min_u \; \varphi(t_N, q_N, v_N) + \sum_{n < N} h \sum_{i=1}^s b_i\,
        l(T_{ni}, Q_{ni}, V_{ni}, u_{ni})

    over the motions of ``Spark(s)``: its step equations, with controls :math:`u_{ni}` at the Gauss
    stages, are the constraints of a sparse nonlinear program, which IPOPT solves with exact second
    derivatives. This is discrete mechanics and optimal control with constraints (DMOCC), of any
    order: cost, states, multipliers, and the controls at nodes converge with order 2s, since the
    conditions of optimality are the same method applied to those of Pontryagin. Momentum maps
    change by the impulse of the controls, and constraints hold, to what IPOPT leaves of the
    equations, which is roundoff.

    Parameters
    ----------
    system : Mechanics
        A Lagrangian, Hamiltonian, Mechanical, Structure or the system of an assembly, whose forces
        depend on parameters that become controls. Constraints may be redundant or depend on time.
    method : Spark or str
        With Gauss points, or its name, as for :func:`integrate`.
    controls : sequence of str
        The parameters that are functions of time; an array is as many controls.
    cost : callable, optional
        The running cost l, ``cost(t, q, v, params)``, a scalar, with the controls among `params`.
    final_cost : callable, optional
        The cost :math:`\varphi` of the end, ``final_cost(t, q, v, params)``; one of the two is
        needed.
    t : tuple of two floats
        Start and end.
    h : float, optional
        Step size; as for :func:`integrate` the least number of steps is made with this at most.
    steps : int, optional
        Number of steps N, instead of `h`.
    final : mapping or callable, optional
        Conditions at the end. A whole state, ``{"q": [...], "v": [...]}``, that satisfies the
        constraints; or entries by name, ``{"q": {"x": 0.0}}``, at most n - m of each, as the
        constraints imply the others; and functions ``f(t, q, v, params)`` that vanish, by name.
        With a free end a whole state is on the constraints at both limits of it.
    final_time : tuple of two floats, optional
        Limits of the end, which is free between them and begins with that of `t`.
    bounds : mapping, optional
        Least and largest values, ``{"F": (-10, 10), "q": {"x": (-1, 1)}, "v": (None, 2)}``, of
        controls at the stages, of states at the nodes and the stages, and of free parameters; None
        leaves a side open.
    path : mapping, optional
        Functions along the path with their limits, ``{"clear": (f, least, largest)}``: scalars or
        columns ``f(t, q, v, params)`` of states and controls, within the limits at the stages, and
        at the nodes where no control is in them; None leaves a side open. A bound that changes in
        time is such a function, ``(lambda t, q, v, params: q[0] - t, None, 0.0)``.
    free : sequence of str
        States of the start that are free within their bounds, on the constraints; IPOPT begins with
        those that are given. Also parameters, ``"params.m"``: numbers that are chosen with the
        controls, in no constraint, within their bounds ``{"m": (1, 2)}``; they are in the
        result's ``params``.
    guess : OptimalControl, Solution or mapping, optional
        Where IPOPT begins: another result, a run, or arrays by name with the times as their first
        axis, evenly spaced unless ``"t"`` is among them. By default states go straight from start
        to end, and controls have their parameters' values.
    params : mapping, optional
        Parameters that differ from their defaults; controls begin with theirs.
    options : mapping, optional
        IPOPT's own options, such as ``{"max_iter": 1000, "print_level": 5}``.
    start, **values : mapping, or array_like by name
        The start, on the constraints, as for :func:`integrate`.

    Returns
    -------
    OptimalControl
        Times, states, controls at nodes and stages, costates, and a run that repeats the motion.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong: a control that is no parameter or in no force, a cost that is no
        scalar, a start off the constraints, final conditions that repeat others.
    MemoryError
        So many steps do not fit in memory.
    OptimizationError
        IPOPT found no solution, as where no motion stays within the bounds, which the message then
        names; the error has its status, and the last iterate as ``result``.
    KeyboardInterrupt
        IPOPT was interrupted (Ctrl-C); CasADi keeps no iterate then.

    Notes
    -----
    Nonholonomic constraints are refused. A local minimum is found: another guess may give another.
    Of a whole final state other places that meet the same conditions, such as the opposite point of
    a circle, are kept out.

    References
    ----------
    :cite:t:`leyendecker2010`, :cite:t:`oberbloebaum2011`, :cite:t:`waechter2006`;
    :doc:`/theory/optimal_control`.

    Examples
    --------
    >>> import liouville as lv
    >>> cart = lv.Lagrangian(
    ...     lambda t, q, v, params: v[0] ** 2 / 2,
    ...     force=lambda t, q, v, params: [params.F],
    ...     q=("x",),
    ...     params={"F": 0.0},
    ... )
    >>> found = lv.optimal_control(
    ...     cart, lv.Spark(2), controls=("F",), cost=lambda t, q, v, params: params.F**2 / 2,
    ...     t=(0, 1), steps=4, q=[0.0], v=[0.0], final={"q": [1.0], "v": [0.0]},
    ... )
    >>> round(found.cost, 12), found.controls["F"].round(12)
    (6.0, array([ 6.,  3.,  0., -3., -6.]))
    """
    problem = Problem(
        system, method, controls, cost, final_cost, Times.of(t, h, steps, final_time), final,
        bounds, path, free, params, started(start, values),
    )  # fmt: skip
    return problem.solve(guess, {**OPTIONS, **_trace.mapping("options", options)})
