"""Places where a model bends or jumps, and a run has no derivative.

The states of a run are looked at after each of its steps. Where a function by cases is at the edge
of two cases, to roundoff, the derivatives of the equations on both sides are compared along the
tangent: a model that is smooth there all the same, such as ``fabs(v) * v``, goes on. Where a case
changes within a step, the equations of both sides are compared at the edge. If they jump, and the
tangent moves the edge, the derivative of the motion has a part that that of the steps has not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._systems import Field, Mechanics, SemiExplicit
from liouville._systems.mechanics.branches import Branches

if TYPE_CHECKING:
    from liouville._runs.runner import Runner
    from liouville._solution.solution import Solution

#: Part of its size by which a state is moved to see whether it is at an edge: roundings.
ROUNDINGS = 2.0**-46

#: Part of the size of the states by which an edge is moved to see whether a tangent moves it.
MOVED = 2.0**-20

#: Sides that agree to this part of what is largest in the run are the same.
SAME = 1e-9

#: A switch or an event is met where it is below this part of its largest value, or of a step.
MET = 1e-7

#: Halvings that end at neighbouring numbers, and most edges looked at between two states.
HALVINGS, MOST_EDGES = 64, 8

#: Of the random moves by roundings; any serves.
SEED = 0

KINK = (
    "start beside it, or write a function that is smooth there, such as ca.sqrt(x**2 + e**2) for "
    "ca.fabs(x) or ca.tanh(x / e) for ca.sign(x)"
)
SMOOTH = "write a smooth function, such as ca.tanh(x / e) for ca.sign(x)"
ENDED = (
    "end the step of a Spark(s) there, by an event whose reset returns {} unchanged or by "
    "switches= of the system with rtol="
)
PARTED = (
    "over a jump in time integrate one field up to it and another from it, which have derivatives "
    "by 't1' and 't0'"
)


@dataclass(frozen=True)
class Kink:
    """Where a run has no derivative.

    Attributes
    ----------
    step : int
        The number of steps before it.
    t : float
        When it is.
    name : str
        The function by cases.
    is_jump : bool
        Whether the equations jump within a step; else they bend or jump at its start.
    moves : str
        What of the jump moves with what is differentiated: the "time", or the "place" on a grid.
    """

    step: int
    t: float
    name: str
    is_jump: bool
    moves: str = "time"

    def error(
        self, runner: Runner, member: int | None = None, solution: Solution | None = None
    ) -> IntegrationError:
        """Return the error in the user's words."""
        if self.is_jump:
            sentence = (
                f"step {self.step} has no derivative: at t = {self.t:.6g} the equations jump with "
                f"'{self.name}', at a {self.moves} that moves with what is differentiated"
            )
            hint = SMOOTH
            if isinstance(runner.system, Mechanics | SemiExplicit):
                partner = "y" if isinstance(runner.system, SemiExplicit) else "v"
                hint = f"{ENDED.format(partner)}; or {SMOOTH}"
            elif isinstance(runner.system, Field):
                hint = f"{SMOOTH}; or {PARTED}"
        else:
            where = f"the state after {self.step} steps, at t = {self.t:.6g},"
            if self.step == 0:
                where = f"the start at t = {self.t:.6g}"
            sentence = f"{where} has no derivative: it is at a kink of '{self.name}', to roundoff"
            hint = KINK
        of_member = "" if member is None else f"member {member}: "
        return IntegrationError(
            hinted(of_member + sentence, hint), t=self.t, step=self.step, quantity=self.name,
            member=member, solution=solution,
        )  # fmt: skip


@dataclass(frozen=True)
class Motion:
    """States of a run with their tangents, as w, which tapes of :class:`Branches` take.

    Attributes
    ----------
    w : ndarray, shape (k, width)
        The states.
    along : ndarray, shape (k, d, width)
        Their tangents.
    steps : ndarray of int, shape (k,)
        How many steps were made before each.
    first : ndarray of int
        The states from which a step leads to the next one.
    is_reset : ndarray of bool, shape (k,)
        Which states are at an event with a reset.
    is_inside : bool
        Whether forces act within steps alone, so that one that ends at a jump is on one side of it.
    ends_at_switches : bool
        Whether such steps end at the system's switches.
    """

    w: np.ndarray
    along: np.ndarray
    steps: np.ndarray
    first: np.ndarray
    is_reset: np.ndarray
    is_inside: bool = False
    ends_at_switches: bool = False


