r"""Contacts that share a load: more of them than independent rows.

Their motion is that of a mode, their forces are not determined. A mode lasts as long as *some*
forces that give its accelerations are within their bounds, which is a linear program: the margin is

.. math:: \max_{N, T} \min_k \{ N_k,\; \mu_k N_k - T_k,\; \mu_k N_k + T_k \} .

In space, with :math:`\mu_k N_k - |T_k|`, it is a program of cones.
"""

from __future__ import annotations

from collections.abc import Sequence
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
#: Parts of 1 / m that barriers are weighed by, steps to each centre, and where it is near; and how
#: far forces go in the same units.
FALLING, MOST_STEPS, NEAR_CENTRE, FARTHEST = 0.1 ** np.arange(0.0, 12.5), 40, 0.3, 1e3
#: A margin by barriers is zero within this part of the forces.
CENTRED = 1e-10


@dataclass(frozen=True)
class Shared:
    """Normal forces and friction of a mode with the largest margin, and whether it gives way."""

    margin: float
    gives_way: bool
    normal: Array
    friction: Array


def shared(at: Matrices, modes: tuple[Mode, ...], lowest: float = 0.0) -> Shared:
    """Return how contacts share a load: forces that give the accelerations of a mode.

    It gives way where the margin is below the lowest.
    """
    c = len(modes)
    slips = c + np.searchsorted(at.owner, np.arange(c))
    is_given = at.is_pressed
    closed = [k for k, mode in enumerate(modes) if mode is not Mode.OPEN and not is_given[k]]
    signs = np.array([mode.sign for mode in modes])
    given = np.where(is_given, -at.laws.friction * signs * at.load, 0.0)
    stuck = np.flatnonzero([modes[k] is Mode.STICK for k in at.owner])
    columns = np.zeros((len(at.b), len(closed) + len(stuck)))
    for j, k in enumerate(closed):
        columns[:, j] = at.A[:, k] - at.A[:, slips[k]] * at.laws.friction[k] * modes[k].sign
    columns[:, len(closed) :] = at.A[:, c + stuck]
    active = [*closed, *(c + stuck)]
    # the rows that are independent, by their singular values: the others follow to roundoff
    u, values, vt = np.linalg.svd(columns[active])
    rank = int((values > INDEPENDENT * values.max(initial=0.0)).sum())
    rest = (at.b + at.A[:, slips] @ given)[active]
    sides = -(u.T @ rest)[:rank] / values[:rank]
    weight = float(np.abs(at.free).max() / (np.abs(at.moves).max() or 1.0))
    scale = max(np.abs(sides).max(initial=0.0), NONE * weight) or 1.0
    cones = _Cones(at, closed, stuck, scale)
    x, margin = cones.inmost(vt[:rank].T @ (sides / scale), vt[rank:].T)
    x, margin = scale * x, scale * margin
    zero = cones.rounded * max(weight, float(np.abs(x).max(initial=0.0)))
    normal, friction = at.load.copy(), given
    normal[closed] = x[: len(closed)]
    for k in closed:
        friction[k] = -at.laws.friction[k] * modes[k].sign * normal[k]
    for k, own in cones.places.items():
        friction[k] = x[own[0]] if len(own) == 1 else np.hypot(*x[own])
    return Shared(margin, margin < lowest - zero, normal, friction)


