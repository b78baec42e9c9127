"""The general form all mechanical systems are reduced to, as tapes for the core."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville.errors import describe, hinted
from liouville.systems import _trace
from liouville.tape import record

#: Rows, columns, and the row and column of each entry.
Pattern = tuple[int, int, list[int], list[int]]

#: A start may miss its constraints by this much of the size of what they are made of.
TOLERANCE = 1e-10

#: What roundoff may leave of coordinates that start at zero, in their own unit.
FLOOR = 1e-14


@dataclass(frozen=True)
class Symbols:
    """The symbols of a system: time, coordinates, their partner, multipliers and parameters."""

    t: ca.SX
    y: ca.SX
    z: ca.SX
    params: _trace.Parameters

    def inputs(self, **more: ca.SX) -> dict[str, ca.SX]:
        """Return the inputs of a tape, the parameters last."""
        return {"t": self.t, "y": self.y, **more, "params": self.params.vector}


@dataclass(frozen=True)
class Model:
    """The expressions v, p, f, r and g of the general form; r depends on `lam`."""

    v: ca.SX
    p: ca.SX
    f: ca.SX
    r: ca.SX
    g: ca.SX
    lam: ca.SX


class Mechanics:
    r"""A mechanical system in the general form, made by one of its three front doors.

    .. math::

        y' = v(t, y, z), \quad \frac{d}{dt} p(t, y, z) = f(t, y, z) + r(t, y, \lambda), \quad
        0 = g(t, y)

    with the hidden constraint :math:`w := g_t + g_y v`. All derivatives and their sparsity come
    from CasADi; parameters stay symbolic.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    constraints : tuple of str
        Names of the m constraints.
    states : tuple of str
        What its coordinates and their partner are called: ("q", "v"), ("q", "p") or ("y", "z").
    invariants : tuple of str
        Names of what is recorded along a run, "energy" among them where there is one.
    """

    def __init__(
        self,
        symbols: Symbols,
        model: Model,
        *,
        states: tuple[str, str],
        coordinates: tuple[str, ...],
        constraints: tuple[str, ...],
        invariants: Mapping[str, ca.SX],
        power: ca.SX | None = None,
    ) -> None:
        self.coordinates = coordinates
        self.constraints = constraints
        self.states = states
        self._symbols = symbols
        self._model = model
        self._invariants = dict(invariants)
        self._power = power
        self._tapes, self._patterns, self.problem = _compile(symbols, model)

    def __repr__(self) -> str:
        """Name the kind of system and its coordinates."""
        kind = type(self).__name__
        return f"{kind}({', '.join(self.coordinates)}; {len(self.constraints)} constraints)"

    @property
    def params(self) -> dict[str, float | np.ndarray]:
        """The parameters' default values."""
        defaults = self._symbols.params.defaults
        return {name: x.copy() if x.ndim else float(x) for name, x in defaults.items()}

    @property
    def invariants(self) -> tuple[str, ...]:
        """Names of the invariants."""
        return tuple(self._invariants)

    def values(self, params: Mapping[str, ArrayLike] | None) -> np.ndarray:
        """Return the parameter vector with changes; ValueError names an unknown one."""
        return self._symbols.params.values(params)

    def start(self, start: Mapping[str, Any], also: tuple[str, ...] = ()) -> tuple[np.ndarray, ...]:
        """Check start values and return them as arrays of shape (n,).

        Those named in `also` may be left out; a method starts them itself.

        Raises
        ------
        TypeError
            One of the two is missing or no array of numbers, or there is another.
        ValueError
            One has a wrong shape, an unknown coordinate, or is not finite.
        """
        wanted = " and ".join(f"{name}=" for name in self.states)
        for name in start:
            if name not in (*self.states, *also):
                raise TypeError(f"'{name}' is no start value of this system, which takes {wanted}")
        for name in self.states:
            if name not in start:
                raise TypeError(f"start value '{name}' is missing: this system takes {wanted}")
        given = (*self.states, *(name for name in also if start.get(name) is not None))
        return tuple(self._vector(name, start[name]) for name in given)

    def _vector(self, name: str, value: Any) -> np.ndarray:
        if isinstance(value, Mapping):
            if set(value) != set(self.coordinates):
                raise ValueError(f"{name} gives {list(value)}, wanted {list(self.coordinates)}")
            value = [value[coordinate] for coordinate in self.coordinates]
        array = _trace.numbers(value)
        if array is None:
            raise TypeError(f"{name} is an array of real numbers, not {value!r}")
        n = len(self.coordinates)
        if array.shape != (n,):
            raise ValueError(f"{name} has shape {array.shape}, wanted ({n},)")
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            raise ValueError(f"{name} of '{self.coordinates[bad[0]]}' is {array[bad[0]]}")
        return array

    def check(
        self,
        t: float,
        y: np.ndarray,
        z: np.ndarray,
        params: np.ndarray,
        hint: str = "system.consistent({}=..., {}=...) moves a start onto its constraints",
    ) -> None:
        """Refuse a start that violates the constraint or the hidden constraint."""
        m = len(self.constraints)
        if m == 0:
            return
        lam, n = np.zeros(m), len(y)
        g = self._at("node", params, t, y, lam)[:m]
        end = self._at("end", params, t, y, z)
        w, v = end[n : n + m], end[n + m :] if end.size > n + m else z
        _, _, rows, _ = self._patterns["g_y"]
        size = np.bincount(rows, np.abs(self._at("node_blocks", params, t, y, lam)[: len(rows)]), m)
        length, speed = np.abs(y).max(), np.abs(v).max()
        limits = [size * (TOLERANCE * x + FLOOR) for x in (length, speed + 1e-2 * length)]
        symbols = (f"g({self.states[0]})", f"g_t + g_{self.states[0]} v")
        for what, symbol, value, limit in zip(
            ("constraint", "hidden constraint"), symbols, (g, w), limits, strict=True
        ):
            if not np.isfinite(value).all():
                k = int(np.argmin(np.isfinite(value)))
                raise ValueError(
                    hinted(
                        f"the {what} '{self.constraints[k]}' is {value[k]} at the start, t = {t:g}",
                        "look for a division by zero, a root or a logarithm of the model there",
                    )
                )
            over = np.abs(value) - limit
            k = int(np.argmax(over))
            if not over[k] <= 0:
                raise ValueError(
                    hinted(
                        f"start violates the {what} '{self.constraints[k]}': |{symbol}| = "
                        f"{abs(value[k]):.1e} at t = {t:g}, wanted at most {limit[k]:.1e}",
                        hint.format(*self.states),
                    )
                )

    def consistent(
        self,
        t: float = 0.0,
        params: Mapping[str, ArrayLike] | None = None,
        hold: str | None = None,
        **start: Any,
    ) -> dict[str, np.ndarray]:
        r"""Move a start onto the constraints by the least change in the mass metric.

        Positions are moved by :math:`M^{-1} g_y^T \mu` until :math:`g = 0`, which from afar is the
        least change only nearly, then velocities (or momenta) by the same directions until
        :math:`g_t + g_y v = 0`.

        Parameters
        ----------
        t : float, default 0
            Time, for constraints that depend on it.
        params : mapping, optional
            Parameters that differ from their defaults.
        hold : str, optional
            What must not move: the name of the positions ("q" or "y"), which must satisfy g = 0
            already, or of their partner ("v", "p" or "z"), for which positions are sought that
            satisfy both constraints.
        **start : array_like
            Start values near the constraints, by the system's names, each of shape (n,).

        Returns
        -------
        dict of str to ndarray
            Start values for :func:`liouville.integrate`.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or no consistent start is found near the one given.
        """
        time = _trace.numbers(t)
        if time is None or time.shape != () or not np.isfinite(time):
            raise ValueError(f"t is a finite number, not {t!r}")
        t = float(time)
        y, z = self.start(start)
        values = self.values(params)
        first, second = self.states
        if hold not in (None, first, second):
            raise ValueError(f"hold is '{first}', '{second}' or None, not {hold!r}")
        if self.constraints:
            if hold is None:
                y = self._project("positions", t, y, z, values)
            elif hold == second:
                y = self._project("both", t, y, z, values)
            if hold != second:
                z = self._project("partner", t, z, y, values)
            self.check(t, y, z, values, f"without hold={hold!r} there may be a start nearby")
        return {first: y, second: z}

    def _project(
        self, what: str, t: float, x: np.ndarray, held: np.ndarray, params: np.ndarray
    ) -> np.ndarray:
        tapes, pattern, names = self._projections[what]
        found = _core.project(tapes, pattern, x, np.append(held, t), params)
        if isinstance(found, dict):
            if found["kind"] == "not finite":
                found["t"] = t
            sentence, _, _ = describe(found, self.coordinates, names)
            raise ValueError(
                hinted(
                    f"no consistent start is near the one given: {sentence}",
                    "start nearer to the constraints, or hold less",
                )
            )
        return found

    @cached_property
    def second_order(self) -> _core.SecondOrder:
        """What the methods for second order equations step.

        Raises
        ------
        TypeError
            The velocity is not z, or the momentum is not linear in it.
        """
        return _core.SecondOrder(
            self.problem, *_second_order(self._symbols, self._model, self._power)
        )

    @cached_property
    def _projections(self) -> dict[str, Any]:
        """Tapes (x, held and t, params) of c, c_x and the metric, for each kind of projection.

        With them come the pattern of c_x and the names of the rows of c.
        """
        s, model = self._symbols, self._model
        w = _total_derivative(model.g, s, model.v)
        p_z, v_z = ca.jacobian(model.p, s.z), ca.jacobian(model.v, s.z)
        compliance = ca.solve(v_z.T, p_z.T).T if _differ(model.v, s.z) else p_z
        hidden = tuple(f"hidden {name}" for name in self.constraints)
        w_y = ca.jacobian(w, s.y)
        moved = [k for k in range(w.numel()) if not w_y[k, :].is_zero()]
        rows = ca.vertcat(model.g, *(w[k] for k in moved))
        both = rows, (*self.constraints, *(hidden[k] for k in moved))
        cases = {
            "positions": (s.y, s.z, (model.g, self.constraints), compliance),
            "both": (s.y, s.z, both, compliance),
            "partner": (s.z, s.y, (w, hidden), ca.mtimes(v_z.T, p_z)),
        }
        projections = {}
        for what, (x, held, (c, names), metric) in cases.items():
            inputs = {"x": x, "held": ca.vertcat(held, s.t), "params": s.params.vector}
            c_x = ca.jacobian(c, x)
            tapes = (
                record(what, inputs, c),
                record(what, inputs, c_x, dense=False),
                record(what, inputs, metric.T),
            )
            projections[what] = (tapes, _pattern(c_x), names)
        return projections

    def reaction(
        self,
        t: np.ndarray,
        y: np.ndarray,
        lam: np.ndarray,
        params: Mapping[str, ArrayLike] | None = None,
    ) -> np.ndarray:
        """Return the generalised reaction forces r(t, y, lam), shape (k, n), at k points."""
        values = self._map("node", self.values(params), t, y, lam)
        return values[:, len(self.constraints) :]

    def _map(self, name: str, params: np.ndarray, *args: ArrayLike) -> np.ndarray:
        k = np.size(args[0])
        rows = [np.ascontiguousarray(np.reshape(x, (k, -1)), dtype=float) for x in args]
        return self._tapes[name].map(params, rows)

    def _at(self, name: str, params: np.ndarray, *args: ArrayLike) -> np.ndarray:
        values: np.ndarray = self._map(name, params, *args)[0]
        return values

    def observer(
        self, observe: Mapping[str, Callable[..., Any]] | None, states: bool
    ) -> tuple[_core.Tape, dict[str, int]]:
        """Record what a run keeps besides y, z and lam; returns the tape and each part's width."""
        s, model = self._symbols, self._model
        parts: dict[str, ca.SX] = {}
        if states:
            parts |= {"p": model.p} if self.states[1] != "p" else {}
            parts |= {"v": model.v} if self.states[1] != "v" else {}
        parts |= {"constraint": model.g, "hidden": _total_derivative(model.g, s, model.v)}
        parts |= {f"invariant {name}": x for name, x in self._invariants.items()}
        for name, function in _trace.mapping("observe", observe).items():
            args = (s.t, s.y, s.z, s.params)
            parts[f"observed {name}"] = _trace.column(f"observed '{name}'", function, args)
        tape = record("observer", s.inputs(z=s.z), *parts.values())
        return tape, {name: x.numel() for name, x in parts.items()}


