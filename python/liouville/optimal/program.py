"""Sparse nonlinear programs that are sums of a few functions, each repeated along the time.

Every function depends on few variables. It is differentiated once, as a small program of its own,
and mapped over its copies; their derivatives are placed in the sparse matrices of the whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _casadi as ca
from liouville.errors import hinted
from liouville.systems._derivatives import entries

Array = NDArray[np.float64]
Places = NDArray[np.int64]


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
        self, guess: Array, bounds: tuple[Array, Array], options: Mapping[str, Any]
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Solve it by IPOPT; returns x, f, g and their multipliers, and IPOPT's own numbers."""
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", 0)
        f, g = self._values(x)
        problem: Any = {"x": x, "p": p, "f": f, "g": g}
        own: Any = {
            "grad_f": self._gradient,
            "jac_g": self._jacobian,
            "hess_lag": self._hessian,
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
        found = solver(x0=guess, p=[], lbx=bounds[0], ubx=bounds[1], lbg=low, ubg=high)
        arrays = {name: np.array(value).ravel() for name, value in found.items()}
        return arrays, solver.stats()

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
