"""Vector fields without divergence: the calls that all of them have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics.errors import hinted, misshapen, shown
from liouville._systems.events import Event
from liouville._systems.fields.dates import Dates, in_numbers
from liouville._systems.fields.observer import Observer
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Parametrised, Symbols


class Field(Parametrised, ABC):
    """A base of fields x' = f(t, x), whose one state is x."""

    states = ("x",)
    constraints: tuple[str, ...] = ()
    coordinates: tuple[str, ...]
    is_driven: bool
    symbols: Symbols
    _observer: Observer
    #: Parameters that are variables at rest, by number, with their names.
    held: Mapping[int, str] = {}
    #: What times are counted from, None where they are mere numbers.
    dates: Dates | None = None
    #: What is recorded when it is first wanted, of all values of the parameters.
    _recorded: dict[str, Any]

    @property
    def expressions(self) -> Expressions | None:
        """The field as expressions, None where it is known by terms or samples."""
        return None

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of what is stepped: coordinates, the time of a driven field, and what is held."""
        time = ("t",) if self.is_driven else ()
        return (*self.coordinates, *time, *self.held.values())

    @abstractmethod
    def with_params(self, params: Mapping[str, ArrayLike] | np.ndarray | None) -> Self:
        """Return the field with other numbers, by name or as :meth:`values` gives them.

        Raises
        ------
        ValueError
            There is no such parameter, or its value has another shape or is not finite.
        """

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """The names of the entries of all states that a run keeps, by the name of the state."""
        return {"x": self.coordinates}

    @property
    def invariants(self) -> tuple[str, ...]:
        """Names of the invariants."""
        return self._observer.names

    def numbers(self, params: Mapping[str, ArrayLike] | np.ndarray | None) -> np.ndarray:
        """Return the parameter vector, which may be given as :meth:`values` gives it."""
        known = self.values(None)
        if isinstance(params, np.ndarray) and (params.shape, params.dtype) == (
            known.shape,
            known.dtype,
        ):
            return params
        return self.values(params)  # type: ignore[arg-type]  # another array is refused

    def start(self, start: Mapping[str, Any], members: bool = False) -> np.ndarray:
        """Check a start and return it as an array of shape (n,), or (P, n) for P members.

        Raises
        ------
        TypeError
            x is missing or no array of numbers, or there is another start value.
        ValueError
            x has a wrong shape, an unknown coordinate, or is not finite.
        """
        for name in start:
            if name not in self.states:
                raise TypeError(f"'{name}' is no start value of this system, which takes x=")
        if "x" not in start:
            raise TypeError("start value 'x' is missing: this system takes x=")
        array = self._array(start["x"])
        n = len(self.coordinates)
        if array.ndim == members and n == 1:
            array = array[..., None]
        wanted = f"(P, {n}) for P members" if members else f"({n},)"
        if array.ndim != 1 + members or array.shape[-1] != n or array.size == 0:
            hint = ""
            if array.ndim == 2 - members and array.size and array.shape[-1] == n:
                rows = "give a row for each member, of one alone x[None, :]"
                hint = rows if members else "lv.ensemble takes many starts"
            elif array.ndim == 1 + members and array.size:
                hint = f"give a number for each of {shown(self.coordinates)}"
            raise misshapen("x", array.shape, wanted, hint)
        bad = np.argwhere(~np.isfinite(array))
        if bad.size:
            place = tuple(bad[0])
            member = f" of member {place[0]}" if members else ""
            of = f"x of '{self.coordinates[place[-1]]}'{member}"
            raise ValueError(f"{of} must be finite, not {array[place]}")
        return np.ascontiguousarray(array)

    def positions(self, x: np.ndarray) -> dict[str, tuple[np.ndarray, dict[str, str]]]:
        """Return the points of states x, shape (..., n), by coordinates that states do not have.

        They go by name, each of shape (...), with its attributes by CF.
        """
        del x
        return {}

    def in_time(self, t: Any) -> Any:
        """Return a time, or several, with numbers for dates and spans of time.

        Raises
        ------
        TypeError
            There is a date, and times have none.
        """
        return in_numbers(self, self.dates, t)

    def written(self, t: float) -> str:
        """Write a time, as a date where there are dates."""
        return f"{t:g}" if self.dates is None else self.dates.written(t)

    def lengths(self, x: np.ndarray) -> np.ndarray:
        """Return the lengths of unit changes of each coordinate at states x, shape (..., n)."""
        return np.ones_like(x)

    def extended(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return states (P, n) with all further variables: the time, and parameters held."""
        more = [t] if self.is_driven else []
        more += self.values(None)[[*self.held]].tolist() if self.held else []
        return np.hstack([x, np.tile(more, (len(x), 1))]) if more else x

    def _array(self, value: Any) -> np.ndarray:
        """Return a start as an array, the coordinate last."""
        if isinstance(value, Mapping):
            if set(value) != set(self.coordinates):
                names = shown([*map(str, value)])
                raise ValueError(f"x must name {shown(self.coordinates)}, not {names}")
            value = [value[coordinate] for coordinate in self.coordinates]
            array = _trace.numbers(value)
            array = array if array is None else array.T
        else:
            array = _trace.numbers(value)
        if array is None:
            raise TypeError(f"x must be an array of real numbers, not {value!r}")
        return array

    def observer(
        self, observe: Mapping[str, Any] | None, states: bool = True
    ) -> tuple[_core.Tape, dict[str, int]]:
        """Record what a run keeps besides x; returns the tape of t, x and params, and widths."""
        return self._observer.tape(observe)

    def event(self, name: str, event: Event) -> tuple[_core.Tape, bool, None]:
        """Record the function of an event, of t, x and params; it has neither more nor a reset."""
        if event.reset is not None:
            sentence = f"event '{name}' has a reset, and the volume would not outlive it"
            hint = "let it end the run, terminal=True, and begin another from the state you want"
            raise TypeError(hinted(sentence, hint))
        return self._observer.event(f"event '{name}'", event.function), False, None

    def event_slopes(self, name: str, event: Event) -> _core.Tape:
        """Record the derivatives of an event's function by t, x and params."""
        return self._observer.event_slopes(f"event '{name}'", event.function)

    def slopes_of(self, function: Callable[..., Any]) -> tuple[_core.Tape, int]:
        """Record the Jacobian of a function by t, x and params, and return its width."""
        return self._observer.slopes_of(function)

    def slopes_of_invariant(self, name: str) -> _core.Tape:
        """Record the derivatives of an invariant by t, x and params."""
        return self._observer.slopes_of_invariant(name)

    def states_at(
        self, t: np.ndarray, rows: np.ndarray, params: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Name the states at k points, of which rows are given."""
        del t, params
        return {"x": rows}

    def measured(self, functions: Mapping[str, Any]) -> tuple[_core.Tape, dict[str, int]]:
        """Record functions of (t, x, params) and their derivatives by x and params, for fits."""
        return self._observer.measured(functions)

    def portable(self, observe: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return functions to observe in a form that can be pickled."""
        return self._observer.portable(observe)