def _differ(a: ca.SX, b: ca.SX) -> bool:
    return not ca.is_equal(a, b, 1)


def _total_derivative(x: ca.SX, s: Symbols, v: ca.SX) -> ca.SX:
    """x_t + x_y v."""
    return ca.jtimes(x, ca.vertcat(s.t, s.y), ca.vertcat(1, v))


def _pattern(matrix: ca.SX) -> Pattern:
    rows, cols = matrix.sparsity().get_triplet()
    return matrix.shape[0], matrix.shape[1], rows, cols


def _compile(
    s: Symbols, model: Model
) -> tuple[dict[str, _core.Tape], dict[str, Pattern], _core.Mechanical]:
    """Differentiate and record: the tapes and patterns of `problem::mechanical` in the core."""
    v, p, f, r, g, lam = model.v, model.p, model.f, model.r, model.g, model.lam
    own_velocity = _differ(v, s.z)
    w = _total_derivative(g, s, v)
    jac = {
        "p_z": ca.jacobian(p, s.z),
        "v_z": ca.jacobian(v, s.z),
        "p_y": ca.jacobian(p, s.y),
        "f_y": ca.jacobian(f, s.y),
        "f_z": ca.jacobian(f, s.z),
        "v_y": ca.jacobian(v, s.y),
        "g_y": ca.jacobian(g, s.y),
        "r_lam": ca.jacobian(r, lam),
        "r_y": ca.jacobian(r, s.y),
    }
    is_linear = not (
        ca.depends_on(ca.veccat(jac["p_z"], jac["v_z"]), s.z)
        or ca.depends_on(ca.vec(jac["r_lam"]), lam)
    )
    if not own_velocity:
        del jac["v_z"]
    velocity = [v] if own_velocity else []
    at_stage, at_node = s.inputs(z=s.z), s.inputs(lam=lam)

    def blocks(name: str, inputs: dict[str, ca.SX], *wanted: str) -> _core.Tape:
        return record(name, inputs, *(jac[key] for key in wanted if key in jac), dense=False)

    tapes = {
        "stage": record("stage", at_stage, p, f, *velocity),
        "stage_blocks": blocks("stage_blocks", at_stage, "p_z", "v_z"),
        "stage_jacobian": blocks("stage_jacobian", at_stage, "p_y", "f_y", "f_z", "v_y"),
        "node": record("node", at_node, g, r),
        "node_blocks": blocks("node_blocks", at_node, "g_y", "r_lam"),
        "node_jacobian": blocks("node_jacobian", at_node, "r_y"),
        "end": record("end", at_stage, p, w, *velocity),
        "acceleration": record(
            "acceleration", at_stage, f - _total_derivative(p, s, v), _total_derivative(w, s, v)
        ),
    }
    patterns = {name: _pattern(matrix) for name, matrix in jac.items()}
    problem = _core.Mechanical(s.y.numel(), g.numel(), is_linear, tapes, patterns)
    return tapes, patterns, problem


