"""Calling the user's functions with symbols, and checking what they return."""

from __future__ import annotations

import keyword
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics.arguments import large_integers
from liouville._basics.errors import hinted, misshapen, shown
from liouville._basics.handlers import raise_of_handler
from liouville._systems.tape import check
from liouville._systems.tracing.call_errors import (
    complex_value,
    is_complex,
    is_undecided,
    misfit,
    misread,
    undecided,
)
from liouville._systems.tracing.signatures import check_signature, misfitting, misnamed

#: The arguments of a user's function, by their names: symbols, and the :class:`Parameters` last.
Args = Mapping[str, Any]


class Parameters:
    """The parameters of a system: names, default values, and their symbols.

    Parameters
    ----------
    defaults : mapping of str to float or 1-D array_like
        Values used unless a run gives others.
    """

    def __init__(self, defaults: Mapping[str, ArrayLike] | None) -> None:
        given = mapping("params", defaults)
        self.defaults = {name: _parameter(name, value) for name, value in given.items()}
        self._initial = np.concatenate([np.empty(0), *(x.ravel() for x in self.defaults.values())])

        self.symbols = _Symbols({name: max(x.size, 1) for name, x in self.defaults.items()})

    @property
    def namespace(self) -> Namespace:
        """The symbols by name."""
        return self.symbols.namespace

    @property
    def vector(self) -> ca.SX:
        """The symbols, one after another."""
        return self.symbols.vector

    def values(self, changes: Mapping[str, ArrayLike] | None) -> np.ndarray:
        """Return the defaults with changes, one after another."""
        if changes is None:
            return self._initial.copy()
        values = dict(self.defaults)
        for name, value in mapping("params", changes).items():
            if name not in values:
                known = ", ".join(self.defaults) or "none"
                raise ValueError(
                    f"there is no parameter '{name}'; the system's parameters: {known}"
                )
            new = _parameter(name, value)
            if new.shape != values[name].shape:
                raise misshapen(f"parameter '{name}'", new.shape, values[name].shape)
            values[name] = new
        return np.concatenate([np.empty(0), *(x.ravel() for x in values.values())])

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave the symbols out of a pickle: loading makes others."""
        return Parameters, (self.defaults,)

    def replaced(self, values: np.ndarray) -> Parameters:
        """Return the same parameters with other defaults, one after another."""
        other, places = Parameters(None), np.cumsum([x.size for x in self.defaults.values()])[:-1]
        other.symbols, other._initial = self.symbols, values.copy()
        parts = zip(self.defaults.items(), np.split(values, places), strict=True)
        other.defaults = {name: part.reshape(x.shape) for (name, x), part in parts}
        return other


class _Symbols:
    """Symbols of parameters with these sizes, made when they are first used."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self._sizes = sizes

    @cached_property
    def namespace(self) -> Namespace:
        return Namespace({name: ca.SX.sym(name, size) for name, size in self._sizes.items()})

    @cached_property
    def vector(self) -> ca.SX:
        return vector_of(self.namespace)


class Namespace:
    """Parameters by name, as a user's functions see them: symbols of a model, else numbers."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        """Refuse a name that is no parameter."""
        known = ", ".join(self.__dict__) or "none"
        raise AttributeError(f"there is no parameter '{name}'; the system's parameters: {known}")

    def __getitem__(self, name: Any) -> Any:
        """Refuse params["m"]."""
        raise TypeError(hinted(f"params has no items: params[{name!r}]", f"write params.{name}"))


def vector_of(namespace: Any) -> ca.SX:
    """Return the parameters that a user's function takes by name, one after another."""
    return ca.vertcat(ca.SX(0, 1), *vars(namespace).values())


def _parameter(name: str, value: ArrayLike) -> np.ndarray:
    if not name.isidentifier() or keyword.iskeyword(name):
        raise ValueError(f"a parameter's name must be an identifier and no keyword, not {name!r}")
    array = numbers(value)
    if array is None or array.ndim > 1 or array.size == 0:
        raise ValueError(
            f"parameter '{name}' must be a number or a 1-D array of numbers, not {value!r}"
        )
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        place = f"[{bad[0]}]" if array.ndim else ""
        raise ValueError(f"parameter '{name}{place}' must be finite, not {array.flat[bad[0]]}")
    return array


