r"""Contacts that share a load: more of them than independent rows.

Their motion is that of a mode, their forces are not determined. A mode lasts as long as *some*
forces that give its accelerations are within their bounds, which is a linear program: the margin is

.. math:: \max_{N, T} \min_k \{ N_k,\; \mu_k N_k - T_k,\; \mu_k N_k + T_k \} .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._basics.scipy import scipy
from liouville._runs.contacts.complementarity import Array
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._runs.contacts.matrices import Matrices
    from liouville._runs.contacts.mode import ModeSystem
    from liouville._runs.contacts.switching import Switching
    from liouville._runs.contacts.traced import Contacts
    from liouville._solution.solution import Solution

#: Forces below this part of those that would move the system so are none; a margin is zero within
#: the second part of these, or of the forces.
NONE, ROUNDED = 1e-9, 2e-14
#: Rows are independent where singular values are above this part of the largest.
INDEPENDENT = 1e-10
#: Contacts contradict one another by more than this part of their rates.
CONTRADICTS = 1e-6
#: The largest margin, in units of what the forces lead to.
LARGEST = 1.0


@dataclass(frozen=True)
class Shared:
    """Normal forces and friction of a mode with the largest margin, and whether it gives way."""

    margin: float
    gives_way: bool
    normal: Array
    friction: Array


def shared(at: Matrices, modes: tuple[Mode, ...], lowest: float = 0.0) -> Shared:
    """Return how contacts share a load: forces that give the accelerations of a mode.

    It gives way where the margin is below the lowest. Each that bears friction has one slip.
    """
    c = len(modes)
    slips = c + np.searchsorted(at.owner, np.arange(c))
    is_given = at.is_pressed
    closed = [k for k, mode in enumerate(modes) if mode is not Mode.OPEN and not is_given[k]]
    signs = np.array([mode.sign for mode in modes])
    given = np.where(is_given, -at.laws.friction * signs * at.load, 0.0)
    sticks = [k for k, mode in enumerate(modes) if mode is Mode.STICK]
    columns = np.zeros((len(at.b), len(closed) + len(sticks)))
    for j, k in enumerate(closed):
        columns[:, j] = at.A[:, k] - at.A[:, slips[k]] * at.laws.friction[k] * modes[k].sign
    for j, k in enumerate(sticks):
        columns[:, len(closed) + j] = at.A[:, slips[k]]
    active = [*closed, *slips[sticks]]
    # the rows that are independent, by their singular values: the others follow to roundoff
    u, values, vt = np.linalg.svd(columns[active])
    rank = int((values > INDEPENDENT * values.max(initial=0.0)).sum())
    rest = (at.b + at.A[:, slips] @ given)[active]
    sides = -(u.T @ rest)[:rank] / values[:rank]
    weight = float(np.abs(at.free).max() / (np.abs(at.moves).max() or 1.0))
    scale = max(np.abs(sides).max(initial=0.0), NONE * weight) or 1.0
    bounds, least = [np.eye(len(closed), columns.shape[1])], [np.zeros(len(closed))]
    for j, k in enumerate(sticks):
        rows = np.zeros((2, columns.shape[1]))
        rows[:, len(closed) + j] = 1.0, -1.0
        if not is_given[k]:
            rows[:, closed.index(k)] = at.laws.static[k]
        bounds.append(rows)
        least.append(np.full(2, at.laws.static[k] * at.load[k]))
    limits, borne = np.concatenate(bounds), np.concatenate(least) / scale
    some, ways = vt[:rank].T @ (sides / scale), vt[rank:].T
    w, margin = _best(borne + limits @ some, limits @ ways)
    x = scale * (some + ways @ w)
    zero = ROUNDED * max(weight, float(np.abs(x).max(initial=0.0)))
    normal, friction = at.load.copy(), given
    normal[closed] = x[: len(closed)]
    for k in closed:
        friction[k] = -at.laws.friction[k] * modes[k].sign * normal[k]
    friction[sticks] = x[len(closed) :]
    return Shared(scale * margin, scale * margin < lowest - zero, normal, friction)


def loads(
    run: Solution, system: ModeSystem, now: Switching, *, is_whole: bool = True
) -> list[Shared]:
    """Return how contacts share their loads at the records of a stretch.

    Of a whole stretch these are those up to where the mode gives way: where the margin comes below
    zero, or below what it was where the mode was chosen, which knows it to less.
    """
    first, second = system.states
    found: list[Shared] = []
    states = zip(run.t, run.states[first], run.states[second], strict=True)
    for k, (t, y, z) in enumerate(states if system.is_shared else ()):
        lowest = min(found[0].margin, 0.0) if found else -np.inf
        found.append(shared(now.at(float(t), y, z), system.modes, lowest))
        if is_whole and k and found[-1].gives_way:
            break
    return found


def torn(run: Solution, k: int, now: Switching) -> tuple[float, tuple[Array, Array]]:
    """Return when a mode gives way that has given way at record k, and the state there."""
    first, second = now.contacts.system.states

    def at(t: float) -> tuple[Array, Array]:
        found = run(t)
        return found.states[first], found.states[second]

    begin, low, high = float(run.t[0]), float(run.t[k - 1]), float(run.t[k])
    lowest = min(shared(now.at(begin, *at(begin)), now.modes).margin, 0.0)
    while low < (middle := low + (high - low) / 2) < high:
        here = now.at(middle, *at(middle))
        if shared(here, now.modes, lowest).gives_way:
            high = middle
        else:
            low = middle
    return high, at(high)


def refuse_space(system: ModeSystem, contacts: Contacts, t: float) -> None:
    """Refuse contacts that share a load where friction has two directions."""
    bears = [mode not in (Mode.OPEN, Mode.CLOSED) for mode in system.modes]
    which = np.flatnonzero(contacts.is_spatial & bears)
    if system.is_shared and which.size:
        names = quoted([contacts.names[k] for k in which])
        sentence = f"at t = {t:g} contacts share a load, and {names} have friction in space"
        hint = "which part of it each bears is not determined: let fewer contacts have friction"
        raise IntegrationError(hinted(sentence, hint), t=t)


def contradicting(at: Matrices, rates: Array, contacts: Array, mu: Array) -> Array:
    r"""Return the contacts, of some, that no motion obeys together; none where one does.

    By Farkas's lemma a motion has :math:`\varphi'_k + r_k \ge 0` for all k, unless there are forces
    within the cones of friction that do not move the system, with :math:`N^T r < 0`.

    Parameters
    ----------
    at : Matrices
        The matrices.
    rates : ndarray, shape (c,)
        Rates of the gaps, or their accelerations without contact forces.
    contacts : ndarray of int
        The contacts that are closed.
    mu : ndarray, shape (c,)
        Their coefficients of friction; zeros ask for motions without any.
    """
    c = len(mu)
    whose = np.searchsorted(contacts, at.owner[np.isin(at.owner, contacts)])
    sticky = at.moves[:, c:][:, np.isin(at.owner, contacts)] * mu[contacts][whose]
    across = at.moves[:, contacts][:, whose]
    ways = np.hstack([across - sticky, across + sticky])
    sizes = np.abs(ways).max(axis=0)
    if len(contacts) < 2 or not (sizes > 0).all():
        return contacts[:0]
    optimize = scipy("optimize", "contacts that contradict one another")
    r = np.tile(rates[contacts][whose], 2) / sizes
    found = optimize.linprog(
        r / (np.abs(r).max() or 1.0), np.ones((1, len(r))), [1.0], ways / sizes,
        np.zeros(len(ways)), bounds=(0, None), method="highs",
    )  # fmt: skip
    if found.x is None or found.fun >= -CONTRADICTS:
        return contacts[:0]
    weights = np.bincount(whose, found.x.reshape(2, -1).sum(axis=0))
    return contacts[weights > CONTRADICTS]


def _best(a: Array, slopes: Array) -> tuple[Array, float]:
    """Return w with the largest least of a + slopes w, and that, which is bounded."""
    if slopes.shape[1] == 1:
        return _best_of_one(a, slopes[:, 0])
    optimize = scipy("optimize", "forces that contacts share")
    cost = np.zeros(slopes.shape[1] + 1)
    cost[-1] = -1.0
    # contacts that wedge a body in have no largest margin
    rows = np.vstack([np.column_stack([-slopes, np.ones(len(a))]), -cost])
    found = optimize.linprog(cost, rows, np.append(a, LARGEST), bounds=(None, None), method="highs")
    if found.x is None:
        return np.zeros(slopes.shape[1]), -np.inf
    return found.x[:-1], float(found.x[-1])


def _best_of_one(a: Array, slopes: Array) -> tuple[Array, float]:
    """Return the same for one w: lines that rise and lines that fall meet there."""
    flat = np.abs(slopes) <= INDEPENDENT * np.abs(slopes).max(initial=0.0)
    up, down = np.flatnonzero(~flat & (slopes > 0)), np.flatnonzero(~flat & (slopes < 0))
    most = min(LARGEST, a[flat].min(initial=np.inf))
    if not (up.size and down.size):  # they rise without end on one side
        needed = (most - a[~flat]) / slopes[~flat]
        w = needed.max(initial=0.0) if up.size else needed.min(initial=0.0)
        return np.array([w]), most
    rise, fall = slopes[up][:, None], slopes[down][None, :]
    heights = (a[down][None, :] * rise - a[up][:, None] * fall) / (rise - fall)
    i, j = np.unravel_index(int(np.argmin(heights)), heights.shape)
    w = (a[down[j]] - a[up[i]]) / (slopes[up[i]] - slopes[down[j]])
    return np.array([w]), float(min(most, heights[i, j]))