def kink_of(found: Branches, motion: Motion) -> Kink | None:
    """Return the first kink of a motion, None where it has none."""
    with np.errstate(all="ignore"):
        look = _Look(found, motion)
        each = [*look.at_edges(), *look.over_edges()]
    return min(each, key=lambda kink: (kink.step, kink.is_jump), default=None)


def jump_near(found: Branches, w: np.ndarray, move: np.ndarray) -> str | None:
    """Return the function by cases with which the equations jump at a state or a move beside."""
    sizes = np.where(w != 0, np.abs(w), 1.0)
    moves = np.random.default_rng(SEED).choice([-1.0, 1.0], (4, len(w))) * sizes * ROUNDINGS
    return _jump_among(found, w, np.concatenate([w + moves, w - moves, [w + move, w - move]]))


def jump_along(found: Branches, w: np.ndarray, off: np.ndarray) -> str | None:
    """Return the function by cases with which the equations jump where states are.

    That is among them and as far beyond, and up to `off` beside the last, but not where it is zero.
    """
    beyond = w[:, None] + 2 * (w[None] - w[:, None])
    beside = np.random.default_rng(SEED).choice([-1.0, 1.0], (8, len(off))) * off * (w[-1] != 0)
    return _jump_among(found, w[-1], np.concatenate([*beyond, w[-1] + beside]))


def _jump_among(found: Branches, w: np.ndarray, points: np.ndarray) -> str | None:
    """Return the function whose side differs among points, and with it the equations at w."""
    with np.errstate(all="ignore"):
        sides = _map(found.sides, points)
        changed = (sides != sides[0]) & found.may_jump
        both = sides[[0, int(np.argmax(changed.any(axis=1)))]]
        values = _map(found.values, np.array([w, w]), both)
    if not changed.any() or not _differ(values, _largest(values)):
        return None
    return found.names[int(np.argmax(changed.any(axis=0)))]


def _map(tape: Any, *columns: np.ndarray) -> np.ndarray:
    """Return the outputs of a tape without parameters at rows of its inputs."""
    found: np.ndarray = tape.map(np.empty(0), [np.ascontiguousarray(x) for x in columns])
    return found


