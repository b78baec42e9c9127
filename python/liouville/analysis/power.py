"""Where the energy of a run went: power of forces, constraints and damping, by its tapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import Suggesting, hinted
from liouville._solution.parts import system_of
from liouville._solution.points import Points
from liouville._solution.solution import Solution
from liouville._systems import Mechanics
from liouville._systems.events import sides_of
from liouville._systems.mechanics.motion import power
from liouville.analysis.point import mechanical

Array = NDArray[np.float64]

#: Points of Gauss's quadrature in a step: of order 8.
NODES = 4


@dataclass(frozen=True, eq=False, repr=False)
class PowerBalance(Suggesting):
    """Powers along a run and their integrals, at its k steps.

    The names are "forces", which have no potential, with what the energy changes by its own
    dependence on time; "constraints" that move or roll; and "damping" by the matrix of a Structure.
    Those of contacts are "friction", and "contacts", what walls and belts bring in by their motion.
    What resets of events and impacts change the energy by is the work of "impacts", without a
    power.

    Attributes
    ----------
    t : ndarray, shape (k,)
        The times.
    energy : ndarray, shape (k,)
        The energy.
    power : dict of str to ndarray, shape (k,)
        The power of each.
    work : dict of str to ndarray, shape (k,)
        The work of each since the start.
    defect : ndarray, shape (k,)
        The change of the energy that is no work: damping of the method, and errors.
    """

    t: Array
    energy: Array
    power: dict[str, Array]
    work: dict[str, Array]
    defect: Array

    def __repr__(self) -> str:
        """Give the work of the run and what is not accounted for."""
        done = ", ".join(f"{name} {x[-1]:.4g}" for name, x in self.work.items())
        change, off = self.energy[-1] - self.energy[0], np.abs(self.defect).max()
        return f"<PowerBalance: energy changed by {change:.4g}; work: {done}; defect {off:.1e}>"


def power_balance(solution: Solution) -> PowerBalance:
    r"""Account for the energy of a run, by any method.

    .. math:: E' = Q^T v + E_t + r^T v - v^T C v

    The powers are evaluated at the points of Gauss's quadrature of every step, with states made by
    parts of the step. A step with a reset is taken in the parts before and after it.

    Parameters
    ----------
    solution : Solution
        A single run of a Lagrangian, Hamiltonian, Structure or the system of an assembly, with all
        its steps.

    Returns
    -------
    PowerBalance
        Powers, their work, and what is left.

    Raises
    ------
    TypeError, ValueError
        The energy of the system is not known, or the solution has not all steps or no system.
    """
    if not isinstance(solution, Solution):
        raise TypeError(f"power_balance takes a solution, not {solution!r}")
    if solution.members is not None:
        raise ValueError(hinted("the solution is an ensemble", "take a member: solution.member(0)"))
    own = system_of(solution, "a balance of power needs")
    system = mechanical(own, "power_balance", touches=True)
    values = system.values(solution.params)
    power(system)
    if not solution.dense_order:
        sentence = "a balance of power needs the states of all steps"
        raise ValueError(hinted(sentence, "integrate with every=1, states=True, without t_eval"))
    if len(solution.t) < 2:
        raise ValueError("a balance of power needs a step at least")
    resets, jumps = _jumps(system, values, solution)
    knots = _knots(solution.t, resets)
    places, weights = np.polynomial.legendre.leggauss(NODES)
    parts = np.diff(knots)
    times = (knots[:-1, None] + parts[:, None] * (1 + places) / 2).ravel()
    inner = solution(times).states
    at_steps = _powers(system, values, solution.t, solution.states)
    between = _powers(system, values, times, inner)
    if solution.stretches:
        at_steps |= _powers_of_contacts(system, values, solution, solution.t)
        between |= _powers_of_contacts(system, values, solution, times)
    way = np.sign(parts.sum())
    ends = np.searchsorted(way * knots, way * solution.t)
    work = {
        name: np.append(0.0, np.cumsum(x.reshape(-1, NODES) @ weights * parts / 2))[ends]
        for name, x in between.items()
    }
    energy = solution.invariants["energy"]
    kept = {name for name, x in between.items() if x.any() or at_steps[name].any()}
    if jumps is not None:
        work["impacts"] = jumps
        kept.add("impacts")
    defect = energy - energy[0] - sum(work.values())
    return PowerBalance(
        solution.t,
        energy,
        {name: x for name, x in at_steps.items() if name in kept},
        {name: x for name, x in work.items() if name in kept},
        defect,
    )


def _knots(t: Array, resets: Array) -> Array:
    """Return the times of the steps and those of the resets between them, in the order of the run.

    Powers are smooth on each side of a reset and jump at it.
    """
    knots = np.union1d(t, resets)
    return knots if t[-1] >= t[0] else knots[::-1]


def _jumps(system: Mechanics, values: Array, solution: Solution) -> tuple[Array, Array | None]:
    """Return the times of resets, and what they have changed the energy by until each step.

    The latter is None if no event has resets.
    """
    if solution.stretches:
        at, change = _impacts(system, values, solution)
    else:
        own = [x for x in solution.events.values() if sides_of(x.states, system.states) is not None]
        if not own:
            return np.empty(0), None
        at = np.concatenate([points.t for points in own])
        before, after = np.hstack([_energies(system, values, points) for points in own])
        change = after - before
    way = np.sign(solution.t[-1] - solution.t[0])
    # a record at the time of an event is that after its reset
    found: Array = (way * (solution.t[:, None] - at) >= 0) @ change
    return at, found


def _energies(system: Mechanics, values: Array, points: Points) -> Array:
    """Return the energies before resets and after them, in two rows."""
    observer, widths = system.observer(None, states=False)
    place = sum([*widths.values()][: [*widths].index("invariant energy")])
    rows = [
        observer.map(values, [*map(np.ascontiguousarray, (points.t[:, None], *side))])[:, place]
        for side in sides_of(points.states, system.states) or ()
    ]
    return np.array(rows)


def _impacts(system: Mechanics, values: Array, solution: Solution) -> tuple[Array, Array]:
    """Return the times of impacts of contacts, and what they have changed the energy by.

    They are within stretches, where the core answers them, and between these. No energy jumps where
    a mode gives way within a step.
    """
    runs = [run for run, _ in solution.stretches]
    hits: list[tuple[float, float]] = []
    for run, after in zip(runs, [*runs[1:], None], strict=True):
        end = np.inf if after is None else after.t[0]
        if after is not None and run.t[-1] == end:
            hits.append((end, after.invariants["energy"][0] - run.invariants["energy"][-1]))
        for points in run.events.values():
            if len(points.t) and sides_of(points.states, system.states) is not None:
                before, then = _energies(system, values, points)
                changes = then - before
                if after is not None:  # there the hit is answered anew
                    changes = np.where(
                        points.t == end, after.invariants["energy"][0] - before, changes
                    )
                counts = points.t <= end
                hits += zip(points.t[counts], changes[counts], strict=True)
    times, changes = np.array(hits, dtype=float).reshape(-1, 2).T
    inside = (solution.t[0] < times) & (times <= solution.t[-1])
    return times[inside], changes[inside]


def _powers_of_contacts(
    system: Mechanics, values: Array, solution: Solution, times: Array
) -> dict[str, Array]:
    """Return the powers of contacts at some times, at a change those after it."""
    # imported here: few systems have contacts
    from liouville._runs.contacts.joined import forces_of

    assert system.contacts is not None
    runs = [run for run, _ in solution.stretches]
    which = np.searchsorted([run.t[0] for run in runs[1:]], times, side="right")
    found = {"contacts": np.zeros(len(times)), "friction": np.zeros(len(times))}
    for k in np.unique(which):
        own, at = runs[k], which == k
        there = own(times[at]).states
        forces = forces_of(system.contacts, own.system, times[at], there, values)
        states = times[at], *(there[name] for name in system.states)
        for name, x in system.contacts.powers(states, *forces, values).items():
            found[name][at] = x
    return found


def _powers(
    system: Mechanics, values: Array, t: Array, states: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the powers at some states."""
    m = len(system.holonomic)
    y, z = (states[name] for name in system.states)
    parts = t.reshape(-1, 1), y, z, states["lam"][:, :m], states["lam"][:, m:]
    found = power(system).map(values, [np.ascontiguousarray(x) for x in parts])
    return dict(zip(("forces", "constraints", "damping"), found.T, strict=True))
