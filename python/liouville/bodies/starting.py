"""Start values of a mechanism: coordinates of joints as given, loops closed, rates solved for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted, quoted
from liouville._systems.mechanics.singular import unit
from liouville._systems.mechanics.violations import finite_time
from liouville._systems.tracing import trace as _trace
from liouville.bodies import scales, turns
from liouville.bodies.joints import MOTION, RATES
from liouville.bodies.model import Place
from liouville.bodies.tree import Tree

if TYPE_CHECKING:
    from liouville.bodies.mechanism import Mechanism

Array = NDArray[np.float64]

#: Singular values below this part of the largest are zero: of a solution, and of a rank.
CUTOFF, RANK = 1e-8, 1e-9
#: Loops are closed where they miss by no more than this part of the mechanism's size.
CLOSED = 1e-10
#: The longest way of an angle, and of a slide in the mechanism's size, in one go.
STRIDE = 0.3
#: The most strides from the places as drawn: some hundred turns.
STRIDES = 3000
#: The most corrections of a place, and how large one may be.
MOST, LARGEST = 60, 0.5
#: Places that miss by less than this part of the size are corrected once more.
LAST = 1e-11
#: How far a mechanism is moved to see whether it moves, and the part of it that is no return.
ASIDE, RETURNED = 1e-3, 0.3


class Starting:
    """The search for start values of a mechanism."""

    def __init__(
        self, system: Mechanism, t: float, params: Array, given: Mapping[str, Any]
    ) -> None:
        self.system, self.t, self.params = system, t, params
        n = len(system.coordinates)
        self.still = np.zeros(n)
        joints = [system.place(name) for name in system.joints]
        points, drawn, pitches, anchors = (
            system.output(name, params, t, self.still, self.still)[0]
            for name in ("points", "drawn", "pitches", "anchors")
        )
        drawn = drawn.reshape(-1, 3).T
        layout = system.body_layout
        sizes = points.reshape(-1, 2, 3), pitches, anchors.reshape(-1, 3)
        self.tree = Tree(layout, joints, given, drawn, *sizes)
        self.length = scales.length_of(scales.size_of(system, params))
        #: the size in units of length, in which all that is searched is measured
        self.size = scales.size_of(system, params) / self.length
        self.columns = self.tree.units(self.length)
        self.coordinates = scales.of_coordinates(system, self.length)
        #: coordinates of joints that count turns
        self.counted = {
            place.first + place.coordinates.index(name)
            for place in joints
            for name in system.counted(place.name)
        }
        kept = {x.joint.name for x in self.tree.branches if x.joint is not None and x.is_kept}
        own = {x for name in kept for x in system.place(name).rows if MOTION not in x}
        own |= {f"{body}.unit" for body in system.bodies}
        own |= {turns.row_name(*angle) for angle in layout.counted}  # the tree follows them
        #: constraints that moves along the tree do not keep by themselves
        self.open = [k for k, name in enumerate(system.holonomic) if name not in own]
        self.is_driven = any(MOTION in name for name in system.holonomic)
        self.is_tree = not (self.open or system.nonholonomic)
        self._check_finite()
        changes = np.zeros(len(system.holonomic))
        if self.open:
            q, v = self.tree.q(), self.tree.rates()
            slopes = self.slopes(q, v)[0][: len(self.open)] * self.columns
            changes[self.open] = np.abs(slopes).max(axis=1, initial=0.0)
        self.units = scales.of_rows(system, self.length, changes)

    def _check_finite(self) -> None:
        """Refuse constraints that have no value or no rate where bodies are drawn."""
        names, q = self.system.constraints, self.tree.q()
        m = len(self.system.holonomic)
        moves = np.hstack([self.tree.rates(), self.still[:, None]])
        changing = [*(names[k] for k in self.open), *names[m:]]
        rates = self._hidden(q, moves) if changing else np.empty((0, 1))
        for what, of, found in (
            ("constraint", names[:m], self._missed(q)[:, None]),
            ("the rate of constraint", changing, rates),
        ):
            for name, row in zip(of, found, strict=True):
                if not np.isfinite(row).all():
                    sentence = f"{what} '{name}' is not finite as drawn, t = {self.t:g}"
                    hint = "look for a division by zero, a root or a logarithm of the model there"
                    raise ValueError(hinted(sentence, hint))

    def _missed(self, q: Array) -> Array:
        m = len(self.system.holonomic)
        found: Array = self.system.at_point("node", self.params, self.t, q, np.zeros(m))[:m]
        return found

    def rows(self, q: Array) -> Array:
        """Return the residuals of all constraints, in their units."""
        return self._missed(q) / self.units

    def slopes(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the rates of open constraints in all moves, and those without any."""
        found = [self._hidden(q, x) for x in (v, self.still[:, None])]
        return found[0] - found[1], found[1][:, 0]

    def _hidden(self, q: Array, v: Array) -> Array:
        """Return the rates of holonomic constraints and nonholonomic ones, a column each."""
        n, m, k = len(q), len(self.system.holonomic), v.shape[1]
        at = np.full(k, self.t), np.tile(q, (k, 1)), v.T
        rows = self.system.map_tape("end", self.params, *at)[:, n : n + m][:, self.open]
        if own := len(self.system.nonholonomic):
            nu = np.zeros((k, own))
            more = self.system.map_tape("nonholonomic", self.params, *at, nu)[:, :own]
            rows = np.hstack([rows, more])
        return rows.T

    def values(self) -> Array:
        """Return the coordinates of all joints."""
        found: Array = self.system.output("values", self.params, self.t, self.tree.q(), self.still)[
            0
        ]
        return found

    def value_slopes(self, q: Array, v: Array, held: list[int]) -> Array:
        """Return the rates of some coordinates of joints in all moves."""
        k = v.shape[1]
        at = np.full(k, self.t), np.tile(q, (k, 1)), v.T
        return self.system.output("rates", self.params, *at)[:, held].T

    def close(self, held: list[int], wanted: Array, angles: list[int]) -> float:
        """Solve for places with some coordinates held; returns what is missed at last."""
        tree, units = self.tree, self._units_of(held, angles)
        wrapped = [k for k in angles if held[k] not in self.counted]

        def missed() -> Array:
            off = self.values()[held] - wanted
            off[wrapped] = (off[wrapped] + 2 * np.pi) % (4 * np.pi) - 2 * np.pi
            return np.concatenate([self.rows(tree.q())[self.open], off / units])

        off = missed()
        for _ in range(MOST):
            norm = float(np.linalg.norm(off))
            if norm == 0 or (self.is_tree and not held):
                break
            q, v = tree.q(), tree.rates()
            of_rows = self.slopes(q, v)[0][: len(self.open)] / self.units[self.open, None]
            slopes = np.vstack([of_rows, self.value_slopes(q, v, held) / units[:, None]])
            way = -np.linalg.pinv(slopes * self.columns, CUTOFF) @ off
            way *= min(1.0, LARGEST / max(np.abs(way).max(initial=0.0), 1e-300))
            before = tree.state
            for damping in (1.0, 0.5, 0.25, 0.125, 1 / 64):
                tree.move(damping * self.columns * way)
                after = missed()
                if np.linalg.norm(after) < norm:
                    break
                tree.state = before
            else:
                break
            off = after
            if norm <= LAST * self.size:
                break
        return float(np.abs(off).max(initial=0.0))

    def _units_of(self, held: list[int], angles: list[int]) -> Array:
        """Return the units of coordinates of joints."""
        return np.array([1.0 if k in angles else self.length for k in range(len(held))])

    def assemble(self, held: list[int], wanted: Array, angles: list[int]) -> Array:
        """Close the loops as drawn, then move the coordinates given to where they are wanted."""
        tree = self.tree
        drawn = tree.state
        limit = CLOSED * self.size
        gap = self.close([], np.empty(0), [])
        if not held and gap > limit:
            self._refuse()
        now = self.values()[held]
        way = wanted - now
        longest = np.array([1.0 if k in angles else self.size for k in range(len(held))])
        sizes = longest * self._units_of(held, angles)
        far = float(np.abs(way / sizes).max(initial=0.0)) / STRIDE
        if far > STRIDES:
            sentence = f"a value given is {np.abs(way).max():g} away from the places as drawn"
            hint = "angles are in radians, and slides in the unit of length of the places"
            raise ValueError(hinted(sentence, hint))
        strides = int(np.ceil(far)) if gap <= limit else 0
        for k in range(1, strides + 1):
            gap = self.close(held, now + way * k / strides, angles)
            if gap > limit:
                break
        if gap > limit:
            tree.state = drawn
            gap = self.close(held, wanted, angles)
        if gap > limit:
            self._refuse()
        return tree.q()

    def _refuse(self) -> None:
        """Raise the error of loops that cannot be closed."""
        rows = np.abs(self.rows(self.tree.q()))
        own = {name: k for k, name in enumerate(self.system.holonomic)}
        places = [self.system.place(name) for name in self.system.joints]
        gaps = {
            place.name: max((rows[own[x]] for x in place.rows if x in own), default=0.0)
            for place in places
        }
        worst = max(gaps, key=lambda name: gaps[name])
        if gaps[worst] <= CLOSED * self.size:
            raise ValueError(
                hinted(
                    "the values given contradict one another or the joints",
                    "give fewer of them: the others are solved for",
                )
            )
        place = self.system.place(worst)
        row = max((x for x in place.rows if x in own), key=lambda x: rows[own[x]])
        miss = gaps[worst] * self.units[own[row]]
        if MOTION in row:
            raise ValueError(
                hinted(
                    f"joint '{worst}' cannot be where its motion= has it at t = {self.t:g}: it "
                    f"misses by {miss:.2g}",
                    "give no values against it, or a motion that the mechanism can follow",
                )
            )
        inside = next((x for x in self.tree.loops if x.name == worst), None)
        loop = self.tree.loop(inside or (self.tree.loops or places)[0])
        raise ValueError(
            hinted(
                f"the loop through {quoted(loop)} cannot be closed: joint '{worst}' misses by "
                f"{miss:.2g} at best",
                "look at the lengths of its bodies, or give other values",
            )
        )

    def check_freedom(self, q: Array) -> None:
        """Refuse a mechanism that cannot move."""
        if self.is_tree:
            if not any(branch.moves for branch in self.tree.branches):
                self._locked([x.name for x in self._all_joints()], "the mechanism has no freedom")
            return
        v = self.tree.rates()
        slopes, _ = self.slopes(q, v)
        rows = [self.system.holonomic[k] for k in self.open]
        slopes[: len(rows)] /= self.units[self.open, None]
        sizes = np.abs(slopes[len(rows) :] * self.columns).max(axis=1, initial=0.0)
        slopes[len(rows) :] *= unit(sizes)[:, None]
        motions = [k for k, row in enumerate(rows) if MOTION in row]
        null = self._null(v, np.delete(slopes, motions, axis=0))
        names = [x.name for x in self._all_joints()]
        if not null.shape[1]:
            self._locked(names, "the mechanism has no freedom")
        if self.tree.loops and not self.is_driven and not self._moves(null):
            self._locked(names, "the mechanism has first-order mobility only, and is locked")

    def _all_joints(self) -> list[Place]:
        return [self.system.place(name) for name in self.system.joints]

    def _locked(self, names: list[str], what: str) -> None:
        shown = names if len(names) <= 12 else [*names[:11], "..."]
        hint = "leave a joint out, or take one that leaves more free"
        raise ValueError(hinted(f"{what}: joints {quoted(shown)} leave nothing to move", hint))

    def _null(self, v: Array, slopes: Array) -> Array:
        """Return moves of bodies that keep all constraints, a column each, in their units."""
        own = np.eye(v.shape[1])
        slopes = slopes * self.columns
        if set(self.system.body_layout.kinds) != {"spatial"}:  # some moves may be none of theirs
            scaled = v * self.columns / self.coordinates[:, None]
            _, sizes, basis = np.linalg.svd(scaled, full_matrices=False)
            own = basis[sizes > RANK * sizes.max(initial=0.0)].T
        _, sizes, rows = np.linalg.svd(slopes @ own)
        limit = RANK * max(sizes.max(initial=0.0), min(1.0, self.size))
        null: Array = own @ rows[int((sizes > limit).sum()) :].T
        return null

    def _moves(self, null: Array) -> bool:
        """Return whether a small move along the freedoms does not return when loops are closed."""
        tree, before = self.tree, self.tree.state
        q = tree.q() / self.coordinates
        ways = [*null.T[:3], null @ np.random.default_rng(0).standard_normal(null.shape[1])]
        found = False
        for way in ways:
            tree.state = before
            tree.move(ASIDE * self.columns * way / np.abs(way).max())
            aside = np.linalg.norm(tree.q() / self.coordinates - q)
            gap = self.close([], np.empty(0), [])
            left = np.linalg.norm(tree.q() / self.coordinates - q)
            found = bool(gap <= CLOSED * self.size and left > RETURNED * aside)
            if found:
                break
        tree.state = before
        return found

    def velocities(self, q: Array, held: list[int], wanted: Array) -> Array:
        """Return v with the rates given, and the others as small as they can be."""
        v = self.tree.rates()
        own = self.value_slopes(q, v, held)
        if self.is_tree:
            slopes, right = own, wanted
        else:
            found, still = self.slopes(q, v)
            slopes, right = np.vstack([found, own]), np.append(-still, wanted)
        # each unknown, and each equation but roundoff, in a unit of its own: lengths or angles
        columns = unit(np.abs(slopes).max(axis=0, initial=0.0))
        sizes = np.abs(slopes * columns).max(axis=1, initial=0.0)
        rows = unit(np.where(sizes > scales.ROUNDOFF * sizes.max(initial=0.0), sizes, 0.0))
        slopes, right = rows[:, None] * slopes, rows * right
        inverse = columns[:, None] * np.linalg.pinv(slopes * columns, CUTOFF)
        ways = inverse @ right
        ways += inverse @ (right - slopes @ ways)
        miss = np.abs(slopes @ ways - right).max(initial=0.0)
        if miss > 1e-9 * max(np.abs(right).max(initial=0.0), 1e-12):
            raise ValueError(
                hinted(
                    f"the rates given contradict one another or the joints, by {miss:.2g}",
                    "give fewer of them: the others are solved for",
                )
            )
        found = v @ ways
        return np.asarray(found)