class _Look:
    """Sides and switches of a motion, by which edges are found."""

    def __init__(self, found: Branches, motion: Motion) -> None:
        self._found, self._motion = found, motion
        w = motion.w
        sizes = _largest(w)
        self._sizes = np.where(sizes > 0, sizes, 1.0)
        self._sides = _map(found.sides, w)
        if motion.ends_at_switches:
            self._switches = _largest(_map(found.switches, w))
        self._values = _largest(_map(found.values, w, self._sides))
        slopes = [
            _largest(_map(found.slopes, w, self._sides, along))
            for along in np.moveaxis(motion.along, 1, 0)
        ]
        self._slopes = np.array(slopes)

    def at_edges(self) -> Iterator[Kink]:
        """Give the states at edges, in order, where slopes along a tangent differ by the side."""
        motion, found = self._motion, self._found
        rng = np.random.default_rng(SEED)
        order = np.argsort(motion.steps, kind="stable")
        kept = order[~motion.is_reset[order]]
        moves = rng.uniform(0.5, 1.0, (2, motion.w.shape[1]))
        moves *= rng.choice([-1.0, 1.0], moves.shape) * self._sizes * ROUNDINGS
        w = motion.w[kept]
        is_near = np.zeros(len(kept), dtype=bool)
        for move in moves:
            beside = [_map(found.sides, w + way * move) for way in (1, -1)]
            is_near |= (beside[0] != beside[1]).any(axis=1)
        for k in kept[is_near].tolist():
            if motion.ends_at_switches and self._is_at_switch(motion.w[k]):
                continue
            for direction, along in enumerate(motion.along[k]):
                parts = np.abs(along) / self._sizes
                for move in moves * (parts > SAME * parts.max()):
                    name = self._edge(k, direction, move)
                    if name:
                        yield Kink(int(motion.steps[k]), float(motion.w[k, 0]), name, False)
                        return

    def _edge(self, k: int, direction: int, move: np.ndarray) -> str:
        """Return the function at whose edge a state has two slopes, empty if it has one."""
        found, w, along = self._found, self._motion.w[k], self._motion.along[k, direction]
        beside = _map(found.sides, np.array([w + move, w - move]))
        is_edge = beside[0] != beside[1]
        if not is_edge.any():
            return ""
        sides = np.where(is_edge, beside, self._sides[k])
        at, way = np.array([w, w]), np.array([along, along])
        values = _map(found.values, at, sides)
        slopes = _map(found.slopes, at, sides, way)
        differs = _differ(values, self._values) or _differ(slopes, self._slopes[direction])
        return found.names[int(np.argmax(is_edge))] if differs else ""

    def _is_at_switch(self, w: np.ndarray) -> bool:
        """Whether one of the system's switches is zero there."""
        found = np.abs(_map(self._found.switches, w[None])[0])
        return bool((found <= MET * self._switches).any())

    def over_edges(self) -> Iterator[Kink]:
        """Give the first edge that lies between two states, where equations jump."""
        motion, may_jump = self._motion, self._found.may_jump
        if not may_jump.any():
            return
        first, last = motion.first, motion.first + 1
        is_reset = motion.is_reset[[first, last]]
        starts = np.zeros(len(first))
        sides = self._sides[:, may_jump]
        begin = sides[first]
        open_ = np.flatnonzero((begin != sides[last]).any(axis=1))
        open_ = open_[np.argsort(motion.steps[first[open_]], kind="stable")]
        for _ in range(MOST_EDGES):
            if not open_.size:
                return
            a, b = (motion.w[x[open_]] for x in (first, last))
            low, high = starts[open_], np.ones(open_.size)
            for _ in range(HALVINGS):
                middle = (low + high) / 2
                own = _map(self._found.sides, a + (b - a) * middle[:, None])[:, may_jump]
                is_before = (own == begin[open_]).all(axis=1)
                low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
            for k, ends in zip(open_.tolist(), zip(low, high, strict=True), strict=True):
                is_met = is_reset[:, k] & [ends[1] < MET, ends[0] > 1 - MET]
                is_past = motion.is_inside and is_met.any()
                kink = None if is_past else self._jump(first[k], *ends)
                if kink is not None:
                    yield kink
                    return
            starts[open_] = high
            begin[open_] = _map(self._found.sides, a + (b - a) * high[:, None])[:, may_jump]
            open_ = open_[(begin[open_] != sides[last[open_]]).any(axis=1)]

    def _jump(self, first: int, low: float, high: float) -> Kink | None:
        """Return the jump of the equations between two points of a step, if a tangent moves it."""
        found, motion = self._found, self._motion
        a, b = motion.w[first : first + 2]
        ends = np.array([a + (b - a) * low, a + (b - a) * high])
        sides = _map(found.sides, ends)
        if not _differ(_map(found.values, ends[[0, 0]], sides), self._values):
            return None
        if motion.ends_at_switches and self._is_at_switch(ends[0]):
            return None
        change = (sides[0] != sides[1]) & found.may_jump
        # a step that begins at an edge, and is beyond it at all stages, has the derivative of the
        # motion where its start stays at the edge, as a block released from rest does
        begins = motion.is_inside and high <= ROUNDINGS
        for way in motion.along[first : first + (1 if begins else 2)].reshape(-1, len(a)):
            largest = (np.abs(way) / self._sizes).max()
            move = way * (MOVED / largest if largest else 0.0)
            moved = [_map(found.sides, ends + sign * move) for sign in (1, -1)]
            if any((own[:, change] != sides[:, change]).any() for own in moved):
                name = found.names[int(np.argmax(change))]
                return Kink(int(motion.steps[first]), float(ends[1, 0]), name, True)
        return None


def _largest(rows: np.ndarray) -> np.ndarray:
    """Return the largest size in each column, in which members that are over are NaN."""
    found: np.ndarray = np.fmax.reduce(np.abs(rows), axis=0, initial=0.0)
    return found


def _differ(both: np.ndarray, sizes: np.ndarray) -> bool:
    """Whether two rows differ, in what is not small in the whole run."""
    largest = np.maximum(sizes, np.abs(both).max(axis=0))
    return bool((np.abs(both[0] - both[1]) > SAME * largest).any())
