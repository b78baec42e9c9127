"""Semi-explicit differential-algebraic systems of index 2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.arguments import amount
from liouville._basics.errors import hinted, shown
from liouville._basics.faults import Description
from liouville._systems.mechanics.form import record_blocks, total_derivative
from liouville._systems.mechanics.traced import (
    Function,
    TracedSystem,
    check_moved,
    traced_invariants,
)
from liouville._systems.mechanics.violations import (
    FLOOR,
    ROUNDINGS,
    TOLERANCE,
    check_residual,
    finite_time,
)
from liouville._systems.program import elements
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols
from liouville._systems.tracing.layout import Layout, of_semi_explicit
from liouville._systems.tracing.linear import Block
from liouville._systems.tracing.sparse import entries, jacobian


class SemiExplicit(TracedSystem):
    r"""A semi-explicit differential-algebraic system of index 2.

    .. math::

        y' = f(t, y, z), \quad 0 = k(t, y), \qquad k_y f_z \text{ invertible}

    with n coordinates y and l algebraic unknowns z, as many as constraints. They follow from the
    hidden constraint :math:`0 = w := k_t + k_y f(t, y, z)`. All derivatives and their sparsity come
    from CasADi; parameters stay symbolic. :class:`Spark` and its compositions integrate it.

    Parameters
    ----------
    field : callable
        ``field(t, y, z, params)``: the n components of f, or a dict of those that are not zero by
        coordinate names.
    constraint : callable
        ``constraint(t, y, params)``: a scalar, a sequence of l, or a dict that names them.
    y : sequence of str, or int
        Names of the n coordinates, or their number.
    z : sequence of str, or int
        Names of the l algebraic unknowns, or their number.
    params : mapping of str to float or 1-D array_like, optional
        Parameters by name, with default values; the functions see ``params.name``.
    invariants : mapping of str to callable, optional
        Quantities ``f(t, y, z, params)`` to record.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    unknowns : tuple of str
        Names of the l algebraic unknowns.
    constraints : tuple of str
        Names of the l constraints.
    states : tuple of str
        ``("y", "z")``.
    invariants : tuple of str
        Names of what is recorded along a run.

    Raises
    ------
    TypeError, ValueError
        A function returns the wrong number of values, or uses an operation without a place on a
        tape; there are not as many constraints as unknowns, more of them than coordinates, or one
        whose rate of change no unknown enters.

    References
    ----------
    :cite:t:`jay2006`.

    Examples
    --------
    A pendulum whose velocities are constrained too; the second unknown is zero along the motion.

    >>> import casadi as ca
    >>> import liouville as lv
    >>> pendulum = lv.SemiExplicit(
    ...     field=lambda t, y, z, params: [
    ...         y[2] - y[0] * z[1],
    ...         y[3] - y[1] * z[1],
    ...         -y[0] * z[0],
    ...         -y[1] * z[0] - params.g,
    ...     ],
    ...     constraint=lambda t, y, params: {
    ...         "rod": (y[0] ** 2 + y[1] ** 2 - 1) / 2,
    ...         "speed": y[0] * y[2] + y[1] * y[3],
    ...     },
    ...     y=("x", "y", "u", "v"),
    ...     z=("tension", "shift"),
    ...     params={"g": 9.81},
    ... )
    >>> pendulum
    SemiExplicit(x, y, u, v; tension, shift)
    >>> solution = lv.integrate(pendulum, lv.Spark(3), t=(0, 1), h=0.01, y=[1, 0, 0, 0])
    >>> float(abs(solution.residuals["constraint"]).max()) < 1e-14
    True
    """

    states = ("y", "z")
    problem: _core.SemiExplicit

    def __init__(
        self,
        *,
        field: Function,
        constraint: Function,
        y: Sequence[str] | int,
        z: Sequence[str] | int,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Function] | None = None,
    ) -> None:
        self.coordinates, self.unknowns = _trace.names(y, "y"), _trace.names(z, "z")
        sizes = {"y": len(self.coordinates), "z": len(self.unknowns)}
        s = Symbols(_trace.Parameters(params), sizes)
        f = _trace.placed("field", field, s.args, self.coordinates)
        self.constraints, k = _trace.named(
            "constraint", constraint, {"t": s.t, "y": s.y, "params": s.params}
        )
        w = total_derivative(k, s, f)
        self._check_shape((k, s.y), jacobian(w, s.z))
        columns = {"field": f, "constraint": k, "hidden": w}
        self._keep(Expressions(s, columns), traced_invariants(invariants, s.args))
        self._recorded: dict[str, Any] = {}
        self.problem = self._compiled()

    def __repr__(self) -> str:
        """Name the coordinates and the unknowns."""
        return f"SemiExplicit({shown(self.coordinates)}; {shown(self.unknowns)})"

    def _check_shape(self, constraints: tuple[ca.SX, ca.SX], w_z: ca.SX) -> None:
        """Refuse what cannot be of index 2, by what depends on what."""
        n, count = len(self.coordinates), len(self.unknowns)
        if len(self.constraints) != count:
            raise ValueError(
                hinted(
                    f"constraints must be as many as the {count} unknowns z, not "
                    f"{len(self.constraints)}",
                    "each unknown is determined by the rate of change of a constraint",
                )
            )
        if count > n:
            raise ValueError(
                f"{amount(count, 'constraint')} on {amount(n, 'coordinate')} leave nothing to move"
            )
        check_moved(self.constraints, *constraints)
        of_z = ca.sparsify(w_z).sparsity()
        rows, columns = (set(x) for x in of_z.get_triplet())
        for k, name in enumerate(self.constraints):
            if k not in rows:
                raise ValueError(
                    hinted(
                        f"no unknown enters the rate of change of constraint '{name}': "
                        "the index is higher than 2",
                        "require its derivative to vanish instead, or as well with an unknown more",
                    )
                )
        for k, name in enumerate(self.unknowns):
            if k not in columns:
                raise ValueError(
                    hinted(
                        f"unknown '{name}' enters the rate of change of no constraint",
                        "k_y f_z is to be invertible; leave out what has no effect",
                    )
                )

    def _compiled(self) -> _core.SemiExplicit:
        """Differentiate and record."""
        s, columns = self.symbols, self.expressions.columns
        f, k, w = columns["field"], columns["constraint"], columns["hidden"]
        point, place = s.inputs(z=s.z), s.inputs()
        jac = {
            "f_y": Block(jacobian(f, s.y)),
            "f_z": Block(jacobian(f, s.z)),
            "k_y": Block(jacobian(k, s.y)),
            "w_z": Block(jacobian(w, s.z)),
        }
        tapes = {
            "field": record("field", point, f),
            "field_jacobian": record_blocks("field", point, [jac["f_y"], jac["f_z"]]),
            "constraint": record("constraint", place, k),
            "constraint_jacobian": record_blocks("constraint", place, [jac["k_y"]]),
            "hidden": record("hidden constraint", point, w, f),
            "hidden_jacobian": record_blocks("hidden", point, [jac["w_z"], jac["f_z"]]),
            "rates": record("rates", point, *(total_derivative(x, s, f) for x in (w, f))),
        }
        self.tapes = tapes
        is_linear = not ca.depends_on(entries(jacobian(f, s.z)), s.z)
        patterns = {name: block.pattern for name, block in jac.items()}
        self.patterns = patterns
        return _core.SemiExplicit(
            len(self.coordinates), len(self.unknowns), is_linear, tapes, patterns
        )

    def start(self, start: Mapping[str, Any], also: tuple[str, ...] = ()) -> tuple[np.ndarray, ...]:
        """Check start values: y, and a guess of z, zeros by default.

        No method of such systems starts others itself, which `also` would name.

        Raises
        ------
        TypeError
            y is missing or no array of numbers, or there is another start value.
        ValueError
            One has a wrong shape, an unknown name, or is not finite.
        """
        for name in start:
            if name not in (*self.states, *also):
                raise TypeError(
                    f"'{name}' is no start value of this system, which takes y= and, as a guess, z="
                )
        if "y" not in start:
            raise TypeError("start value 'y' is missing: this system takes y= and, as a guess, z=")
        z = start.get("z")
        guess = np.zeros(len(self.unknowns)) if z is None else z
        return (
            _trace.vector("y", start["y"], self.coordinates),
            _trace.vector("z", guess, self.unknowns),
        )

    def check(
        self,
        t: float,
        y: np.ndarray,
        z: np.ndarray,
        params: np.ndarray,
        hint: str = "system.consistent(y=...) moves a start onto its constraints",
        *,
        hidden: bool = True,
    ) -> None:
        """Refuse a start that violates a constraint; the hidden one is what z is solved from."""
        del z, hidden
        args = [np.array([[t]]), y[None, :]]
        k = self.tapes["constraint"].map(params, args)[0]
        slope = self.tapes["constraint_jacobian"].map(params, args)[0]
        size = np.bincount(self.patterns["k_y"][2], np.abs(slope), len(k))
        largest = np.abs(y).max()
        limit = size * (FLOOR if largest <= FLOOR else TOLERANCE * largest)
        if (np.abs(k) > limit).any():
            tape = self.tapes["constraint"]
            limit = limit + ROUNDINGS * tape.roundings(params, [np.array([t]), y])
        check_residual("constraint", "k(y)", self.constraints, k, limit, t, hint)

    def consistent(
        self, t: float = 0.0, params: Mapping[str, ArrayLike] | None = None, **start: Any
    ) -> dict[str, Any]:
        """Move a start onto the constraints, and solve for the unknowns there.

        Coordinates are moved by the transposed gradients of the constraints until these vanish,
        which from afar is the least change only nearly.

        Parameters
        ----------
        t : float, default 0
            Time, for constraints that depend on it.
        params : mapping, optional
            Parameters that differ from their defaults.
        **start : array_like
            ``y`` near the constraints, shape (n,); ``z``, shape (l,), a guess where f is nonlinear
            in it, zeros by default. As for :func:`liouville.ensemble` they, and the parameters, may
            have a row for each of P members.

        Returns
        -------
        dict of str to ndarray
            ``y`` and ``z``, start values for :func:`liouville.integrate`, or of shape (P, n) and
            (P, l) for ``ensemble``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or no consistent start is found near the one given.
        """
        # imported here, as it checks systems of this class
        from liouville._systems import members

        many = members.consistent(self, start, params, t=t)
        if many is not None:
            return many
        t = finite_time(t)
        y, z = self.start(start)
        values = self.values(params)
        moved = _core.project(*self._projection, y, np.array([t]), values)
        if isinstance(moved, dict):
            raise self._none_near(moved, t)
        self.check(t, moved, z, values, "start nearer to the constraints")
        found = self.problem.unknowns(t, moved, z, values)
        if isinstance(found, dict):
            raise self._none_near(found, t)
        return {"y": moved, "z": found}

    def _none_near(self, error: dict[str, Any], t: float) -> ValueError:
        if error["kind"] == "not finite":
            error["t"] = t
        sentence, _, _ = self.describe(error)
        return ValueError(
            hinted(
                f"no consistent start is near the one given: {sentence}",
                "start nearer to the constraints, or give a guess z=",
            )
        )

    def describe(self, error: dict[str, Any]) -> Description:
        """Describe an error of the core in the user's names: sentence, hint and quantity."""
        if error["kind"] == "singular hidden":
            name = self.unknowns[error["index"]]
            return (
                f"the constraints do not determine unknown '{name}': k_y f_z is singular",
                "look for a constraint that repeats another, for an unknown that enters f twice, "
                "or for a position where a gradient vanishes",
                name,
            )
        if error["kind"] == "singular":
            return (
                "the equations of the stages are singular",
                "try a smaller h, and keep away from where k_y f_z is singular",
                "stages",
            )
        return super().describe(error)

    @cached_property
    def _projection(self) -> tuple[Any, Any]:
        """Tapes (y, t, params) of k, k_y and the metric, and the patterns of the last two."""
        s, k = self.symbols, self.expressions.columns["constraint"]
        inputs = {"y": s.y, "t": s.t, "params": s.params.vector}
        slope, weight = Block(jacobian(k, s.y)), Block(ca.SX.eye(len(self.coordinates)))
        tapes = (
            record("constraint", inputs, k),
            record_blocks("constraint", inputs, [slope]),
            record_blocks("metric", inputs, [weight]),
        )
        return tapes, (slope.pattern, weight.pattern)

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """The names of the entries of all states that a run keeps, by the name of the state."""
        return {"y": self.coordinates, "z": self.unknowns}

    @property
    def _replaceable(self) -> dict[str, ca.SX]:
        return {"y": self.symbols.y}  # z follows

    @property
    def layout(self) -> Layout:
        return of_semi_explicit(self)

    @property
    def _vectors(self) -> dict[str, list[str]]:
        sizes = {"y": len(self.coordinates), "z": len(self.unknowns)}
        return {"t": ["t"], **{name: elements(name, size) for name, size in sizes.items()}}

    @property
    def _velocity(self) -> ca.SX:
        return self.expressions.columns["field"]

    def _parts(self, states: bool) -> dict[str, ca.SX]:
        del states  # y and z are no expressions
        return {name: self.expressions.columns[name] for name in ("constraint", "hidden")}
