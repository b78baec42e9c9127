"""Derivatives of the functions of a drive, by parameters and by samples, and of a potential."""

from __future__ import annotations

from copy import copy
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville._systems.tape import record
from liouville._systems.tracing.expressions import Expressions, Symbols
from liouville._systems.tracing.table import STEPS
from liouville._systems.waves.foreign import Samples

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from liouville._systems.tracing.trace import Parameters
    from liouville._systems.waves.equation import Schrodinger
    from liouville._systems.waves.time_functions import TimeFunction

Array = NDArray[np.float64]

#: The most points of a grid at which changes of a potential's derivatives in time are found.
LOOKED = 2048


class _DriveTapes:
    """Programs of derivatives of a drive's functions, of all values of their parameters."""

    def __init__(self, functions: Sequence[TimeFunction], params: Parameters) -> None:
        self._functions, self._params = functions, params

    @cached_property
    def _column(self) -> tuple[ca.SX, ca.SX]:
        """The time and all functions of it."""
        t = ca.SX.sym("t")
        each = [ca.substitute(f.expression, f.t, t) for f in self._functions]
        return t, ca.vertcat(ca.SX(0, 1), *each)

    @cached_property
    def slope(self) -> _core.Tape:
        """The functions' derivatives by all parameters, those by one after those by another."""
        t, column = self._column
        slopes = ca.jacobian(column, self._params.vector)
        inputs = {"t": t, "params": self._params.vector}
        return record("derivatives of the drive", inputs, ca.densify(slopes))

    @cached_property
    def pull(self) -> _core.Tape:
        t, column = self._column
        w = ca.SX.sym("w", len(self._functions))
        pulled = ca.jtimes(column, self._params.vector, w, True)
        inputs = {"t": t, "w": w, "params": self._params.vector}
        return record("derivatives of the drive", inputs, ca.densify(pulled))


class DriveSensitivity:
    """The derivatives of the weights f_k(t) of a driven Hamiltonian.

    Attributes
    ----------
    params : slice by name
        Where each parameter is among all values, with its shape.
    samples : dict of str to int
        The drives that are samples, ``drive[k]``, and k.
    count : int
        The number of drives.
    """

    def __init__(self, system: Schrodinger) -> None:
        self._functions = system.functions
        self._params = system.parameters
        self._values = self._params.values(None)
        self.count = len(self._functions)
        self.params: dict[str, tuple[slice, tuple[int, ...]]] = {}
        first = 0
        for name, value in self._params.defaults.items():
            self.params[name] = (slice(first, first + value.size), value.shape)
            first += value.size
        given = enumerate(function for function, _ in system.drives)
        self.samples = {f"drive[{k}]": k for k, f in given if isinstance(f, Samples)}
        self._tables = {k: system.drives[k][0].table for k in self.samples.values()}
        self.tapes = _DriveTapes(self._functions, self._params)
        self._potential, self._recorded = system._potential, dict[str, Any]()

    def with_params(self, params: Parameters) -> DriveSensitivity:
        """Return the same with other values of the parameters."""
        other = copy(self)
        other._values = params.values(None)
        return other

    @property
    def expressions(self) -> Expressions:
        """The functions, but for splines of samples, and the potential of a grid."""
        potential = self._potential
        s = Symbols(self._params, {} if potential is None else potential.sizes)
        functions = [f for f in self._functions if f.what not in self.samples]
        columns = {f.what: f(s.t, s.params.namespace) for f in functions}
        if potential is not None:
            columns[potential.what] = potential(s.t, s.x, s.params.namespace)
        return Expressions(s, columns)

    def depends_on(self, name: str) -> bool:
        """Whether a function depends on a parameter."""
        return any(function.depends_on(name) for function in self._functions)

    def slopes(self, t: Array) -> Array:
        """Return the functions' derivatives by all parameters at times, shape (k, P, count)."""
        flat = self.tapes.slope.map(self._values, [t[:, None]])
        return np.asarray(flat).reshape(t.size, -1, self.count)

    def pulled(self, t: Array, cotangents: Array) -> Array:
        """Return cotangents of all parameters from those of the functions, shape (k, count)."""
        args = [t[:, None], np.ascontiguousarray(cotangents)]
        found: Array = self.tapes.pull.map(self._values, args).sum(axis=0)
        return found

    def times(self, name: str) -> Array:
        """Return the times of the samples of a drive."""
        return np.asarray(self._tables[self.samples[name]].x)

    def number(self, name: str) -> int:
        """Return the number of the samples of a drive."""
        return int(self._tables[self.samples[name]].y.size)

    def degree(self, name: str) -> int:
        """Return the degree in time between two samples of a drive."""
        return 0 if self._tables[self.samples[name]].ends == STEPS else 3

    def of_samples(self, name: str, t: Array, samples: Array) -> Array:
        """Return a drive at times, shape (..., k), by other samples, shape (..., samples)."""
        if self.degree(name) == 0:
            found: Array = samples[..., self._slots(name, t)]
        else:
            found = samples @ self.basis(name, t).T
        return found

    def to_samples(self, name: str, t: Array, cotangents: Array) -> Array:
        """Return cotangents of the samples of a drive from those of its values at times."""
        if self.degree(name) == 0:
            count = self.number(name)
            found: Array = np.bincount(self._slots(name, t), cotangents, count).astype(float)
        else:
            found = cotangents @ self.basis(name, t)
        return found

    def _slots(self, name: str, t: Array) -> NDArray[np.intp]:
        """Return the place of the sample that holds at each time."""
        table = self._tables[self.samples[name]]
        return np.asarray(np.searchsorted(table.x[1:-1], t, "right"))

    def basis(self, name: str, t: Array) -> Array:
        """Return the weight of each sample in the spline of a drive, shape (k, samples)."""
        table = self._tables[self.samples[name]]
        spline = _splines(table.x.tobytes(), table.ends)
        inside = np.clip(t, table.x[0], table.x[-1])
        found: Array = spline(inside)
        beyond = np.flatnonzero(t != inside)
        if beyond.size:
            found[beyond] += (t - inside)[beyond, None] * spline(inside[beyond], 1)
        return found


