"""Newton's method for states of rest, on the tangent space of the constraints."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville.analysis.point import Array, Point, Split
from liouville.analysis.sparse_modes import independent

#: The most corrections; the longest of one, in the size of the coordinates.
MOST, STRIDE = 300, 0.3
#: The most corrections onto the constraints.
RETURNS = 50
#: Corrections below this part of the size are roundoff, and forces left below this part balance.
LAST, BALANCED = 1e-12, 1e-9
#: Curvatures below this part of the largest make no corrections.
SINGULAR = 1e-11
#: A last correction of more than this part of the size leads to no equilibrium: the last of MOST,
#: and one along directions that it has made flat, where minima of high order come near 2e-3.
ENDLESS, ADRIFT = 1e-3, 5e-3
#: A constraint is met where it is no more than this part of its terms.
ROUNDINGS = 4 * float(np.finfo(float).eps)
#: Of the largest curvature, a smaller one is taken as this part.
FLAT = 1e-8
#: A stiffness whose skew part is above this part of it has forces without a potential in it.
UNSYMMETRIC = 1e-6
#: A step that overshoots by this part of the force it began with is made again, half as long.
OVERSHOT = -0.5
#: A constraint that moves faster than this part of the mechanism's size per unit of time is driven.
DRIVEN = 1e-12


class Search(ABC):
    """A search for an equilibrium: a point, its multipliers, and the forces there."""

    def __init__(self, point: Point) -> None:
        self.point, self.lam = point, np.zeros(len(point.system.constraints))
        self.units = point.units
        self.size = self.length_of(point.y) or 1.0
        self.scale = 0.0  # of forces, each in that of an energy over the unit of its coordinate
        self.done = 1  # corrections that were made
        self.way = self.loose = np.zeros(point.n)  # the last of them; its part that goes on
        self._check_driven()

    def length_of(self, change: Array) -> float:
        """Return the largest of coordinates or changes of them, each in its unit."""
        return float(np.abs(change / self.units).max())

    @property
    def missed(self) -> Array:
        """The values of the holonomic constraints, each in its unit."""
        return self.point.missed / self.point.row_units

    def _check_driven(self) -> None:
        """Refuse constraints that move."""
        point = self.point
        rates = point._at("end")[point.n : point.n + point.m]
        moving = np.abs(rates / point.row_units)
        if point.m and moving.max() > DRIVEN * self.size:
            k = int(np.argmax(moving))
            name = point.system.holonomic[k]
            sentence = (
                f"constraint '{name}' moves by {rates[k]:.2g} per unit of time: nothing rests"
            )
            hint = "leave the motion out, or set its speed to zero by params="
            raise ValueError(hinted(sentence, hint))

    @abstractmethod
    def corrected(self) -> float:
        """Make one correction; return its length."""

    def is_stable(self) -> bool | None:
        """Return whether no free direction is pushed away."""
        return None

    def follows(self) -> bool:
        """Return whether a stable state is sought under forces that have no potential."""
        return False

    def move(self, change: Array) -> None:
        """Go by a change of the coordinates."""
        self.point = self.point.moved(self.point.y + change).at_rest()

    def run(self) -> Array:
        """Make corrections until they are roundoff; return the forces left, shape (n,).

        Raises
        ------
        ValueError
            No equilibrium is found.
        """
        limit = ADRIFT
        while self.corrected() > LAST * self.size:
            if self.done == MOST:
                self.loose, limit = self.way, ENDLESS
                break
            self.done += 1
        point = self.point
        left, missed = point.rates[0] + point.reaction(self.lam), self.missed
        sizes = np.abs(self.units * left)
        worst = int(np.argmax(np.where(np.isfinite(sizes), sizes, np.inf)))
        off = float(np.abs(missed).max(initial=0.0))
        if not sizes[worst] <= BALANCED * self.scale:  # which springs that pull may not reach
            sizes = sizes - self.units * point.roundings
            worst = int(np.argmax(np.where(np.isfinite(sizes), sizes, np.inf)))
        if not (sizes[worst] <= BALANCED * self.scale and off <= BALANCED * self.size):
            self._refuse(worst, left, off)
        if self.length_of(self.loose) > limit * self.size:
            self._refuse_drift(left)
        return left

    def _refuse(self, worst: int, left: Array, off: float) -> None:
        """Say which force is left."""
        point, names = self.point, self.point.system.coordinates
        sentence = (
            f"no equilibrium is found near the start: after {self.done} iterations a force of "
            f"{abs(left[worst]):.2g} is left on '{names[worst]}', of forces up to "
            f"{self.scale / self.units[worst]:.2g}"
        )
        if off > BALANCED * self.size:
            k = int(np.argmax(np.abs(self.missed)))
            sentence += (
                f", and constraint '{point.system.holonomic[k]}' is off by "
                f"{abs(point.missed[k]):.2g}"
            )
        first = point.system.states[0]
        hint = f"start at another {first}, or take any kind with stable=False"
        if self.follows():
            hint = (
                "the stiffness is not symmetric, as under follower forces: stable=False finds any "
                "state of rest, and lv.analysis.modes says whether it is stable"
            )
        raise ValueError(hinted(sentence, hint))

    def _refuse_drift(self, left: Array) -> None:
        """Say which coordinate goes on moving although forces have become small."""
        system = self.point.system
        k = int(np.argmax(np.abs(self.loose / self.units)))
        sentence = (
            f"no equilibrium is found near the start: after {self.done} iterations "
            f"'{system.coordinates[k]}' is at {self.point.y[k]:.4g} and still moves by "
            f"{abs(self.loose[k]):.2g} at a time, where forces have fallen to "
            f"{np.abs(left).max():.1e}"
        )
        hint = f"they fall off with the distance: start at another {system.states[0]}"
        raise ValueError(hinted(sentence, hint))


class Dense(Search):
    """The search with dense matrices, split into free directions and others."""

    def __init__(self, point: Point, stable: bool) -> None:
        super().__init__(point)
        self.stable = stable
        self.stride = STRIDE * self.size
        if not self._returned():
            self._refuse_start()
        self._look()

    def _refuse_start(self) -> None:
        """Say which constraint cannot be met near the start."""
        k, system = int(np.argmax(np.abs(self.missed))), self.point.system
        sentence = (
            f"no state on the constraints is found near the start: '{system.holonomic[k]}' is off "
            f"by {abs(self.point.missed[k]):.2g} at last"
        )
        hint = f"start at another {system.states[0]}, nearer to the constraints"
        raise ValueError(hinted(sentence, hint))

    def _look(self) -> None:
        """Compute forces, multipliers, free directions and stiffness at the point, in units."""
        point, system, units = self.point, self.point.system, self.units
        force, _ = point.rates
        gradients = point.blocks("node_blocks", self.lam[: point.m])["g_y"]
        self.normal = Split.of(gradients, units)
        felt = point.reactions(self.lam)
        split = Split.of(felt.T, units)
        # of nonlinear reactions this is one step of Newton's method
        given = force + point.reaction(self.lam) - felt @ self.lam
        self.lam = -split.inverse.T @ given
        self.force = split.null.T @ given
        self.test = split.null
        # no ideal reaction acts along what it leaves free
        self.free = split.null if system.is_ideal else self.normal.null
        self.full = self._stiffness()
        self.stiffness = self.test.T @ self.full @ self.free
        terms = np.abs(self.full) @ np.abs(point.y)
        parts = np.abs(felt) @ np.abs(self.lam)
        sizes = units * np.max([np.abs(force), terms, parts], axis=0)
        self.scale = max(self.scale, float(sizes.max()))

    def _stiffness(self) -> Array:
        """Return the derivative of the forces by coordinates at rest, with the sign of K."""
        point, m = self.point, self.point.m
        stage = point.blocks("stage_jacobian")
        slope = stage["f_y"] + point.blocks("node_jacobian", self.lam[:m])["r_y"]
        of_z = stage["f_z"]
        if point.system.nonholonomic:
            own = point.blocks("nonholonomic_blocks", self.lam[m:])
            slope, of_z = slope + own["rn_y"], of_z + own["rn_z"]
        if "v_z" in point.system.patterns:  # z changes with y so that nothing moves
            slope = slope - of_z @ np.linalg.solve(
                point.blocks("stage_blocks")["v_z"], stage["v_y"]
            )
        found: Array = -slope
        return found

    def corrected(self) -> float:
        """Make one correction along the free directions, and return to the constraints."""
        along = self.free @ self._along()
        length = self.length_of(along)
        if length > self.stride:
            along *= self.stride / length
        before, lam, force = self.point, self.lam, self._pull
        try:
            self.move(along)
            is_back = self._returned()
            change = self.point.y - before.y
            moved = self.length_of(change)
            if is_back:
                self._look()
        except ValueError:  # the model has no values there
            is_back, moved = False, length
        if not is_back and moved > LAST * self.size:
            self.point, self.lam, self.stride = before, lam, min(self.stride, moved) / 2
            self._look()
            return self.stride
        self.size = max(self.size, self.length_of(self.point.y))
        way = change / (np.abs(change).max(initial=0.0) or 1.0)
        then, now = force @ way, self._pull @ way
        if self.stable and moved > 1e-6 * self.size:
            if now < OVERSHOT * abs(then):
                self.point, self.lam, self.stride = before, lam, moved / 2
                self._look()
                return moved
            if now > 0.25 * abs(then):
                self.stride = min(2 * self.stride, STRIDE * self.size)
        if moved > LAST * self.size:
            self.way = change
        else:
            self.loose = self._flat_part(self.way)
        return moved

    def _flat_part(self, way: Array) -> Array:
        """Return the part of a way along directions that the stiffness now leaves flat.

        A stiffness that has become roundoff beside others makes no further correction, although
        the last one was long.
        """
        _, sizes, right = np.linalg.svd(self.stiffness)
        flat = right[int((sizes > SINGULAR * sizes.max(initial=0.0)).sum()) :]
        free = self.free / self.units[:, None]
        return self.free @ (flat.T @ (flat @ (free.T @ (way / self.units))))

    @property
    def _pull(self) -> Array:
        """The force along the free directions, by coordinates."""
        found: Array = (self.test / self.units[:, None] ** 2) @ self.force
        return found

    def follows(self) -> bool:
        """Return whether a stable state is sought under forces that have no potential."""
        own = self.stiffness
        is_square = own.shape[0] == own.shape[1] and own.size > 0
        return (
            self.stable
            and is_square
            and bool(np.abs(own - own.T).max() > UNSYMMETRIC * np.abs(own).max())
        )

    def _returned(self) -> bool:
        """Move onto the constraints by Gauss-Newton steps, to roundoff; say whether they hold."""
        before = np.inf
        for _ in range(RETURNS):
            # refused where it is not finite, before its terms overflow
            off = float(np.abs(self.missed).max(initial=0.0))
            gradients = self.point.blocks("node_blocks", self.lam[: self.point.m])["g_y"]
            terms = np.abs(gradients) @ np.abs(self.point.y)
            # lengths may be small beside angles: below LAST corrections go on while they help
            is_last = off <= LAST * self.size and off > before / 2
            is_stuck = before <= off <= BALANCED * self.size
            if is_last or is_stuck or np.all(np.abs(self.point.missed) <= ROUNDINGS * terms):
                return True
            before = off
            change = -Split.of(gradients, self.units).inverse @ self.point.missed
            length = self.length_of(change)
            self.move(change * min(1.0, STRIDE * self.size / max(length, 1e-300)))
        return False

    def _along(self) -> Array:
        """Return the way along the free directions: Newton's, turned where it would go up."""
        if not self.force.size:
            return np.zeros(self.free.shape[1])
        plain: Array = np.linalg.lstsq(self.stiffness, self.force, rcond=SINGULAR)[0]
        if not self.stable or self.stiffness.shape[0] != self.stiffness.shape[1]:
            return plain
        if np.abs(self.force).max() <= BALANCED * self.scale:
            return plain
        sizes, ways = self._curvatures()
        if sizes.min() > FLAT * np.abs(sizes).max():
            return plain
        floor = FLAT * (np.abs(sizes).max() or 1.0)
        found: Array = ways @ (ways.T @ self.force / np.maximum(np.abs(sizes), floor))
        return found

    def _curvatures(self) -> tuple[Array, Array]:
        """Return eigenvalues and directions of the symmetric part of the stiffness."""
        sizes, ways = np.linalg.eigh((self.stiffness + self.stiffness.T) / 2)
        return sizes, ways

    def is_stable(self) -> bool | None:
        """Return whether no free direction is pushed away."""
        if not self.stiffness.size:
            return True
        if self.stiffness.shape[0] != self.stiffness.shape[1]:
            return None
        sizes, _ = self._curvatures()
        return bool(sizes.min() >= -FLAT * np.abs(sizes).max())


