"""Divergence-free vector fields by their potential, as a function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.fields.observer import Observer
from liouville._systems.fields.plane_field import PlaneField, Planes, planes_of
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols

#: Newton's corrections of a flow, about; the derivatives are evaluated once more.
CORRECTIONS = 3


@dataclass(frozen=True, eq=False)
class Recorded:
    """A plane as tapes of its coordinates, frozen ones first, and parameters.

    Attributes
    ----------
    variables : tuple of int
        The frozen variables, then the two that move, v and w.
    tapes : tuple of Tape
        The potential F; F_v, F_w and F_vw; all derivatives that those of a flow need.
    is_separable : bool
        Whether F_vw is zero.
    operations : int
        How many there are in F_v, F_w and F_vw.
    """

    variables: tuple[int, ...]
    tapes: tuple[_core.Tape, _core.Tape, _core.Tape]
    is_separable: bool
    operations: int


class PotentialField(PlaneField):
    r"""A divergence-free vector field by its potential, in two or three dimensions.

    .. math::

        x' = v(t, x) = \operatorname{curl} A(t, x), \qquad
        \text{in the plane}\quad v = (\partial \psi / \partial y,\ -\partial \psi / \partial x)

    The potential is any smooth function. Its flow is made of those of planes, two coordinates at
    a time, each a Hamiltonian one by a symplectic map: volume is kept to roundoff, for any step.

    Parameters
    ----------
    potential : callable
        ``potential(t, x, params)``: the three components of A, or a dict of those that are not zero
        by coordinate names; in the plane the stream function :math:`\psi`. It is called once, with
        CasADi's symbols.
    x : sequence of str, or int
        Names of the two or three coordinates, or their number.
    params : mapping of str to float or 1-D array_like, optional
        Parameters by name, with default values; the function sees ``params.name``.
    invariants : mapping of str to callable, optional
        Quantities to record: functions ``f(t, x, params)``.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the coordinates.
    states : tuple of str
        What a start and a solution call the state: ("x",).
    is_driven : bool
        Whether the field depends on time.

    Raises
    ------
    TypeError
        An argument is of the wrong kind.
    ValueError
        There are not two or three coordinates, the potential has another number of values, or
        nothing moves.

    See Also
    --------
    PolynomialField : explicit maps for polynomials, sines and cosines.
    GriddedField : for fields that are known by samples.

    Notes
    -----
    The scalar equation of a plane is solved by Newton's method to roundoff. It has one solution
    while :math:`|\alpha h\, \partial^2 A_k / \partial x_i \partial x_j| < 1`, with the largest
    stage :math:`\alpha` of the composition. The mixed derivative is zero where others are not, so
    :math:`(F_{vw}^2 + |F_{vv} F_{ww}|)^{1/2}` is held to the bound of 0.9, with the component
    :math:`F = A_k` of the plane v, w. A step that is too long at the start, or where the velocity
    there leads, is refused; ``solution.message`` says where it is so at a record, and a run ends
    where an equation is not solved.

    References
    ----------
    :cite:t:`feng1995`, :cite:t:`mclachlan2008`; see :doc:`/theory/gridded`.

    Examples
    --------
    >>> import casadi as ca
    >>> import liouville as lv
    >>> def gyre(t, x, params):
    ...     return ca.sin(x[0] + params.a * ca.cos(t)) * ca.sin(x[1]) / (1 + x[1] ** 2)
    >>> field = lv.PotentialField(gyre, x=("x", "y"), params={"a": 0.1})
    >>> field
    PotentialField(x, y; 1 plane, driven)
    >>> run = lv.integrate(field, lv.VolumeSplitting(), t=(0, 5), h=0.1, x=[0.3, 0.2])
    """

    kind, counted = "potential", "operations"

    def __init__(
        self,
        potential: Callable[..., Any],
        *,
        x: Sequence[str] | int,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Any] | None = None,
    ) -> None:
        names = _trace.names(x, "x")
        n = len(names)
        if n not in (2, 3):
            sentence = f"a potential must be that of two or three coordinates, not of {n}"
            hint = "PolynomialField takes any number where the field is a polynomial, or has waves"
            raise ValueError(hinted(sentence, hint))
        symbols = Symbols(_trace.Parameters(params), {"x": n})
        if n == 2:
            column = _trace.scalar("potential", potential, symbols.args)
        else:
            column = _trace.placed("potential", potential, symbols.args, names)
        self.coordinates = names
        self.is_driven = bool(ca.depends_on(column, symbols.t))
        self.symbols, self._observer = symbols, Observer(symbols, invariants)
        self._potential, self._recorded = Expressions(symbols, {"potential": column}), {}
        self._values = self.values(None)
        found = (_recorded(column, number, symbols) for number in range(column.numel()))
        self._traced = [each for each in found if each is not None]
        self._steep = _steepness(column, symbols)
        self._made: Planes | None = None

    def _make(self) -> Planes:
        """Hand the planes to the core, with the numbers of parameters."""
        return [
            (
                _core.Plane.traced(
                    len(each.variables) - 2, each.tapes, self._values, each.is_separable
                ),
                each.variables,
            )
            for each in self._traced
        ]

    def _state(self) -> dict[str, Any]:
        """Return the attributes to pickle: the planes are made again of their tapes."""
        return dict(self.__dict__) | {"_made": None}

    @property
    def expressions(self) -> Expressions:
        """The velocity, as expressions."""
        symbols, column = self._potential.symbols, self._potential.columns["potential"]
        variables = _variables(symbols)
        velocity = [ca.SX(0) for _ in self.coordinates]
        for number, (_, (v, w)) in enumerate(planes_of(len(velocity))):
            velocity[v] += ca.jacobian(column[number], variables[w])
            velocity[w] -= ca.jacobian(column[number], variables[v])
        return Expressions(symbols, {"field": ca.vertcat(*velocity)})

    def __repr__(self) -> str:
        """Name the coordinates, and say how many planes there are."""
        count, time = len(self._traced), ", driven" if self.is_driven else ""
        words = f"{count} plane{'' if count == 1 else 's'}{time}"
        return f"{type(self).__name__}({', '.join(self.coordinates)}; {words})"

    @property
    def degree(self) -> None:
        """The highest order that there is: there is none."""

    @property
    def times(self) -> None:
        """The first and the last time: the field has all."""

    @property
    def size(self) -> int:
        """How many operations the derivatives of the potential take."""
        return sum(each.operations for each in self._traced)

    def operations(self, number: int) -> int:
        """Return about how many operations a flow of a plane takes."""
        each = self._traced[number]
        return (2 if each.is_separable else CORRECTIONS + 1) * each.operations

    def said(self) -> list[str]:
        """Say what there is to know of the field, for plans."""
        explicit = sum(each.is_separable for each in self._traced)
        return [f"{explicit} of the flows need no iteration"] if explicit else []

    def steepness(self, rows: np.ndarray, h: float = 0.0) -> float:
        """Return the largest rate of the planes at the state where it is smallest.

        With a step h the rate of a state is the largest also half of the step and a step further,
        by the velocity of the state.
        """
        found = self.steepest_at(rows)
        n = len(self.coordinates)
        if h and len(rows):
            way = h * self.velocity(rows[:, :n], rows[0, -1] if self.is_driven else 0.0)
            for part in (0.5, 1.0):
                moved = rows.copy()
                moved[:, :n] += part * way
                found = np.fmax(found, self.steepest_at(moved))
        found = found[np.isfinite(found)]
        return float(found.min()) if len(found) else 0.0

    def steepest_at(self, rows: np.ndarray) -> np.ndarray:
        """Return the largest rate of the planes at each state, not finite where there is none."""
        found = self._steep.map(self._values, [np.ascontiguousarray(rows)])
        sizes: np.ndarray = found.max(axis=1)
        return np.where(np.isfinite(sizes), sizes, np.nan)

    def with_params(self, params: Mapping[str, ArrayLike] | np.ndarray | None) -> Self:
        """Return the field with other numbers, by name or as :meth:`values` gives them.

        Raises
        ------
        ValueError
            There is no such parameter.
        """
        values = self.numbers(params)
        if np.array_equal(values, self._values):
            return self
        other = copy(self)
        other.symbols = self.symbols.with_params(self.symbols.params.replaced(values))
        other._values, other._made = values, None
        return other


def _recorded(column: ca.SX, number: int, symbols: Symbols) -> Recorded | None:
    """Record the plane of a component of the potential, None where nothing moves in it."""
    n, potential = symbols.sizes["x"], column[number]
    k, plane = planes_of(n)[number]
    variables = _variables(symbols)
    v, w = (variables[j] for j in plane)
    frozen = [j for j in (k, n) if j is not None and ca.depends_on(potential, variables[j])]
    order = (*frozen, *plane)
    by_v, by_w = (ca.jacobian(potential, x) for x in (v, w))
    if by_v.is_zero() and by_w.is_zero():
        return None
    mixed = ca.jacobian(by_v, w)
    slopes = [ca.densify(x) for x in (by_v, by_w, mixed)]
    jet = [by_v, by_w, ca.jacobian(by_v, v), mixed, ca.jacobian(by_w, w)]
    others = [variables[j] for j in frozen] + ca.vertsplit(symbols.params.vector)
    jet += [ca.jacobian(slope, x) for x in others for slope in (by_v, by_w)]
    inputs = {"x": ca.vertcat(*(variables[j] for j in order)), "params": symbols.params.vector}
    parts = ([potential], slopes, [ca.densify(x) for x in jet])
    first, second, third = (record("potential", inputs, ca.vertcat(*part)) for part in parts)
    is_separable = bool(ca.simplify(mixed).is_zero())
    return Recorded(order, (first, second, third), is_separable, ca.n_nodes(ca.vertcat(*slopes)))


def _variables(symbols: Symbols) -> list[ca.SX]:
    """Return the symbols of the coordinates, and of time."""
    return [*ca.vertsplit(symbols.x), symbols.t]


def _steepness(column: ca.SX, symbols: Symbols) -> _core.Tape:
    """Record the rates of all planes, of the variables that are stepped.

    The rate is sqrt(F_vw^2 + |F_vv F_ww|): another pair of coordinates of the plane turns the one
    into the other. Where the equations are explicit it is 0.
    """
    variables = _variables(symbols)
    found = []
    for number, (_, (v, w)) in enumerate(planes_of(symbols.sizes["x"])):
        by_v, by_w = (ca.jacobian(column[number], variables[j]) for j in (v, w))
        mixed = ca.jacobian(by_v, variables[w])
        if not ca.simplify(mixed).is_zero():
            own = ca.jacobian(by_v, variables[v]) * ca.jacobian(by_w, variables[w])
            found.append(ca.sqrt(mixed**2 + ca.fabs(own)))
    found = [ca.densify(x) for x in found] or [ca.SX.zeros(1)]
    used = variables if ca.depends_on(column, symbols.t) else variables[:-1]
    inputs = {"x": ca.vertcat(*used), "params": symbols.params.vector}
    return record("potential", inputs, ca.vertcat(*found))
