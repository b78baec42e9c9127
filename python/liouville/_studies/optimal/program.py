"""Sparse nonlinear programs that are sums of a few functions, each repeated along the time.

Every function depends on few variables. It is differentiated once, as a small program of its own,
and mapped over its copies; their derivatives are placed in the sparse matrices of the whole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tracing.sparse import entries

Array = NDArray[np.float64]
Places = NDArray[np.int64]

#: Units are needed where a size is beyond two to this power.
FAR = 13


@dataclass(frozen=True)
class Block:
    """A function of few variables and of the number of a copy, repeated.

    Attributes
    ----------
    name : str
        What it is, for messages.
    variables : SX, shape (k, 1)
        Its variables.
    number : SX
        The number of the copy, from 0.
    cost : SX
        What it adds to the cost.
    rows : SX, shape (r, 1)
        Its constraints.
    limits : tuple of ndarray, shape (r,)
        Least and largest values of the constraints.
    labels : tuple of str
        The names of the constraints.
    places : ndarray of int, shape (copies, k)
        Where the variables of each copy are among all.
    """

    name: str
    variables: ca.SX
    number: ca.SX
    cost: ca.SX
    rows: ca.SX
    limits: tuple[Array, Array]
    labels: tuple[str, ...]
    places: Places

    @property
    def copies(self) -> int:
        """How many there are."""
        return len(self.places)

    @property
    def _inputs(self) -> list[ca.SX]:
        return [self.variables, self.number]

    @cached_property
    def values(self) -> ca.Function:
        """Cost and constraints."""
        return ca.Function(self.name, self._inputs, [self.cost, ca.densify(self.rows)])

    @cached_property
    def gradient(self) -> ca.Function:
        """Cost and its gradient."""
        slope = ca.densify(ca.gradient(self.cost, self.variables))
        return ca.Function("gradient", self._inputs, [self.cost, slope])

    @cached_property
    def jacobian(self) -> tuple[ca.Function, Places, Places]:
        """Constraints with the entries of their derivative; rows and columns of these."""
        matrix = ca.jacobian(self.rows, self.variables)
        function = ca.Function("jacobian", self._inputs, [ca.densify(self.rows), entries(matrix)])
        return function, *_triplet(matrix)

    @cached_property
    def hessian(self) -> tuple[ca.Function, Places, Places]:
        """Entries on and above the diagonal of the Lagrangian's; rows and columns of these."""
        weight, lam = ca.SX.sym("weight"), ca.SX.sym("lam", self.rows.numel())
        total = weight * self.cost + ca.dot(lam, ca.densify(self.rows))
        matrix = ca.triu(ca.hessian(total, self.variables)[0])
        function = ca.Function("hessian", [*self._inputs, weight, lam], [entries(matrix)])
        return function, *_triplet(matrix)