class Sparse(Search):
    """Newton's method with sparse matrices bordered by independent gradients."""

    def __init__(self, point: Point) -> None:
        point.check_plain("equilibria")
        super().__init__(point)
        self.sparse, self.linalg = (scipy(x, "equilibrium") for x in ("sparse", "sparse.linalg"))
        gradients = point.blocks("node_blocks", self.lam)["g_y"].tocsr()
        self.kept = independent(gradients)
        if self.kept:  # what hangs is held by its tension, which zeros have not
            kept = gradients[self.kept]
            squares = self.linalg.splu((kept @ kept.T).tocsc())
            self.lam[self.kept] = squares.solve(kept @ point.rates[0])

    def corrected(self) -> float:
        """Make one correction of coordinates and multipliers together."""
        point, n = self.point, self.point.n
        force, _ = point.rates
        slope = -(
            point.blocks("stage_jacobian")["f_y"] + point.blocks("node_jacobian", self.lam)["r_y"]
        )
        gradients = point.blocks("node_blocks", self.lam)["g_y"].tocsr()[self.kept]
        rows = [[slope, gradients.T], [gradients, None]] if self.kept else [[slope]]
        right = np.append(force + point.reaction(self.lam), -point.missed[self.kept])
        terms = abs(slope) @ np.abs(point.y)
        forces = self.units * np.maximum(np.abs(force), terms)
        self.scale = max(self.scale, float(forces.max()))
        try:
            found = self.linalg.splu(self.sparse.block_array(rows, format="csc")).solve(right)
        except RuntimeError:
            sentence = "the stiffness is singular: nothing holds the system in some direction"
            raise ValueError(hinted(sentence, "hold it by constraints or springs")) from None
        length = self.length_of(found[:n])
        first = self.point.y.any()
        part = min(1.0, STRIDE * self.size / length) if first and length else 1.0
        self.lam[self.kept] += part * found[n:]
        self.way = part * found[:n]
        self.move(self.way)
        self.size = max(self.size if first else 0.0, self.length_of(self.point.y)) or 1.0
        return part * length