def assembled(
    system: Mechanism,
    values: Mapping[str, ArrayLike] | None,
    rates: Mapping[str, ArrayLike] | None,
    t: float,
    params: Mapping[str, ArrayLike] | None,
) -> dict[str, Array]:
    """Return start values; see :meth:`Mechanism.assemble`."""
    t = finite_time(t)
    held, wanted = _given(system, "values", values)
    moving, speeds = _given(system, "rates", rates)
    places = [system.place(joint) for joint in system.joints]
    names = [name for place in places for name in place.coordinates]
    turning = [name in place.angles for place in places for name in place.coordinates]
    angles = [k for k, at in enumerate(held) if turning[at]]
    for at in held:
        if names[at] in RATES:
            joint = next(x for x in system.joints if at < system.place(x).first + 6)
            raise ValueError(
                hinted(
                    f"values: joint '{joint}' has rates only, and no values that could be given",
                    "draw its bodies where they start",
                )
            )
    search = Starting(system, t, system.values(params), {**(values or {}), **(rates or {})})
    q = search.assemble(held, wanted, angles)
    for k in angles:
        if held[k] not in search.counted and abs(wanted[k]) > 2 * np.pi:
            joint = [x.name for x in places if x.first <= held[k]][-1]
            sentence = f"values: joint '{joint}' counts no turns, and {wanted[k]:g} is over one"
            hint = "nothing depends on it but an attitude: give it within one turn, in radians"
            raise ValueError(hinted(sentence, hint))
    search.check_freedom(q)
    return {"q": q, "v": search.velocities(q, moving, speeds)}


def _given(
    system: Mechanism, what: str, given: Mapping[str, ArrayLike] | None
) -> tuple[list[int], Array]:
    """Return the places and the numbers of coordinates that are given by joint."""
    places: list[int] = []
    numbers: list[float] = []
    for name, value in _trace.mapping(what, given).items():
        place = system.place(name)
        count = len(place.coordinates)
        if not count:
            raise ValueError(f"{what}: joint '{name}' has no coordinates")
        row = value if isinstance(value, list | tuple | np.ndarray) else [value]
        if len(row) != count:
            raise ValueError(
                f"{what}: joint '{name}' has the coordinates {', '.join(place.coordinates)}, "
                f"and {len(row)} of them are given"
            )
        for k, number in enumerate(row):
            if number is None:
                continue
            found = _trace.numbers(number)
            if found is None or found.shape or not np.isfinite(found):
                raise ValueError(
                    f"{what} of joint '{name}' must be a finite number, not {number!r}"
                )
            places.append(place.first + k)
            numbers.append(float(found))
    return places, np.array(numbers)