def numbers(value: Any) -> np.ndarray | None:
    """Return real numbers as a new array of floats, and None for anything else."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        return None  # what is masked is no number
    try:
        array = np.array(value)
    except (TypeError, ValueError):  # symbols, or rows of different lengths
        return None
    if array.dtype == float:
        return array
    array = large_integers(array)
    with np.errstate(over="ignore"):  # of longer types, which are infinite then
        return array.astype(float, copy=False) if array.dtype.kind in "iuf" else None


def pair(what: str, given: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return least and largest values of a quantity; None leaves a side open."""
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str) or len(given) != 2:
        raise TypeError(f"{what} must be bounded by a pair (least, largest), not {given!r}")
    found = []
    for side, open_side in zip(given, (-np.inf, np.inf), strict=True):
        array = numbers(open_side if side is None else side)
        if array is None or np.isnan(array).any() or array.shape not in ((), shape):
            raise ValueError(
                f"a bound of {what} must be a number or have shape {shape}, not {side!r}"
            )
        found.append(np.broadcast_to(array, shape))
    if (found[0] > found[1]).any():
        raise ValueError(f"the bounds of {what} leave nothing: {given!r}")
    return found[0], found[1]


def vector(name: str, value: Any, places: tuple[str, ...]) -> np.ndarray:
    """Return a start value as an array with a number for each name."""
    array = numbers(value)
    if array is None and isinstance(value, Mapping):
        if set(value) != set(places):
            raise ValueError(f"{name} must name {shown(places)}, not {shown([*map(str, value)])}")
        value = [value[place] for place in places]
        array = numbers(value)
    if array is None:
        raise TypeError(f"{name} must be an array of real numbers, not {value!r}")
    if array.shape == () and len(places) == 1:
        array = array.reshape(1)
    if array.shape != (len(places),):
        hint = f"give a number for each of {shown(places)}" if array.ndim == 1 and places else ""
        raise misshapen(name, array.shape, f"({len(places)},)", hint)
    if not np.isfinite(array).all():
        bad = int(np.argmin(np.isfinite(array)))
        raise ValueError(f"{name} of '{places[bad]}' must be finite, not {array[bad]}")
    return array