class _PotentialTapes:
    """Programs of a potential times a number, of all values of its parameters."""

    def __init__(self, function: TimeFunction, params: Parameters, scale: float) -> None:
        self._function, self._params, self._scale = function, params, scale

    @property
    def value(self) -> _core.Tape:
        return self._function.tape(self._scale)

    @cached_property
    def push(self) -> _core.Tape:
        """The derivative in a direction, which comes behind the parameters."""
        inputs, params = self._function.inputs, self._params.vector
        both = ca.SX.sym("params", 2 * params.numel())
        own, direction = ca.vertsplit(both, params.numel())
        value = ca.substitute(self._scale * self._function.expression, params, own)
        pushed = ca.jtimes(value, own, direction)
        return record("derivatives of the potential", {**inputs, "params": both}, pushed)

    @cached_property
    def slope(self) -> _core.Tape:
        """The derivatives by all parameters."""
        inputs, params = self._function.inputs, self._params.vector
        slopes = ca.jacobian(self._scale * self._function.expression, params)
        return record("derivatives of the potential", inputs, ca.densify(slopes.T))


class PotentialSensitivity:
    r"""The potential :math:`V(t, x) / \hbar` of a grid, and its derivatives by parameters.

    Values are those at all rows of H: at all points, and once more where H acts on real and
    imaginary parts.
    """

    def __init__(self, system: Schrodinger, function: TimeFunction) -> None:
        assert system.grid is not None, "a potential is on a grid"
        self._function, self._params = function, system.parameters
        self._values = self._params.values(None)
        self._points = np.ascontiguousarray(system.grid.points)
        self._repeats, scale = 1 + system.frame.is_doubled, 1 / system.hbar
        self.tapes = _PotentialTapes(function, self._params, scale)

    def with_params(self, params: Parameters) -> PotentialSensitivity:
        """Return the same with other values of the parameters."""
        other = copy(self)
        other._values = params.values(None)
        return other

    def depends_on(self, name: str) -> bool:
        """Whether it depends on a parameter."""
        return self._function.depends_on(name)

    @cached_property
    def looked(self) -> Array:
        """Some of the points, in no order that axes have."""
        count = len(self._points)
        some = np.random.default_rng(0).permutation(count)[:LOOKED]
        return self._points[np.sort(some)]

    @staticmethod
    def _at(t: Array, points: Array) -> list[Array]:
        return [np.repeat(t, len(points))[:, None], np.tile(points, (t.size, 1))]

    def _of_rows(self, t: Array, flat: Array) -> Array:
        found: Array = np.tile(flat.reshape(t.size, -1), (1, self._repeats))
        return found

    def values(self, t: Array, params: Array) -> Array:
        """Return it at times, shape (k, rows), with these values of all parameters."""
        return self._of_rows(t, self.tapes.value.map(params, self._at(t, self._points)))

    def pushed(self, t: Array, direction: Array) -> Array:
        """Return its derivatives at times, shape (k, rows), in a direction of all parameters."""
        both = np.concatenate([self._values, direction])
        found = self.tapes.push.map(both, self._at(t, self._points))
        return self._of_rows(t, self._finite(t, found))

    def slopes(self, t: Array, places: list[int]) -> Array:
        """Return its derivatives by these parameters at times, and at points that are looked at."""
        found = self.tapes.slope.map(self._values, self._at(t, self.looked))[:, places]
        return np.asarray(self._finite(t, found)).reshape(t.size, -1)

    def pulled(self, t: Array, cotangents: Array) -> Array:
        """Return cotangents of all parameters from those at times, shape (k, rows)."""
        each = cotangents.reshape(t.size, self._repeats, -1).sum(axis=1)
        return np.asarray(sum(self._pulled(t, each)))

    def _pulled(self, t: Array, cotangents: Array) -> Iterator[Array]:
        # one time after another: of each point there are as many derivatives as parameters
        for k, own in enumerate(cotangents):
            at = t[k : k + 1]
            slopes = self.tapes.slope.map(self._values, self._at(at, self._points))
            yield own @ self._finite(at, slopes)

    def _finite(self, t: Array, found: Array) -> Array:
        bad = np.argwhere(~np.isfinite(found))
        if not bad.size:
            return found
        at = t[bad[0][0] * t.size // len(found)]
        sentence = f"derivatives of the potential by its parameters are not finite at t = {at:g}"
        raise ValueError(hinted(sentence, "look for a root or a division by zero there"))


@lru_cache(maxsize=1)
def _splines(x: bytes, ends: str) -> Any:
    """Return the splines through ones and zeros, which all pulses with samples at x share."""
    at = np.frombuffer(x)
    return scipy("interpolate", "a table").CubicSpline(at, np.eye(at.size), bc_type=ends)