class _Cones:
    """Bounds of forces x, N of some contacts and T of those that stick: the cones of friction."""

    def __init__(self, at: Matrices, closed: list[int], stuck: Array, scale: float) -> None:
        self._size, first = len(closed) + len(stuck), len(closed)
        #: Where the friction of each contact that sticks is.
        self.places: dict[int, list[int]] = {}
        for j, k in enumerate(at.owner[stuck].tolist()):
            self.places.setdefault(k, []).append(first + j)
        # the margin is the least of N and, beside one slip, of mu N - T and mu N + T: these are
        # rows; a slip in space has a cone
        rows, least = [*np.eye(first, self._size)], [0.0] * first
        self._cones = []
        for k, own in self.places.items():
            row = np.zeros(self._size)
            borne = float(at.laws.static[k] * at.load[k] / scale)
            if not at.is_pressed[k]:
                row[closed.index(k)] = at.laws.static[k]
            if len(own) > 1:
                self._cones.append((row, borne, own))
            else:
                part = np.eye(self._size)[own[0]]
                rows, least = [*rows, row - part, row + part], [*least, borne, borne]
        self._rows, self._least = np.reshape(rows, (-1, self._size)), np.array(least)
        self.rounded = CENTRED if self._cones else ROUNDED

    def inmost(self, some: Array, ways: Array) -> tuple[Array, float]:
        """Return x = some + ways w with the largest margin, and that."""
        a, slopes = self._least + self._rows @ some, self._rows @ ways
        if not self._cones:
            w, margin = _best(a, slopes)
            return some + ways @ w, margin
        cones = []
        for row, borne, own in self._cones:
            both = np.vstack([row, np.eye(self._size)[own]])
            cones.append((both @ some + np.array([borne, 0.0, 0.0]), both @ ways))
        w = _centred(a, slopes, cones)
        lines = a + slopes @ w
        left = [sides[0] - np.hypot(*sides[1:]) for sides in (b + c @ w for b, c in cones)]
        return some + ways @ w, float(min([*lines, *left]))


def _centred(a: Array, slopes: Array, cones: list[tuple[Array, Array]]) -> Array:
    r"""Return w with the largest m, where :math:`m \le a + s w` and cones are kept, by barriers.

    Those of cones (b, c) have :math:`|b_1 + c_1 w| \le b_0 + c_0 w - m`. With the logarithms
    :math:`\phi` of all that is left, :math:`\phi - m / \tau` is least at the centre, which follows
    :math:`\tau` down by Newton's method. Source: Boyd and Vandenberghe, *Convex Optimization*,
    2004, 11.3.
    """
    n = slopes.shape[1]
    lines = np.column_stack([slopes, -np.ones(len(a))])
    cones = [(b, np.column_stack([c, [-1.0, 0.0, 0.0]])) for b, c in cones]
    u, metric = np.zeros(n + 1), np.diag([-2.0] * n + [0.0])
    lowest = min([*a, *(b[0] - np.hypot(*b[1:]) for b, _ in cones), LARGEST])
    u[n] = lowest - LARGEST
    signs, before = np.array([1.0, -1.0, -1.0]), u[:n]
    for tau in FALLING:
        for _ in range(MOST_STEPS):
            # the distances from the lines, the largest margin, the farthest w, and the cones
            left = np.append(a + lines @ u, LARGEST - u[n])
            ball = FARTHEST**2 - u[:n] @ u[:n]
            parts = [(ball, metric @ u, metric)]
            for b, c in cones:
                x = b + c @ u
                parts.append((x @ (signs * x), 2 * c.T @ (signs * x), 2 * (c.T * signs) @ c))
            if not min([*left, *(size for size, _, _ in parts)]) > 0:  # by roundoff
                return before
            before = u[:n]
            rows = np.vstack([lines, -np.eye(n + 1)[n]]) / left[:, None]
            slope, bend = -rows.sum(axis=0), rows.T @ rows
            slope[n] -= 1 / tau
            for size, own, curve in parts:
                slope -= own / size
                bend += np.outer(own, own) / size**2 - curve / size
            unit = 1 / np.sqrt(np.diag(bend))
            step = -unit * np.linalg.lstsq(bend * np.outer(unit, unit), unit * slope, None)[0]
            decrement = np.sqrt(max(-slope @ step, 0.0))
            u = u + step / (1 + decrement)
            if decrement < NEAR_CENTRE:
                break
    return u[:n]


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


def refuse_space(modes: tuple[Mode, ...], names: Sequence[str], t: float) -> None:
    """Refuse contacts that share a load where some slide in space: their friction turns with it."""
    which = [name for name, mode in zip(names, modes, strict=True) if mode is Mode.SLIDE]
    if which:
        verb = "slide" if len(which) > 1 else "slides"
        sentence = f"at t = {t:g} contacts share a load, and {quoted(which)} {verb} in space"
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
