"""Redundant constraints: which of them the others imply, and the system without those.

Where gradients of constraints are dependent at all nearby states that meet the constraints, some
can be left out: the states that meet the others are the same, and so are positions and velocities
of a step. At a singular position they are dependent there alone, and nothing can be left out.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.mechanics.form import Model, Nonholonomic, Redundant
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.mechanics.singular import dense, unit
from liouville._systems.tracing.sparse import jacobian

#: Where orthogonalising the gradients takes more operations than this, it is first seen whether the
#: sparse equations for multipliers are singular.
MOST_OPERATIONS = 1e6
#: Redundant constraints are not looked for in gradients with more entries.
MOST_ENTRIES = 2_000_000
#: Gradients of length one are clearly independent where this part of each is its own.
CLEARLY = 1e-6
#: Roundoff of such a part, in units of the larger number of rows and columns.
ROUNDOFF = 10 * float(np.finfo(float).eps)
#: What gradients change by roundoff of the positions is taken so many times.
BLUR = 8.0
#: Between roundoff and this many times that, constraints are nearly singular and not redundant.
GAP = 1e3
#: How far away a neighbour is, in the size of the positions.
ASIDE = 1e-4
#: Closer ones are tried where no corrections lead there: positions may be far from the origin.
CLOSER = (1.0, 32.0, 1024.0)
#: The most corrections of a neighbour, and what it may miss of what constraints are made of.
MOST_CORRECTIONS, MISSED = 12, 1e-10
#: Passes of a projection by normal equations of gradients that are clearly independent.
REPEATS = 4
#: Reactions of constraints left out are combinations of the others up to this.
ALIKE = 1e-8

#: The systems without their redundant constraints, by those that are left out.
_REDUCED: WeakKeyDictionary[Mechanics, dict[tuple[int, ...], Mechanics]] = WeakKeyDictionary()


def redundant(
    system: Mechanics, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray
) -> tuple[int, ...]:
    """Return which constraints the others imply at a consistent state and around it.

    They are found by orthogonalisation of the gradients; of dependent constraints the first are
    kept. None are found where the dependence is a singular position or not clear, nor where
    reactions are no combinations of the others' or not linear in their multipliers.
    """
    rows, n = len(system.constraints), len(system.coordinates)
    if rows < 2 or rows * n > MOST_ENTRIES:
        return ()
    if n >= rows > (MOST_OPERATIONS / n) ** 0.5 and _is_solved(system, t, y, z, params):
        return ()
    # the verdict on nearly all starts; units would change it for dependent rows alone
    if first_dependent(system, t, y[None], params[None]) is None:
        return ()
    gradients = _gradients(system, t, y, z, params)
    units = _units(gradients)
    kept, _, _ = _core.independent_rows(gradients * units, CLEARLY)
    if len(kept) == rows or not np.abs(gradients).max(axis=1).all():
        return ()
    nearby = _Nearby(system, t, z, params, y, [k for k in kept if k < len(system.holonomic)])
    found = nearby.moved(np.zeros(n))
    if found is None:  # they contradict each other, for which a run has the better sentence
        return ()
    y, gradients = found, units * _gradients(system, t, found, z, params)
    cutoff = ROUNDOFF * max(rows, n) + BLUR * _blur(nearby, y, units)
    kept, least, _ = _core.independent_rows(gradients, cutoff)
    if len(kept) == rows or least < GAP * cutoff:
        return ()
    left = tuple(sorted(set(range(rows)) - set(kept)))
    for aside in nearby.asides():
        closer = (nearby.moved(aside / part) for part in CLOSER)
        there = next((there for there in closer if there is not None), None)
        if there is None:
            return ()
        near = units * _gradients(system, t, there, z, params)
        if _beyond(near[kept], near[[*left]]).max() > cutoff:
            return ()
    if not _are_alike(system, t, y, z, params, kept, left):
        return ()
    return left


def first_dependent(
    system: Mechanics, t: float, y: np.ndarray, params: np.ndarray, first: int = 0
) -> int | None:
    """Return the first member, from one on, of which constraints may be dependent.

    `y` and `params` have a row for each. With nonholonomic constraints it is that one itself.
    """
    rows, n = len(system.constraints), y.shape[1]
    if rows < 2 or first == len(y):
        return None
    if system.nonholonomic or n >= rows > (MOST_OPERATIONS / n) ** 0.5:
        return first
    own, params = (np.ascontiguousarray(x[first:]) for x in (y, params))
    found = _core.first_dependent(system.problem, params, t, own, CLEARLY)
    return None if found is None else first + found


def are_implied(
    system: Mechanics,
    t: float,
    y: np.ndarray,
    z: np.ndarray,
    params: np.ndarray,
    left: tuple[int, ...],
) -> bool:
    """Return whether gradients of these constraints, and of no others, depend on those before."""
    gradients = _gradients(system, t, y, z, params)
    kept, _, _ = _core.independent_rows(gradients * _units(gradients), CLEARLY)
    return set(kept).isdisjoint(left) and len(kept) + len(left) == len(system.constraints)


def without(system: Mechanics, left: tuple[int, ...]) -> Mechanics:
    """Return the system that has all constraints but these, and multipliers that include theirs."""
    if not left:
        return system
    known = _REDUCED.setdefault(system, {})
    if left not in known:
        known[left] = _without(system, left)
    return known[left]


def sizes(
    system: Mechanics, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray
) -> np.ndarray:
    """Return the size of what each constraint is made of, at a state."""
    slopes = np.abs(_gradients(system, t, y, z, params)).sum(axis=1)
    found: np.ndarray = slopes * max(np.abs(y).max(), np.abs(z).max())
    found[found == 0] = 1.0
    return found


def _without(system: Mechanics, left: tuple[int, ...]) -> Mechanics:
    s, model, own = system.symbols, system.model, system.model.nonholonomic
    m, names = model.g.numel(), system.constraints
    held = [k for k in range(m) if k not in left]
    rolling = [k - m for k in range(m, len(names)) if k not in left]
    lam, all_lam = _part("lam", m, held)
    nu, all_nu = _part("nu", len(names) - m, rolling)
    power = system.expressions.columns.get("power")
    if power is not None:
        power = ca.substitute(power, model.lam, all_lam)
    return Mechanics(
        s,
        Model(
            v=model.v,
            p=model.p,
            f=model.f,
            r=ca.substitute(model.r, model.lam, all_lam),
            g=model.g[held],
            lam=lam,
            nonholonomic=Nonholonomic(
                own.k[rolling], ca.substitute(own.rn, own.nu, all_nu), nu
            ),
            linear=model.linear,
            is_ideal=model.is_ideal,
            g_y=None if model.g_y is None else model.g_y[held, :],
            redundant=Redundant(
                ca.horzcat(jacobian(model.r, model.lam), jacobian(own.rn, own.nu)), left
            ),
        ),
        states=system.states,
        coordinates=system.coordinates,
        constraints=tuple(name for k, name in enumerate(names) if k not in left),
        invariants={},
        power=power,
    )  # fmt: skip


def _part(name: str, count: int, held: list[int]) -> tuple[ca.SX, ca.SX]:
    """Return symbols of some multipliers, and all of them with zeros for the others."""
    own = ca.SX.sym(name, len(held))
    everything = ca.SX.zeros(count, 1)
    for position, k in enumerate(held):
        everything[k] = own[position]
    return own, everything


def _gradients(
    system: Mechanics, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray
) -> np.ndarray:
    """Return the gradients of all constraints by velocities, or by z, one a row."""
    lam, nu = np.zeros(len(system.holonomic)), np.zeros(len(system.nonholonomic))
    found = dense(system.patterns["g_y"], system.at_point("node_blocks", params, t, y, lam))
    if not nu.size:
        return found
    if "v_z" in system.patterns:
        blocks = system.at_point("stage_blocks", params, t, y, z)
        found = found @ dense(system.patterns["v_z"], blocks[len(system.patterns["p_z"][2]) :])
    blocks = system.at_point("nonholonomic_blocks", params, t, y, z, nu)
    return np.vstack(
        [found, dense(system.patterns["k_z"], blocks[len(system.patterns["k_y"][2]) :])]
    )


def _units(gradients: np.ndarray) -> np.ndarray:
    """Return factors of the columns that bring the largest entry of each near one."""
    return unit(np.abs(gradients).max(axis=0, initial=0.0))


def _blur(nearby: _Nearby, y: np.ndarray, units: np.ndarray) -> float:
    """Return how much gradients of length one change by roundoff of the constraints at a position.

    Far from the origin positions have more roundoff than what is made of their differences.
    """
    system, t, z, params = nearby.system, nearby.t, nearby.z, nearby.params
    gradients = units * _gradients(system, t, y, z, params)
    sizes, largest = np.linalg.norm(gradients, axis=1), 0.0
    for signs in np.random.default_rng(1).choice([-1.0, 1.0], (2, len(nearby.kept))):
        there = y + nearby._across(signs * nearby.roundoff[nearby.kept])
        change = units * _gradients(system, t, there, z, params) - gradients
        largest = max(largest, float((np.linalg.norm(change, axis=1) / sizes).max()))
    return largest


def _is_solved(
    system: Mechanics, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray
) -> bool:
    """Return whether all multipliers can be solved for."""
    found = _core.multipliers(system.problem, params, t, y, z)
    return not isinstance(found, dict)


class _Nearby:
    """Positions near one that meet its holonomic constraints, by the independent ones of them."""

    def __init__(
        self,
        system: Mechanics,
        t: float,
        z: np.ndarray,
        params: np.ndarray,
        y: np.ndarray,
        kept: list[int],
    ) -> None:
        self.system, self.t, self.z, self.params, self.y, self.kept = system, t, z, params, y, kept
        self._none = np.zeros(len(system.holonomic))
        blocks = system.at_point("node_blocks", params, t, y, self._none)
        gradients = dense(system.patterns["g_y"], blocks)
        slopes = np.abs(gradients).sum(axis=1) * (np.abs(y).max(initial=0.0) or 1.0)
        self._limits = MISSED * np.where(slopes > 0, slopes, 1.0)
        self.roundoff = float(np.finfo(float).eps) * (np.abs(gradients) @ np.abs(y))
        self._columns = _units(gradients)
        own = gradients[kept] * self._columns
        self._rows = unit(np.abs(own).max(axis=1, initial=0.0))
        self._gradients = self._rows[:, None] * own
        self._inverse = np.linalg.inv(self._gradients @ self._gradients.T)

    def moved(self, aside: np.ndarray) -> np.ndarray | None:
        """Return a position moved and then corrected; None if some constraints are not met there.

        Corrections are along the gradients at the first position. They end where they are roundoff.
        """
        y, least = self.y + aside, np.inf
        for _ in range(MOST_CORRECTIONS):
            off = self._missed(y)
            size = float(np.abs(off[self.kept]).max(initial=0.0))
            if not size < least / 2:
                break
            least = size
            y = y - self._across(off[self.kept])
        return y if (np.abs(self._missed(y)) <= self._limits).all() else None

    def _across(self, rates: np.ndarray) -> np.ndarray:
        """Return the least move with these rates of the constraints kept, in their units."""
        found: np.ndarray = (self._inverse @ (self._rows * rates)) @ self._gradients
        found *= self._columns
        return found

    def _missed(self, y: np.ndarray) -> np.ndarray:
        found: np.ndarray = self.system.at_point("node", self.params, self.t, y, self._none)
        return found[: self._none.size]

    def asides(self) -> list[np.ndarray]:
        """Return two small moves that keep the constraints nearly: along the velocity, another."""
        n, m = len(self.y), self._none.size
        end = self.system.at_point("end", self.params, self.t, self.y, self.z)
        velocity = end[n + m :] if end.size > n + m else self.z
        other = np.random.default_rng(0).standard_normal(n)
        other = self._columns * other
        other -= self._across((self._gradients / self._rows[:, None]) @ (other / self._columns))
        size = ASIDE * (np.abs(self.y).max() or 1.0)
        return [size * x / np.abs(x).max() for x in (velocity, other) if np.abs(x).max() > 1e-8]


def _beyond(basis: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the part of each row that is no combination of a basis, in its own size.

    Parts along the basis are found by normal equations, and what these miss by them again.
    """
    basis = basis / np.linalg.norm(basis, axis=1)[:, None]
    inverse = np.linalg.inv(basis @ basis.T)
    rest = rows / np.linalg.norm(rows, axis=1)[:, None]
    for _ in range(REPEATS):
        rest = rest - (rest @ basis.T @ inverse) @ basis
    found: np.ndarray = np.linalg.norm(rest, axis=1)
    return found


def _are_alike(
    system: Mechanics,
    t: float,
    y: np.ndarray,
    z: np.ndarray,
    params: np.ndarray,
    kept: list[int],
    left: tuple[int, ...],
) -> bool:
    """Return whether reactions are linear, and those left out are combinations of the others."""
    m, own = len(system.holonomic), len(system.nonholonomic)
    found = []
    for value in (0.0, 1.0):
        lam, nu = np.full(m, value), np.full(own, value)
        blocks = system.at_point("node_blocks", params, t, y, lam)
        columns = dense(system.patterns["r_lam"], blocks[len(system.patterns["g_y"][2]) :])
        if own:
            blocks = system.at_point("nonholonomic_blocks", params, t, y, z, nu)
            of_nu = len(system.patterns["rn_nu"][2])
            columns = np.hstack([columns, dense(system.patterns["rn_nu"], blocks[-of_nu:])])
        found.append(columns)
    first, second = found
    is_linear = np.array_equal(first, second)
    columns = first.T * _units(first.T)
    return is_linear and bool((_beyond(columns[kept], columns[[*left]]) <= ALIKE).all())
