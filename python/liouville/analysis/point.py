"""A mechanical system at one state: forces, matrices, and directions that constraints leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville._systems import Mechanics, Structure
from liouville._systems.mechanics.motion import linearized
from liouville._systems.mechanics.singular import dense, unit
from liouville._systems.mechanics.violations import FLOOR, ROUNDINGS, finite_time
from liouville._systems.tracing.linear import Pattern
from liouville.bodies import Mechanism, scales

Array = NDArray[np.float64]

#: Singular values of gradients of length one below this part of the largest are zero.
RANK = 1e-9
#: Systems of more coordinates are not taken apart by dense matrices.
LARGE = 1000
#: Forces left below this part of those there are in balance.
BALANCED = 1e-6
#: The most corrections of a velocity of rest, or of nonlinear multipliers, and their last size.
MOST, LAST = 50, 1e-14

#: The derivatives on each tape, in their order.
TAPES = {
    "stage_blocks": ("p_z", "v_z"),
    "stage_jacobian": ("p_y", "f_y", "f_z", "v_y"),
    "node_blocks": ("g_y", "r_lam"),
    "node_jacobian": ("r_y",),
    "nonholonomic_blocks": ("k_y", "k_z", "rn_y", "rn_z", "rn_nu"),
}


def mechanical(system: Any, what: str, *, touches: bool = False) -> Mechanics:
    """Return a mechanical system; TypeError for any other, and for contacts but where it may."""
    if not isinstance(system, Mechanics):
        raise TypeError(
            hinted(
                f"{what} takes a mechanical system, not a {type(system).__name__}",
                "a Lagrangian, Hamiltonian, Mechanical, Structure or the system of an assembly",
            )
        )
    if not touches:
        system.check_smooth(what)
    return system


@dataclass(frozen=True)
class Split:
    """A matrix by its singular values: what it leaves free, and its pseudo-inverse.

    Attributes
    ----------
    null : ndarray, shape (n, n - rank)
        A basis of the directions that it maps to zero, all of them if it has no rows; orthonormal
        in the units of the columns.
    inverse : ndarray, shape (n, m)
        The pseudo-inverse, the least solution in these units.
    """

    null: Array
    inverse: Array

    @classmethod
    def of(cls, rows: Array, units: Array | None = None) -> Split:
        """Split a matrix of shape (m, n), its rows taken with length one, its columns in units."""
        m, n = rows.shape
        units = np.ones(n) if units is None else units
        own = units[:, None]
        if not m:
            return cls(own * np.eye(n), np.zeros((n, 0)))
        rows = rows * units
        lengths = np.linalg.norm(rows, axis=1)
        lengths[lengths == 0] = 1.0
        left, sizes, right = np.linalg.svd(rows / lengths[:, None])
        rank = int((sizes > RANK * sizes.max(initial=0.0)).sum())
        inverse = (right[:rank].T / sizes[:rank]) @ left[:, :rank].T / lengths
        return cls(own * right[rank:].T, own * inverse)


class Point:
    """A system at (t, y, z) with its derivatives, which are dense unless `sparse` is asked for."""

    def __init__(
        self, system: Mechanics, t: float, y: Array, z: Array, params: Array, sparse: bool = False
    ) -> None:
        self.system, self.t, self.y, self.z, self.params = system, t, y, z, params
        self._sparse = sparse
        self.n, self.m = len(y), len(system.holonomic)

    @classmethod
    def given(
        cls,
        system: Mechanics,
        start: Mapping[str, Any],
        t: float,
        params: Mapping[str, ArrayLike] | None,
    ) -> Point:
        """Take the state of a user's, at rest unless its second half is given.

        A structure is undeformed unless its first half is.
        """
        t, values = finite_time(t), system.values(params)
        first, second = system.states
        zero = np.zeros(len(system.coordinates))
        is_still = start.get(second) is None
        own = {second: zero} if is_still else {}
        if isinstance(system, Structure) and start.get(first) is None:
            own[first] = zero
        y, z = system.start({**start, **own})
        point = cls(system, t, y, z, values, len(y) > LARGE)
        return point.at_rest() if is_still else point

    def moved(self, y: Array) -> Point:
        """Return the same with other coordinates."""
        return Point(self.system, self.t, y, self.z, self.params, self._sparse)

    def at_rest(self) -> Point:
        """Return the same with the z that has no velocity.

        Raises
        ------
        ValueError
            There is none near z.
        """
        z = self.z
        if "v_z" not in self.system.patterns:
            return Point(self.system, self.t, self.y, np.zeros_like(z), self.params, self._sparse)
        for _ in range(MOST):
            there = Point(self.system, self.t, self.y, z, self.params)
            change = np.linalg.lstsq(there.blocks("stage_blocks")["v_z"], there.velocity)[0]
            z = z - change
            if not np.abs(change).max() > LAST * max(np.abs(z).max(), 1e-300):
                return Point(self.system, self.t, self.y, z, self.params, self._sparse)
        sentence = f"no {self.system.states[1]} without velocity is found at t = {self.t:g}"
        raise ValueError(hinted(sentence, f"give {self.system.states[1]}= near it"))

    def check_plain(self, what: str) -> None:
        """Refuse what sparse matrices are not made for."""
        system = self.system
        if system.nonholonomic or "v_z" in system.patterns or not system.is_ideal:
            sentence = (
                f"{what} of {self.n} coordinates are those of holonomic constraints with ideal "
                "reactions, and velocities of their own"
            )
            raise TypeError(hinted(sentence, "write the system as a Lagrangian or a Structure"))

    def check(self) -> None:
        """Refuse a state off its constraints."""
        self.system.check(self.t, self.y, self.z, self.params)

    def check_balance(self, left: Array, stiffness: float, units: Array) -> None:
        """Refuse a state where forces are left, by the largest stiffness in these units."""
        force, _ = self.rates
        size = max(float(np.abs(x / units).max()) for x in (self.y, self.z))
        # near zero all forces are roundoff, and none is small beside the others
        size = FLOOR / BALANCED if size < FLOOR else size
        scale = float(np.abs(units * force).max()) + stiffness * size
        sizes = np.abs(units * left)
        worst = int(np.argmax(sizes))
        limit = BALANCED * scale
        if not (
            sizes[worst] <= limit or sizes[worst] <= limit + units[worst] * self.roundings[worst]
        ):
            sentence = (
                f"the state is no equilibrium: the force left on '{self.system.coordinates[worst]}'"
                f" is {abs(left[worst]):.2g}, of forces up to {scale / units[worst]:.2g}"
            )
            raise ValueError(hinted(sentence, "equilibrium(system, ...) finds one: **found.start"))

    def _at(self, tape: str, *more: Array) -> Array:
        state = (self.y,) if tape.startswith("node") else (self.y, self.z)
        found = self.system.at_point(tape, self.params, self.t, *state, *more)
        if not np.isfinite(found).all():
            names = [name for part in self.system.layout[tape][1].values() for name in part]
            if tape == "acceleration":
                names[: self.n] = [f"the force on '{name}'" for name in self.system.coordinates]
            self._refuse(names[int(np.argmin(np.isfinite(found)))])
        return found

    def _refuse(self, what: str) -> None:
        """Raise the error of a model without a value."""
        sentence = f"{what} is not finite at this state, t = {self.t:g}"
        hint = "look for a division by zero, a root or a logarithm of the model there"
        raise ValueError(hinted(sentence, hint))

    def matrix(self, pattern: Pattern, values: Array) -> Any:
        """Return a derivative by its entries."""
        if not self._sparse:
            return dense(pattern, values)
        rows, columns, row, column = pattern
        sparse = scipy("sparse", f"a system of {self.n} coordinates")
        return sparse.csc_array((values[: len(row)], (row, column)), shape=(rows, columns))

    def blocks(self, tape: str, *more: Array) -> dict[str, Any]:
        """Return the derivatives on a tape by name."""
        values, patterns = self._at(tape, *more), self.system.patterns
        return self._named(values, {x: patterns[x] for x in TAPES[tape] if x in patterns})

    def linearized(self, u: Array, lam: Array) -> dict[str, Any]:
        """Return the derivatives of the equations of motion, with z' = u."""
        tape, patterns = linearized(self.system)
        parts = np.array([self.t]), self.y, self.z, u, lam[: self.m], lam[self.m :]
        values = tape.map(self.params, [np.ascontiguousarray(x.reshape(1, -1)) for x in parts])
        if not np.isfinite(values).all():
            self._refuse("a derivative of the equations of motion")
        return self._named(values[0], patterns)

    def _named(self, values: Array, patterns: Mapping[str, Pattern]) -> dict[str, Any]:
        cuts = np.cumsum([len(pattern[2]) for pattern in patterns.values()])[:-1]
        pairs = zip(patterns.items(), np.split(values, cuts), strict=True)
        return {name: self.matrix(pattern, part) for (name, pattern), part in pairs}

    @cached_property
    def velocity(self) -> Array:
        """The velocity y', shape (n,)."""
        if "v_z" not in self.system.patterns:
            return self.z
        return self._at("stage")[2 * self.n :]

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """The force f - p_t - p_y v, and the rates of (w, k) without z'."""
        found, rows = self._at("acceleration"), len(self.system.constraints)
        return found[: self.n], found[self.n : self.n + rows]

    @cached_property
    def roundings(self) -> Array:
        """Possible roundoff of the forces, shape (n,), as of springs that pull."""
        tape, at = self.system.tapes["acceleration"], [np.array([self.t]), self.y, self.z]
        found: Array = ROUNDINGS * tape.roundings(self.params, at)[: self.n]
        return found

    @cached_property
    def _length(self) -> float:
        """The unit of length of a mechanism, by its size."""
        assert isinstance(self.system, Mechanism), "other systems have no size"
        return scales.length_of(scales.size_of(self.system, self.params))

    @cached_property
    def units(self) -> Array:
        """The units of coordinates, those of a mechanism's size."""
        if not isinstance(self.system, Mechanism):
            return np.ones(self.n)
        return scales.of_coordinates(self.system, self._length)

    @cached_property
    def row_units(self) -> Array:
        """The units of holonomic constraints: how much they change by coordinates, each in its own.

        Of a mechanism those that are lengths or angles have the units of these.
        """
        if not self.m:
            return np.ones(0)
        gradients = self.blocks("node_blocks", np.zeros(self.m))["g_y"]
        if self._sparse:
            sizes = abs(gradients.multiply(self.units)).max(axis=1).toarray().ravel()
        else:
            sizes = np.abs(gradients * self.units).max(axis=1)
        if isinstance(self.system, Mechanism):
            return scales.of_rows(self.system, self._length, sizes)
        return np.array([1 / unit(size) for size in sizes])

    @cached_property
    def missed(self) -> Array:
        """The values of the holonomic constraints, shape (m,)."""
        return self._at("node", np.zeros(self.m))[: self.m]

    def reaction(self, lam: Array) -> Array:
        """Return the reactions of all constraints, shape (n,)."""
        found = self._at("node", lam[: self.m])[self.m :]
        own = len(self.system.nonholonomic)
        return found + self._at("nonholonomic", lam[self.m :])[own:] if own else found

    def held(self) -> Any:
        """Return the derivatives of all constraints by z: of g along the velocity, and of k."""
        blocks = self.blocks("node_blocks", np.zeros(self.m))
        found = blocks["g_y"]
        if "v_z" in self.system.patterns:
            found = found @ self.blocks("stage_blocks")["v_z"]
        if not self.system.nonholonomic:
            return found
        zero = np.zeros(len(self.system.nonholonomic))
        return np.vstack([found, self.blocks("nonholonomic_blocks", zero)["k_z"]])

    def reactions(self, lam: Array) -> Any:
        """Return the derivatives of all reactions by their multipliers, shape (n, m)."""
        found = self.blocks("node_blocks", lam[: self.m])["r_lam"]
        if not self.system.nonholonomic:
            return found
        own = self.blocks("nonholonomic_blocks", lam[self.m :])["rn_nu"]
        return np.hstack([found, own])

    def motion(self) -> tuple[Array, Array]:
        """Return z' and all multipliers, of redundant constraints the least ones.

        Raises
        ------
        ValueError
            The mass matrix is singular in directions that the constraints leave.
        """
        units = self.units
        held, mass = Split.of(self.held(), units), self.blocks("stage_blocks")["p_z"]
        force, rate = self.rates
        lam = np.zeros(len(self.system.constraints))
        own = -held.inverse @ rate
        for _ in range(MOST):
            felt = self.reactions(lam)
            split = Split.of(felt.T, units)
            given = force + self.reaction(lam) - felt @ lam
            inside = split.null.T @ mass @ held.null
            try:
                ways = np.linalg.solve(inside, split.null.T @ (given - mass @ own))
            except np.linalg.LinAlgError:
                self._singular()
            u = own + held.null @ ways
            before, lam = lam, split.inverse.T @ (mass @ u - given)
            if self.system.is_ideal or np.allclose(lam, before, rtol=1e-13, atol=0.0):
                break
        if not np.isfinite(u).all():
            self._singular()
        return u, lam

    def _singular(self) -> None:
        sentence = "the equations for accelerations are singular at this state"
        hint = "every direction that the constraints leave needs a mass"
        raise ValueError(hinted(sentence, hint)) from None