def mapping(what: str, value: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return a mapping of names, or an empty one for None."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise TypeError(f"{what} must be a mapping of names, not {value!r}")
    for name in value:
        if not isinstance(name, str) or not name:
            raise TypeError(f"the names of {what} must be nonempty strings, not {name!r}")
    return dict(value)


def names(value: Sequence[str] | int, prefix: str) -> tuple[str, ...]:
    """Return coordinate names, from names or a number of coordinates."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"a system has at least one coordinate, not {prefix}={value}")
        return tuple(f"{prefix}{k}" for k in range(value))
    if isinstance(value, str) or not isinstance(value, Sequence):
        wanted = tuple(value) if isinstance(value, str) else ("x", "y")
        hint = f"write {prefix}={wanted} or {prefix}={len(wanted)}"
        sentence = f"{prefix} must be a sequence of names or a number, not {value!r}"
        raise TypeError(hinted(sentence, hint))
    found = tuple(value)
    if not found or not all(isinstance(name, str) and name for name in found):
        raise ValueError(f"{prefix} needs at least one name, and each a string: {value!r}")
    twice = [name for name, count in Counter(found).items() if count > 1]
    if twice:
        raise ValueError(f"{prefix} names {min(twice)!r} twice")
    return found


def scalar(what: str, function: Callable[..., Any], args: Args) -> ca.SX:
    """Call a function and return its one expression.

    Here and below, `args` are the symbols it is called with, by the names that its arguments have,
    the :class:`Parameters` last.
    """
    return _checked(what, _scalar(what, _call(what, function, args)), args)


def column(what: str, function: Callable[..., Any], args: Args, size: int | None = None) -> ca.SX:
    """Call a function and return its expressions as a column, of the wanted size if any."""
    return _sized(what, _column(what, _call(what, function, args)), args, size)


def _sized(what: str, expression: ca.SX, args: Args, size: int | None) -> ca.SX:
    count = expression.numel()
    if count == 0 or (size is not None and count != size):
        least = f"{size} value{'s' * (size > 1)}" if size else "at least one value"
        raise ValueError(f"{what} must return {least}, not {count}")
    return _checked(what, expression, args)


def placed(what: str, function: Callable[..., Any], args: Args, places: tuple[str, ...]) -> ca.SX:
    """Call a function and return one expression a place: of a column, or a mapping of some."""
    return _placed(what, _call(what, function, args), args, ca.SX(len(places), 1), places)


def _placed(what: str, value: Any, args: Args, others: ca.SX, places: tuple[str, ...]) -> ca.SX:
    """Return one expression a place, with the others where a mapping has none."""
    if not isinstance(value, Mapping):
        return _sized(what, _column(what, value), args, len(places))
    expression = ca.SX(others)
    index = {name: k for k, name in enumerate(places)}
    for name, part in mapping(what, value).items():
        if name not in index:
            raise ValueError(f"{what} has a value for '{name}', which is no coordinate")
        expression[index[name]] = _scalar(f"{what} '{name}'", part)
    return _checked(what, expression, args)


def replaced(
    what: str,
    function: Callable[..., Any],
    args: Args,
    states: Mapping[str, ca.SX],
    places: Mapping[str, tuple[str, ...]],
) -> list[ca.SX]:
    """Call a function and return states that it replaces: the last, or those of a mapping."""
    value = _call(what, function, args)
    if not isinstance(value, Mapping):
        value = {[*states][-1]: value}
    found = dict(states)
    for name, part in mapping(what, value).items():
        if name not in states:
            raise ValueError(f"{what} gives '{name}', which is none of {', '.join(states)}")
        which = f"{what} '{name}'"
        found[name] = _placed(which, part, args, states[name], places[name])
    return [*found.values()]


def named(what: str, function: Callable[..., Any], args: Args) -> tuple[tuple[str, ...], ca.SX]:
    """Call a function and return names and expressions: of a mapping, a sequence, or a scalar."""
    value = _call(what, function, args)
    if isinstance(value, Mapping):
        hint = "give each value a name of its own, or return a list without names"
        parts = [_scalar(f"{what} '{k}'", part, hint) for k, part in mapping(what, value).items()]
        return tuple(value), _checked(what, ca.vertcat(ca.SX(0, 1), *parts), args)
    expression = _checked(what, _column(what, value), args)
    count = expression.numel()
    found = (what,) if count == 1 else tuple(f"{what}{k}" for k in range(count))
    return found, expression


def _call(what: str, function: Callable[..., Any], args: Args) -> Any:
    if not callable(function):
        raise TypeError(f"{what} must be a function, not {function!r}")
    *symbols, params = args.values()
    check_signature(what, function, args)
    try:
        with warnings.catch_warnings():  # np.sin of symbols is theirs, whatever CasADi will do
            warnings.filterwarnings("ignore", r"\s*casadi: a numpy function", FutureWarning)
            value = function(*symbols, params.namespace)
    except Exception as error:
        raise_of_handler(error)
        if is_undecided(error):
            raise undecided(what, function, error) from error
        if is_complex(error):
            raise complex_value(what, function, error) from error
        if _is_inner(error):
            raise
        if found := misread(what, function, error, args) or misfit(what, function, error, args):
            raise found from error
        error.add_note(
            f"raised while `{what}` was called with CasADi symbols; "
            "use casadi's functions (ca.sin), and ca.if_else for a choice; code for numbers alone "
            "cannot be traced, and lv.table(x, y) stands in for it by its values"
        )
        raise
    if any(_depends(value, args[name]) for name in misnamed(function, args)):
        raise misfitting(what, function, args)
    return value


def _depends(value: Any, symbol: ca.SX) -> bool:
    """Return whether what a function returns contains a symbol."""
    if isinstance(value, ca.SX):
        return bool(ca.depends_on(value, symbol))
    if isinstance(value, Mapping):
        value = [*value.values()]
    elif isinstance(value, np.ndarray):
        value = value.ravel()
    elif not isinstance(value, list | tuple):
        return False
    return any(_depends(part, symbol) for part in value)


def _is_inner(error: Exception) -> bool:
    """Return whether an error comes from a function that was called inside another, by its name."""
    _, *inner = traceback.extract_tb(error.__traceback__)
    return any(x.filename == __file__ and x.name != "__getattr__" for x in inner)


def _scalar(what: str, value: Any, hint: str = "") -> ca.SX:
    expression = _column(what, value)
    if expression.numel() != 1:
        sentence = f"{what} must return a scalar, not {expression.numel()} values"
        raise ValueError(hinted(sentence, hint) if hint else sentence)
    return expression


def _checked(what: str, expression: ca.SX, args: Args) -> ca.SX:
    """Return an expression once it is seen to fit on a tape: the user's name is still known."""
    *symbols, params = args.values()
    check(what, {str(k): x for k, x in enumerate([*symbols, params.vector])}, expression)
    return expression


def _column(what: str, value: Any) -> ca.SX:
    if isinstance(value, ca.SX):  # of many bodies there are hundreds
        return value if value.is_column() else ca.vec(value)
    if value is None:
        raise TypeError(f"{what} returns None; is a `return` missing?")
    if isinstance(value, np.ndarray):
        value = list(value.ravel())
    if isinstance(value, Iterable) and not isinstance(
        value, (ca.DM, ca.MX, str, bytes, Mapping, Set)
    ):
        parts = [_column(what, part) for part in value]
        return ca.vertcat(ca.SX(0, 1), *parts)
    try:
        expression = ca.SX(value)
    except (NotImplementedError, TypeError):
        kind = type(value).__name__
        raise TypeError(f"{what} must return CasADi's SX or numbers, not a {kind}") from None
    return ca.vec(expression)
