"""The step equations of Spark with controls, as blocks of a sparse nonlinear program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics import casadi as ca
from liouville._studies.optimal.arguments import Array, Bounds, Controls, Times
from liouville._studies.optimal.final import Final, is_own_velocity
from liouville._studies.optimal.layout import Layout
from liouville._studies.optimal.path import PathConstraints
from liouville._studies.optimal.program import Block, Places, Program
from liouville._systems import Mechanics
from liouville._systems.mechanics.form import total_derivative
from liouville._systems.tracing.linear import Matrix


class Equations:
    """Functions of a system at numbers of its parameters, with controls in the place of some.

    Parameters
    ----------
    system : Mechanics
        Without redundant constraints.
    controls : Controls
        Which parameters are controls.
    params : ndarray
        The elements of all parameters.
    costs : dict of str to SX
        Further expressions of the system's symbols.
    free : Controls
        Which parameters are unknowns of the program, the symbols `free`.
    """

    def __init__(
        self, system: Mechanics, controls: Controls, params: Array, costs: dict[str, ca.SX],
        free: Controls,
    ) -> None:  # fmt: skip
        s, model, linear = system.symbols, system.model, system._linear
        self.n, self.m, self.size = s.y.numel(), model.g.numel(), controls.size
        self.is_own_velocity, self.is_ideal = is_own_velocity(system), system.is_ideal
        p = model.p + _times(linear.mass, s.z)
        f = model.f - _times(linear.damping, s.z) - _times(linear.stiffness, s.y)
        w = total_derivative(model.g, s, model.v)
        self._params, self._places = params, controls.places
        self.free, self._free_places = ca.SX.sym("free", free.size), free.places
        point = s.all
        self._functions = {
            "stage": ca.Function("stage", point, [model.v, p, f]),
            "node": ca.Function("node", [s.t, s.y, model.lam, s.params.vector], [model.g, model.r]),
            "end": ca.Function("end", point, [p, w]),
            **{name: ca.Function(name, point, [x]) for name, x in costs.items()},
        }

    @property
    def params(self) -> ca.SX:
        """The elements of all parameters, of which some are unknowns."""
        found = ca.SX(ca.DM(self._params))
        found[self._free_places.tolist()] = self.free
        return found

    def at(self, name: str, *args: ca.SX, u: ca.SX | None = None) -> Any:
        """Return expressions of a function by its name, with controls u."""
        params = self.params
        if u is not None:
            params[self._places.tolist()] = u
        return self._functions[name](*args, params)

    def reaction(self, t: ca.SX, y: ca.SX, impulse: ca.SX, h: ca.SX) -> ca.SX:
        """Return h r(t, y, impulse / h)."""
        scale = ca.SX(1) if self.is_ideal else h  # ideal reactions are linear
        found: ca.SX = scale * self.at("node", t, y, impulse / scale)[1]
        return found


def _times(matrix: Matrix | None, x: ca.SX) -> ca.SX:
    if matrix is None:
        return ca.SX(x.numel(), 1)
    pattern = ca.Sparsity.triplet(matrix.n, matrix.n, matrix.row.tolist(), matrix.col.tolist())
    return ca.mtimes(ca.DM(pattern, ca.DM(matrix.values)), x)


#: A position has at least this part of the largest one's size, or of one.
LEAST = 1e-2


class Transcription:
    r"""The nonlinear program of an optimal control problem.

    With :math:`\Lambda_k = h \Psi_k` and controls :math:`u_i` at the Gauss stages the rows of a
    step are those of :class:`liouville.Spark`, :math:`f_i = f(T_i, Y_i, Z_i, u_i)`; its cost is
    :math:`h \sum_i b_i\, l(T_i, Y_i, Z_i, u_i)`.
    """

    def __init__(
        self,
        system: Mechanics,
        stages: int,
        equations: Equations,
        times: Times,
        final: Final,
        params: Array,
        bounds: Bounds,
        path: PathConstraints | None,
        free: Sequence[int] = (),
    ) -> None:
        self.system, self.stages, self.times, self.equations = system, stages, times, equations
        self.table = _core.spark_tableau(stages, "gauss")
        self._final, self._params, self._bounds = final, params, bounds
        self._path, self._free = path, free
        self._end = ca.SX.sym("end", times.limits is not None)
        y, z = ca.SX.sym("y", equations.n), ca.SX.sym("z", equations.n)
        found = final.block(
            system, self._time(times.steps), y, z, equations.params, params, times.end
        )
        self._conditions, self._at_end = found, (y, z)
        sizes = equations.n, equations.m, equations.size
        more = found[2].numel()
        free_params = equations.free.numel()
        self.layout = Layout.of(sizes, equations.is_own_velocity, stages, times, free_params, more)

    @cached_property
    def program(self) -> Program:
        """The program: blocks of all steps, of both ends, of bounded positions, and of the path."""
        more = [x for x in (self.first, self.inside, self.path) if x is not None]
        return Program(self.layout.size, [self.step, self.last, *more])

    @property
    def _shared(self) -> ca.SX:
        """The unknowns of all steps: the end and parameters, where they are free."""
        return ca.vertcat(self._end, self.equations.free)

    @property
    def _h(self) -> ca.SX:
        times = self.times
        if times.limits is None:
            return ca.SX(times.h)
        return (self._end - times.start) / times.steps

    def _time(self, steps: Any) -> ca.SX:
        """Return the time after so many steps."""
        found: ca.SX = self.times.start + self._h * steps
        return found

    @cached_property
    def step(self) -> Block:
        """The equations of a step."""
        unknowns = self._unknowns
        number, h = ca.SX.sym("number"), self._h
        cost, rows, labels = self._step(number, h, *unknowns)
        own = [ca.vec(x) for x in unknowns if x is not None]
        zero = np.zeros(rows.numel())
        variables, places = ca.vertcat(*own, self._shared), self._places_of_steps
        return Block("step", variables, number, cost, rows, (zero, zero), labels, places)

    @property
    def _places_of_steps(self) -> Places:
        """Where the unknowns of each step are, and those of all steps."""
        layout, steps = self.layout, self.times.steps
        parts = [layout.y[:-1], layout.z[:-1], layout.V]
        parts += [] if self.equations.is_own_velocity else [layout.Z]
        parts += [layout.impulses, layout.u, layout.y[1:], layout.z[1:]]
        parts += [np.tile(np.concatenate([layout.end, layout.params]), (steps, 1))]
        return np.concatenate([x.reshape(steps, -1) for x in parts], axis=1)

    @cached_property
    def inside(self) -> Block | None:
        """Positions at the stages of a step where they are bounded; at nodes they are unknowns."""
        low, high = self._bounds.states[:, 0]
        own = np.flatnonzero(np.isfinite(low) | np.isfinite(high)).tolist()
        if not own:
            return None
        layout, steps, names = self.layout, self.times.steps, self.system.coordinates
        y0, V = ca.SX.sym("y0", len(own)), ca.SX.sym("V", len(own), self.stages)
        a = ca.DM(self.table["a_v"])
        rows = ca.vec(ca.repmat(y0, 1, self.stages) + self._h * ca.mtimes(V, a.T))
        parts = [layout.y[:-1, own], layout.V[:, :, own], np.tile(layout.end, (steps, 1))]
        places = np.concatenate([x.reshape(steps, -1) for x in parts], axis=1)
        return Block(
            "inside", ca.vertcat(y0, ca.vec(V), self._end), ca.SX.sym("number"), ca.SX(0), rows,
            (np.tile(low[own], self.stages), np.tile(high[own], self.stages)),
            tuple(f"the bound of {self.system.states[0]} of '{names[k]}'" for k in own)
            * self.stages, places,
        )  # fmt: skip

    @cached_property
    def path(self) -> Block | None:
        """The constraints along the path: at the stages, and those of states alone at nodes too."""
        path = self._path
        if path is None or not path.labels:
            return None
        y0, _, V, Z, _, u, y1, z1 = unknowns = self._unknowns
        number, h, s = ca.SX.sym("number"), self._h, self.stages
        t0, c, at_nodes = self._time(number), self.table["c"].tolist(), path.of_states
        Y = ca.repmat(y0, 1, s) + h * ca.mtimes(V, ca.DM(self.table["a_v"]).T)
        own = V if Z is None else Z
        at = self.equations.at
        rows = [at("path", t0 + c[i] * h, Y[:, i], own[:, i], u=u[:, i]) for i in range(s)]
        end = at("path", t0 + h, y1, z1)
        rows += [end[k] for k in at_nodes]
        limits = [np.concatenate([np.tile(x, s), x[at_nodes]]) for x in (path.low, path.high)]
        labels = path.labels * s + tuple(path.labels[k] for k in at_nodes)
        variables = ca.vertcat(*(ca.vec(x) for x in unknowns if x is not None), self._shared)
        return Block(
            "path", variables, number, ca.SX(0), ca.vertcat(*rows), (limits[0], limits[1]), labels,
            self._places_of_steps,
        )  # fmt: skip

    @cached_property
    def first(self) -> Block | None:
        """Conditions of a free start: its constraints, if q is free, hidden ones, and the path."""
        equations, path, layout = self.equations, self._path, self.layout
        t, number = ca.SX(self.times.start), ca.SX.sym("number")
        y, z = ca.SX.sym("y", equations.n), ca.SX.sym("z", equations.n)
        rows, labels, limits = [ca.SX(0, 1)], list[str](), [np.empty((2, 0))]
        if self._free and equations.m:
            rows.append(equations.at("end", t, y, z)[1])
            labels += [f"hidden constraint '{x}' of the start" for x in self.system.holonomic]
        if 0 in self._free and equations.m:
            rows.append(equations.at("node", t, y, ca.SX(equations.m, 1))[0])
            labels += [f"constraint '{x}' of the start" for x in self.system.holonomic]
        limits.append(np.zeros((2, len(labels))))
        if path is not None and (self._free or equations.free.numel()) and path.of_states:
            rows.append(equations.at("path", t, y, z)[path.of_states])
            labels += [f"{path.labels[k]} of the start" for k in path.of_states]
            limits.append(np.array([path.low, path.high])[:, path.of_states])
        if not labels:
            return None
        low, high = np.concatenate(limits, axis=1)
        places = np.concatenate([layout.y[0], layout.z[0], layout.params])
        return Block(
            "first", ca.vertcat(y, z, equations.free), number, ca.SX(0), ca.vertcat(*rows),
            (low, high), tuple(labels), places[None],
        )  # fmt: skip

    def along(self, x: Array) -> Array:
        """Return the values of the constraints along the path at all stages, shape (N s, r)."""
        block = self.path
        if block is None or self._path is None:
            return np.empty((0, 0))
        values = block.values.map(block.copies)(x[block.places].T, np.arange(block.copies))[1]
        count = self.stages * len(self._path.labels)
        found: Array = np.array(values).T[:, :count].reshape(-1, len(self._path.labels))
        return found

    @property
    def _unknowns(self) -> list[Any]:
        """The symbols of a step: y0, z0, V, Z (None where it is V), impulses, u, y1, z1."""
        n, m, k, s = self.equations.n, self.equations.m, self.equations.size, self.stages

        def columns(name: str, rows: int, count: int) -> ca.SX:
            return ca.SX.sym(name, rows, count)

        own = self.equations.is_own_velocity
        return [
            ca.SX.sym("y0", n), ca.SX.sym("z0", n), columns("V", n, s),
            None if own else columns("Z", n, s), columns("impulses", m, s + 1),
            columns("u", k, s), ca.SX.sym("y1", n), ca.SX.sym("z1", n),
        ]  # fmt: skip

    def _step(
        self, number: ca.SX, h: ca.SX, y0: ca.SX, z0: ca.SX, V: ca.SX, Z: ca.SX | None,
        impulses: ca.SX, u: ca.SX, y1: ca.SX, z1: ca.SX,
    ) -> tuple[ca.SX, ca.SX, tuple[str, ...]]:  # fmt: skip
        """Return cost, rows and their names."""
        equations, table, s = self.equations, self.table, self.stages
        a, b, c, a_bar, a_hat, b_hat, c_hat = _coefficients(table)
        t0 = self._time(number)
        Y = ca.repmat(y0, 1, s) + h * ca.mtimes(V, a.T)
        nodes = ca.repmat(y0, 1, s + 1) + h * ca.mtimes(V, a_bar.T)
        own = V if Z is None else Z
        stages = [(t0 + c[i] * h, Y[:, i], own[:, i], u[:, i]) for i in range(s)]
        found = [equations.at("stage", t, y, z, u=x) for t, y, z, x in stages]
        v, p, f = (ca.horzcat(*parts) for parts in zip(*found, strict=True))
        at_nodes = [(t0 + c_hat[k] * h, nodes[:, k], impulses[:, k]) for k in range(s + 1)]
        r = ca.horzcat(*(equations.reaction(*node, h) for node in at_nodes))
        g = [equations.at("node", *node)[0] / h for node in at_nodes[1:]]
        p0, _ = equations.at("end", t0, y0, z0)
        p1, w1 = equations.at("end", t0 + h, y1, z1)
        rows = [] if Z is None else [ca.vec(V - v)]
        rows += [
            ca.vec(p - ca.repmat(p0, 1, s) - h * ca.mtimes(f, a.T) - ca.mtimes(r, a_hat.T)),
            *g,
            y1 - y0 - h * ca.mtimes(V, b),
            p1 - p0 - h * ca.mtimes(f, b) - ca.mtimes(r, b_hat),
            w1,
        ]
        cost = ca.SX(0)
        if "cost" in equations._functions:
            costs = [equations.at("cost", t, y, z, u=x) for t, y, z, x in stages]
            cost = h * ca.mtimes(ca.horzcat(*costs), b)
        return cost, ca.vertcat(*rows), self._labels(Z is not None)

    def _labels(self, has_z: bool) -> tuple[str, ...]:
        names, s = self.system.coordinates, self.stages
        of_velocity = [f"the velocity of '{x}'" for _ in range(s) for x in names] * has_z
        momenta = [f"the momentum of '{x}'" for x in names]
        holonomic = [f"constraint '{x}'" for x in self.system.holonomic]
        positions = [f"the position of '{x}'" for x in names]
        hidden = [f"hidden {x}" for x in holonomic]
        return (*of_velocity, *(momenta * s), *(holonomic * s), *positions, *momenta, *hidden)

    @cached_property
    def last(self) -> Block:
        """Conditions and cost at the end."""
        (y, z), (rows, labels, own, _) = self._at_end, self._conditions
        t, cost = self._time(self.times.steps), ca.SX(0)
        if "final_cost" in self.equations._functions:
            cost = self.equations.at("final_cost", t, y, z)
        layout = self.layout
        shared = [layout.end, layout.params, layout.more]
        places = np.concatenate([layout.y[-1], layout.z[-1], *shared])[None]
        zero = np.zeros(rows.numel())
        variables = ca.vertcat(y, z, self._shared, own)
        number = ca.SX.sym("number")
        return Block("last", variables, number, cost, rows, (zero, zero), labels, places)

    def bounds(self, start: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return least and largest values of all unknowns, of a start that is given its own."""
        layout, bounds, found = self.layout, self._bounds, []
        for k, sign in enumerate((-1.0, 1.0)):
            x = np.full(layout.size, sign * np.inf)
            x[layout.y], x[layout.z] = bounds.states[k]
            x[layout.Z] = bounds.states[k, 1]
            for place, own in enumerate((layout.y[0], layout.z[0])):
                if place not in self._free:
                    x[own] = start[place]
            x[layout.u] = bounds.controls[k]
            if self.times.limits is not None:
                x[layout.end] = self.times.limits[k]
            x[layout.params] = bounds.params[k]
            x[layout.more] = sign * self._conditions[3]
            found.append(x)
        return found[0], found[1]

    def guess(
        self, start: tuple[Array, Array], path: Callable[[Array], tuple[Array, Array, Array]]
    ) -> Array:
        """Return the unknowns of a guess, which gives y, z and u at parts of the time."""
        layout, steps = self.layout, self.times.steps
        x = np.zeros(layout.size)
        x[layout.y], x[layout.z], _ = path(np.arange(steps + 1) / steps)
        x[layout.y[0]], x[layout.z[0]] = start
        inside = ((np.arange(steps)[:, None] + self.table["c"]) / steps).ravel()
        y, z, u = path(inside)
        x[layout.Z] = z.reshape(layout.Z.shape)
        x[layout.u] = u.reshape(layout.u.shape)
        if not self.equations.is_own_velocity:
            stage = self.equations._functions["stage"]
            params = np.tile(self._params[:, None], inside.size)
            params[self.equations._places] = u.T
            t = self.times.start + inside * (self.times.end - self.times.start)
            v = stage.map(inside.size)(t[None], y.T, z.T, params)[0]
            x[layout.V] = np.array(ca.DM(v)).T.reshape(layout.V.shape)
        x[layout.end] = self.times.end
        x[layout.params] = self._params[self.equations._free_places]
        return x

    def sizes(self, guess: Array) -> tuple[Array, list[Places]]:
        """Return the sizes of the unknowns along a guess, NaN of those that follow from others.

        Of positions that is their largest value, of velocities theirs or the way over the time.
        Also the places of those that are alike: of one coordinate, control or constraint.
        """
        layout, found = self.layout, np.full(self.layout.size, np.nan)
        time = abs(self.times.end - self.times.start)

        def largest(places: Places) -> Array:
            own: Array = np.abs(guess[places]).reshape(-1, self.equations.n).max(axis=0)
            return own

        way = largest(layout.y)
        # a coordinate that a guess hardly moves says little of its size
        way = np.maximum(way, LEAST * min(way.max() or 1.0, 1.0))
        rate = np.maximum(largest(layout.V), way / time)
        found[layout.y], found[layout.V], found[layout.end] = way, rate, time
        if self.equations.is_own_velocity:
            found[layout.z] = rate
        found[layout.params] = np.where(
            guess[layout.params] == 0, 1.0, np.abs(guess[layout.params])
        )
        both = np.vstack([layout.z, layout.Z.reshape(-1, self.equations.n)])
        parts = [both, layout.u.reshape(-1, self.equations.size)]
        parts += [layout.impulses.reshape(-1, self.equations.m)] if self.equations.m else []
        return found, [places for part in parts for places in part.T]


def _coefficients(table: dict[str, NDArray[np.float64]]) -> list[Any]:
    """Return a, b, c, a_bar, a_hat, b_hat and c_hat, matrices of numbers for expressions."""
    names = ("a_v", "b", "c", "a_bar", "a_hat", "b_hat", "c_hat")
    return [ca.DM(table[name]) for name in names]