class Program:
    """Minimise the sum of the costs of blocks, their constraints within limits.

    Parameters
    ----------
    size : int
        The number of variables.
    blocks : list of Block
        What it is made of; constraints are in their order, copy by copy.
    """

    def __init__(self, size: int, blocks: list[Block]) -> None:
        self.size, self.blocks = size, blocks
        counts = [block.copies * block.rows.numel() for block in blocks]
        self._firsts = np.concatenate([[0], np.cumsum(counts)])

    @property
    def equations(self) -> int:
        """The number of constraints."""
        return int(self._firsts[-1])

    @property
    def conditions(self) -> int:
        """The number of constraints that are equations."""
        low, high = self.limits
        return int(np.count_nonzero(low == high))

    @property
    def limits(self) -> tuple[Array, Array]:
        """Least and largest values of all constraints."""
        both = [np.tile(np.array(block.limits), block.copies) for block in self.blocks]
        low, high = np.hstack([np.zeros((2, 0)), *both])
        return low, high

    def rows_of(self, block: Block, values: Array) -> Array:
        """Return the values that belong to a block's constraints, shape (copies, r)."""
        k = self.blocks.index(block)
        return values[self._firsts[k] : self._firsts[k + 1]].reshape(block.copies, -1)

    def label(self, row: int) -> tuple[str, int]:
        """Return the name of a constraint, and its copy."""
        k = int(np.searchsorted(self._firsts, row, side="right")) - 1
        copy, own = divmod(row - int(self._firsts[k]), self.blocks[k].rows.numel())
        return self.blocks[k].labels[own], copy

    def solve(
        self,
        guess: Array,
        bounds: tuple[Array, Array],
        sizes: tuple[Array, Sequence[Places]],
        options: Mapping[str, Any],
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Solve it by IPOPT, whose tolerances are absolute, in units of these sizes.

        Returns x, f, how far g is beyond its limits, and multipliers, and IPOPT's own numbers;
        "off" is the farthest, in these units. Sizes that are NaN follow from the others, the same
        for places that are alike.
        """
        units = Units.of(self, guess, *sizes)
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", 0)
        f, g = self._values(ca.DM(units.x) * x)
        problem: Any = {"x": x, "p": p, "f": f / units.f, "g": g / ca.DM(units.g)}
        own: Any = {
            **units.derivatives(self),
            "calc_lam_p": False,
            "print_time": False,
            "show_eval_warnings": False,
            "ipopt": dict(options),
        }
        try:
            solver = ca.nlpsol("optimal_control", "ipopt", problem, own)
        except RuntimeError as error:
            last = str(error).strip().splitlines()[-1]
            said = last.partition(": ")[2] or last  # "type mismatch" stands alone
            hint = "its options are those of coin-or.github.io/Ipopt/OPTIONS.html"
            raise ValueError(hinted(f"IPOPT refuses its options: {said}", hint)) from error
        low, high = self.limits
        least, most = (side / units.x for side in bounds)
        found = solver(
            x0=guess / units.x, p=[], lbx=least, ubx=most, lbg=low / units.g, ubg=high / units.g
        )
        arrays = {name: np.array(value).ravel() for name, value in found.items()}
        arrays["g"] -= np.clip(arrays["g"], low / units.g, high / units.g)
        off = float(np.abs(arrays["g"]).max(initial=0.0))
        return units.undone(arrays), {**solver.stats(), "off": off}

    def slope(self, x: Array, lam: Array) -> Array:
        """Return the gradient of the cost with the constraints weighted by their multipliers."""
        _, gradient = self._gradient(x, [])
        _, jacobian = self._jacobian(x, [])
        found: Array = np.array(gradient + ca.mtimes(jacobian.T, lam)).ravel()
        return found

    def _mapped(self, function: ca.Function, block: Block, x: ca.MX, *more: ca.MX) -> list[ca.MX]:
        """Evaluate a function at all copies of a block; a column of the results is that of one."""
        places = block.places.ravel().tolist()
        numbers = ca.MX(ca.DM(np.arange(float(block.copies))[None]))
        own = ca.reshape(x[places], block.places.shape[1], block.copies)
        found: list[ca.MX] = function.map(block.copies).call([own, numbers, *more])
        return found

    def _values(self, x: ca.MX) -> tuple[ca.MX, ca.MX]:
        f, rows = ca.MX(0), []
        for block in self.blocks:
            cost, own = self._mapped(block.values, block, x)
            f += ca.sum2(cost)
            rows.append(ca.vec(own))
        return f, ca.vertcat(*rows)

    @cached_property
    def _gradient(self) -> ca.Function:
        x, f, slope = ca.MX.sym("x", self.size), ca.MX(0), ca.MX(self.size, 1)
        for block in self.blocks:
            if not block.cost.is_constant():
                cost, own = self._mapped(block.gradient, block, x)
                f += ca.sum2(cost)
                slope += ca.mtimes(_collected(block.places.ravel(), self.size), ca.vec(own))
        inputs, names = [x, ca.MX.sym("p", 0)], (["x", "p"], ["f", "grad_f_x"])
        return ca.Function("nlp_grad_f", inputs, [f, ca.densify(slope)], *names)

    @cached_property
    def _jacobian(self) -> ca.Function:
        x, rows, values, places = ca.MX.sym("x", self.size), [], [], []
        for k, block in enumerate(self.blocks):
            function, row, col = block.jacobian
            own, entry = self._mapped(function, block, x)
            rows.append(ca.vec(own))
            values.append(ca.vec(entry))
            copies = self._firsts[k] + block.rows.numel() * np.arange(block.copies)
            places.append(((copies[:, None] + row).ravel(), block.places[:, col].ravel()))
        row, col = (np.concatenate(both) for both in zip(*places, strict=True))
        matrix = _matrix((self.equations, self.size), ca.vertcat(*values), row, col)
        inputs, names = [x, ca.MX.sym("p", 0)], (["x", "p"], ["g", "jac_g_x"])
        return ca.Function("nlp_jac_g", inputs, [ca.vertcat(*rows), matrix], *names)

    @cached_property
    def _hessian(self) -> ca.Function:
        x, weight = ca.MX.sym("x", self.size), ca.MX.sym("lam_f")
        lam, values, places = ca.MX.sym("lam_g", self.equations), [], []
        for k, block in enumerate(self.blocks):
            function, row, col = block.hessian
            first, last = int(self._firsts[k]), int(self._firsts[k + 1])
            own = ca.reshape(lam[first:last], block.rows.numel(), block.copies)
            (entry,) = self._mapped(function, block, x, ca.repmat(weight, 1, block.copies), own)
            values.append(ca.vec(entry))
            both = np.sort([block.places[:, row].ravel(), block.places[:, col].ravel()], axis=0)
            places.append((both[0], both[1]))
        row, col = (np.concatenate(both) for both in zip(*places, strict=True))
        matrix = _matrix((self.size, self.size), ca.vertcat(*values), row, col)
        inputs, names = [x, ca.MX.sym("p", 0), weight, lam], ["x", "p", "lam_f", "lam_g"]
        return ca.Function("nlp_hess_l", inputs, [matrix], names, ["triu_hess_gamma_x_x"])


@dataclass(frozen=True)
class Units:
    """Units of variables, constraints and the cost of a program, powers of two.

    They are ones where all sizes are near one, which IPOPT's tolerances suit.
    """

    x: Array
    g: Array
    f: float

    @classmethod
    def of(cls, program: Program, guess: Array, sizes: Array, alike: Sequence[Places]) -> Units:
        """Choose them: of a constraint the largest part that variables of known size have in it.

        A variable whose size is NaN has that which a constraint feels as much as the others, the
        least of those in a row of `alike`. Constraints of all copies of a block are alike.
        """
        _, matrix = program._jacobian(guess, [])
        row, col = (np.array(x, dtype=np.int64) for x in matrix.sparsity().get_triplet())
        entries = np.abs(np.array(matrix.nonzeros()))
        entries[~np.isfinite(entries)] = 0.0
        x, g = np.nan_to_num(sizes), np.zeros(program.equations)
        while True:
            parts, felt = np.zeros_like(g), np.zeros_like(x)
            np.maximum.at(parts, row, entries * x[col])
            for block in program.blocks:
                own = program.rows_of(block, parts)
                own[:] = own.max(axis=0, initial=0.0)
            g = np.where(g > 0, g, parts)
            is_known = g[row] > 0
            np.maximum.at(felt, col[is_known], entries[is_known] / g[row[is_known]])
            for places in alike:
                felt[places] = felt[places].max(initial=0.0)
            new = (x == 0) & (felt > 0)
            if not new.any():
                break
            x[new] = 1 / felt[new]
        x[x == 0], g[g == 0] = 1.0, 1.0
        x, g = _power_of_two(x), _power_of_two(g)
        # a cost may have no slope at the guess, as where controls are zero
        _, slope = program._gradient(guess + np.where(np.isnan(sizes), x, 0.0), [])
        rise = float(np.abs(np.array(slope).ravel() * x).max(initial=0.0))
        f = _power_of_two(np.array([rise or 1.0]))
        if np.abs(np.log2(np.concatenate([x, g, f]))).max(initial=0.0) < FAR:
            x, g, f = np.ones_like(x), np.ones_like(g), np.ones(1)
        return cls(x, g, float(f[0]))

    def derivatives(self, program: Program) -> dict[str, ca.Function]:
        """Return the functions that IPOPT is given, in these units."""
        x, p = ca.MX.sym("x", program.size), ca.MX.sym("p", 0)
        weight, lam = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", program.equations)
        own, of_g = ca.DM(self.x), ca.DM(self.g)
        f, slope = program._gradient(own * x, p)
        g, jacobian = program._jacobian(own * x, p)
        hessian = program._hessian(own * x, p, weight / self.f, lam / of_g)
        # IPOPT's arrays are filled by entries, and CasADi makes zeros of no entries of products
        gradient = [ca.densify(f / self.f), ca.densify(slope * own / self.f)]
        rows = [g / of_g, jacobian * _outer(jacobian, 1 / self.g, self.x)]
        curved = [hessian * _outer(hessian, self.x, self.x)]
        names, of = ["x", "p"], ca.Function
        return {
            "grad_f": of("nlp_grad_f", [x, p], gradient, names, ["f", "grad_f_x"]),
            "jac_g": of("nlp_jac_g", [x, p], rows, names, ["g", "jac_g_x"]),
            "hess_lag": of(
                "nlp_hess_l", [x, p, weight, lam], curved, [*names, "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        }  # fmt: skip

    def undone(self, found: dict[str, Array]) -> dict[str, Array]:
        """Return a solution in the units of the program."""
        scales: dict[str, Array] = {
            "x": self.x, "f": np.array(self.f), "g": self.g,
            "lam_g": self.f / self.g, "lam_x": self.f / self.x,
        }  # fmt: skip
        one = np.ones(1)
        return {name: value * scales.get(name, one) for name, value in found.items()}


def _power_of_two(x: Array) -> Array:
    found: Array = np.exp2(np.round(np.log2(x)))
    return found


def _outer(matrix: ca.MX, rows: Array, columns: Array) -> ca.DM:
    """Return products of units in the places of a matrix."""
    row, col = matrix.sparsity().get_triplet()
    return ca.DM(matrix.sparsity(), rows[row] * columns[col])


def _triplet(matrix: ca.SX) -> tuple[Places, Places]:
    row, col = (np.array(x, dtype=np.int64) for x in matrix.sparsity().get_triplet())
    return row, col


def _collected(places: Places, size: int) -> ca.DM:
    """Return the matrix that adds entries up in their places."""
    order = np.arange(places.size).tolist()
    pattern = ca.Sparsity.triplet(size, places.size, places.tolist(), order)
    return ca.DM(pattern, 1.0)


def _matrix(shape: tuple[int, int], values: ca.MX, row: Places, col: Places) -> ca.MX:
    """Return the sparse matrix with these entries, those of one place added up."""
    keys, own = np.unique(col * shape[0] + row, return_inverse=True)
    row, col = keys % shape[0], keys // shape[0]
    pattern = ca.Sparsity.triplet(*shape, row.tolist(), col.tolist())
    return ca.MX(pattern, ca.mtimes(_collected(own, keys.size), values))
