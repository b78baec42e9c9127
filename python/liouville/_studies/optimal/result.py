"""The result of an optimal control problem."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods import Spark
from liouville._runs.execute import finished
from liouville._runs.integrate import integrate
from liouville._solution.solution import Solution
from liouville._studies.optimal.arguments import Array, Controls
from liouville._studies.optimal.driven import driven, polynomials
from liouville._systems import Mechanics


@dataclass(frozen=True, eq=False, repr=False)
class OptimalControl:
    r"""An optimal motion of N steps with s stages, its controls and costates.

    Attributes
    ----------
    t : ndarray, shape (N + 1,)
        Times of the nodes, the ends of steps.
    states : dict of str to ndarray
        ``q``, ``v``, ``p`` of shape (N + 1, n) and ``lam`` of shape (N + 1, m), or the states that
        solutions of the system have; each also an attribute, ``result.q``.
    controls : dict of str to ndarray, shape (N + 1,) or (N + 1, k)
        Controls at the nodes, of order 2s: the minimum of the Hamiltonian
        :math:`l + \pi^T f` within the bounds, with the costate :math:`\pi` of the momentum.
        Bounds of states make costates jump; this is the value before the jump.
    stage_t : ndarray, shape (N, s)
        Times of the stages.
    stage_controls : dict of str to ndarray, shape (N, s) or (N, s, k)
        Controls at the stages, which drive the motion; they are of order s + 1.
    weights : ndarray, shape (s,)
        Those of the stages: ``result.h * result.weights @ u[n]`` is the integral of u over step n.
    costates : dict of str to ndarray, shape (N + 1, n)
        ``p``, :math:`\pi_n`: the derivative of the cost still to come by the momentum, with
        :math:`g_q \pi = 0` for ideal reactions. And ``q`` (or ``y``), by the position at constant
        momentum: its part along the constraint, as the part across it has no meaning.
    cost : float
        The least cost found.
    h : float
        The step.
    status : str
        What IPOPT returned, such as ``"Solve_Succeeded"``.
    iterations : int
        How many IPOPT took.
    message : str
        What is to be known besides, else empty.
    stats : dict
        Numbers of the program: variables, equations, seconds, the largest violation.
    method : str
        The method, as its repr.
    params : dict of str to float or ndarray
        Parameters without the controls; those that were free have the values found.
    system : Mechanics
        The system.
    """

    t: Array
    states: dict[str, Array]
    controls: dict[str, Array]
    stage_t: Array
    stage_controls: dict[str, Array]
    weights: Array
    costates: dict[str, Array]
    cost: float
    h: float
    status: str
    iterations: int
    message: str
    stats: dict[str, Any]
    method: str
    params: dict[str, Any]
    system: Mechanics
    _how: tuple[Spark, Controls] = field(default=None)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for group in (self.states, self.controls, self.stage_controls, self.costates):
            for values in (self.t, self.stage_t, self.weights, *group.values()):
                values.setflags(write=False)

    def __getattr__(self, name: str) -> Array:
        """Give a state by its name."""
        states: dict[str, Array] = self.__dict__.get("states", {})
        if name in states:
            return states[name]
        hint = f"its states are {', '.join(states)}"
        raise AttributeError(hinted(f"the result has no {name!r}", hint))

    def __repr__(self) -> str:
        """Return the cost, how it was found, and what is to be known besides."""
        steps, (start, end) = len(self.t) - 1, self.t[[0, -1]]
        said = f"\n {self.message}" if self.message else ""
        return (
            f"<OptimalControl cost {self.cost:.8g}: {', '.join(self.controls)}, "
            f"t = {start:g} to {end:g}, {steps} steps of h = {self.h:.6g}, {self.method}\n"
            f" {self.status} in {self.iterations} iterations, "
            f"violation {self.stats['violation']:.1e}{said}>"
        )

    @cached_property
    def driven(self) -> Mechanics:
        """The system with the controls as functions of time, for runs by any method.

        Within each step they are the polynomials through their values at the stages.
        """
        _, controls = self._how
        steps, s = self.stage_t.shape
        stages = [x.reshape(steps, s, -1) for x in self.stage_controls.values()]
        t, c = self.system.symbols.t, (self.stage_t[0] - self.t[0]) / self.h
        values = polynomials(t, self.t[0], self.h, np.concatenate(stages, axis=2), c)
        return driven(self.system, controls, values)

    @cached_property
    def error(self) -> dict[str, float]:
        """The error of the motion by state, estimated: its largest distance from finer steps.

        A run of :attr:`driven` with half the step is compared at the nodes. It has what the steps
        leave of the motion, which a motion that is not stable grows, not what they leave of the
        controls.
        """
        method, _ = self._how
        start = {name: self.states[name][0] for name in self.system.states}
        steps, t = len(self.t) - 1, (float(self.t[0]), float(self.t[-1]))
        run = integrate(
            self.driven, method, t=t, steps=2 * steps, every=2, params=self.params, **start
        )
        states = finished(run).states
        return {
            name: float(np.abs(states[name] - self.states[name]).max())
            for name in self.system.states
        }

    @cached_property
    def solution(self) -> Solution:
        """The run of :attr:`driven` by the same method and steps, from the same start.

        It is the optimal motion up to what is left of the step equations, as the motion grows it.
        """
        method, _ = self._how
        names = self.system.states
        start = {name: self.states[name][0] for name in names}
        t = (float(self.t[0]), float(self.t[-1]))
        steps = len(self.t) - 1
        run = integrate(self.driven, method, t=t, steps=steps, params=self.params, **start)
        return finished(run)  # it is kept