def _second_order(
    s: Symbols, model: Model, power: ca.SX | None
) -> tuple[dict[str, _core.Tape], dict[str, Pattern], bool]:
    """Record M(t, y) z' = F(t, y, z) + r and 0 = g, 0 = w, with u and a in the place of z'.

    Returns the tapes and patterns of `problem::second_order` in the core, and whether the power of
    forces without potential depends on the multipliers.
    """
    _check_second_order(s, model)
    n = s.y.numel()
    u, a = ca.SX.sym("u", n), ca.SX.sym("a", n)
    mass = ca.jacobian(model.p, s.z)
    residual = model.f - _total_derivative(model.p, s, s.z) - ca.mtimes(mass, u)
    reaction = ca.mtimes(mass, a) - model.r
    jac = {
        "mass": mass,
        "j_y": ca.jacobian(residual, s.y),
        "j_z": ca.jacobian(residual, s.z),
        "n_y": ca.jacobian(reaction, s.y),
    }
    w = _total_derivative(model.g, s, s.z)
    at_end, at_node = s.inputs(z=s.z, u=u), s.inputs(a=a, lam=model.lam)
    tapes = {
        "residual": record("residual", at_end, residual, model.g, w),
        "reaction": record("reaction", at_node, reaction),
        "jacobian": record(
            "jacobian", at_end, *(jac[name] for name in ("mass", "j_y", "j_z")), dense=False
        ),
        "reaction_jacobian": record("reaction_jacobian", at_node, jac["n_y"], dense=False),
    }
    if power is None or power.is_zero():
        power = ca.SX(0)
    else:
        tapes["power"] = record("power", s.inputs(z=s.z, lam=model.lam), power)
    patterns = {name: _pattern(matrix) for name, matrix in jac.items()}
    return tapes, patterns, ca.depends_on(power, model.lam)


def _check_second_order(s: Symbols, model: Model) -> None:
    """Refuse what is no second order equation for y with a mass M(t, y)."""
    if _differ(model.v, s.z):
        raise TypeError(
            hinted(
                "the velocity of this system is not its z itself, and the method steps velocities",
                "write the system as a Lagrangian, or take Spark",
            )
        )
    if ca.depends_on(ca.jacobian(model.p, s.z), s.z):
        raise TypeError(
            hinted(
                "the momentum of this system is not linear in its velocity, and the method wants "
                "a mass matrix M(t, q)",
                "take Spark",
            )
        )
