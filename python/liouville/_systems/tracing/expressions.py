"""Symbols of a system, expressions of them, and how both are pickled.

Tapes are pickled as they are, expressions as one function of CasADi's, which is read when something
new is wanted of them: nothing is traced or differentiated where a system is loaded.
"""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from functools import cached_property
from inspect import Parameter, Signature
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics import html
from liouville._basics.arguments import read_only
from liouville._basics.errors import hinted
from liouville._systems.tracing import trace as _trace

PROTOCOL = 5


class Pickled:
    """A base of systems, whose pickle is the compressed pickle of its state."""

    def _repr_html_(self) -> str:
        """Show a table of its names and parameters in a notebook."""
        return html.of_system(self)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the function that loads it, and its state."""
        try:
            state = pickle.dumps(self._state(), PROTOCOL)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise TypeError(
                hinted(
                    f"{self!r} cannot be pickled: {error}",
                    "what makes products, and what a class of your own adds, has to be picklable "
                    "itself; define it in a module, at its top level",
                )
            ) from error
        return loaded, (type(self), zlib.compress(state))

    def __copy__(self) -> Self:
        """Return another that shares everything."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def _state(self) -> dict[str, Any]:
        """Return the attributes to pickle, by default all."""
        return dict(self.__dict__)

    def _restore(self, state: dict[str, Any]) -> None:
        """Take over what was pickled."""
        self.__dict__.update(state)


class Parametrised(Pickled):
    """A base of systems of expressions, whose parameters are among the symbols of these."""

    symbols: Symbols

    @property
    def params(self) -> dict[str, Any]:
        """The parameters' default values, read-only; a run takes others by its ``params=``."""
        return read_only(self.symbols.params.defaults)

    def values(self, params: Mapping[str, ArrayLike] | None) -> np.ndarray:
        """Return the parameters as one vector, shape (w,), in the order of their declaration.

        Parameters
        ----------
        params : mapping of str to array_like, or None
            Values in the place of the defaults, by name.

        Raises
        ------
        TypeError, ValueError
            params is no mapping, or a value has no parameter, another shape or is not finite.
        """
        return self.symbols.params.values(params)


def loaded(kind: type[Pickled], state: bytes) -> Pickled:
    """Make what was pickled."""
    found = object.__new__(kind)
    found._restore(pickle.loads(zlib.decompress(state)))
    return found


class Symbols:
    """The symbols of a system: the time `t`, vectors by name, and parameters.

    They are made when they are first used, and are others where they are loaded.

    Attributes
    ----------
    params : Parameters
        The parameters, whose symbols are `params.vector`.
    sizes : dict of str to int
        The vectors, which are attributes too: ``Symbols(params, {"y": 2}).y``.
    """

    def __init__(
        self,
        params: _trace.Parameters,
        sizes: Mapping[str, int],
        labels: Mapping[str, str] | None = None,
    ) -> None:
        self.params, self.sizes = params, dict(sizes)
        self._labels = dict(labels or {})  # the user's words for vectors

    @cached_property
    def t(self) -> ca.SX:
        return ca.SX.sym("t")

    def __getattr__(self, name: str) -> ca.SX:
        """Make the symbols of a vector."""
        sizes = self.__dict__.get("sizes", {})
        if name not in sizes:
            raise AttributeError(name)
        made: ca.SX = ca.SX.sym(self._labels.get(name, name), sizes[name])
        self.__dict__[name] = made
        return made

    def __getstate__(self) -> dict[str, Any]:
        """Leave the symbols out."""
        return {name: self.__dict__[name] for name in ("params", "sizes", "_labels")}

    @property
    def args(self) -> _trace.Args:
        """The arguments of a user's function by its words: time, vectors and parameters."""
        vectors = {self._labels.get(name, name): getattr(self, name) for name in self.sizes}
        return {"t": self.t, **vectors, "params": self.params}

    @property
    def all(self) -> list[ca.SX]:
        """All symbols, the parameters last."""
        return [self.t, *(getattr(self, name) for name in self.sizes), self.params.vector]

    def inputs(self, **more: ca.SX) -> dict[str, ca.SX]:
        """Return the inputs of a tape: time, the first vector, more, and the parameters."""
        first = {name: getattr(self, name) for name in [*self.sizes][:1]}
        return {"t": self.t, **first, **more, "params": self.params.vector}

    def with_params(self, params: _trace.Parameters) -> Symbols:
        """Return the same symbols with other defaults of their parameters."""
        other = copy(self)
        other.__dict__.update(self.__dict__)
        other.params = params
        return other


class Expressions:
    """Expressions by name, of symbols and of more symbols by name.

    Attributes
    ----------
    symbols : Symbols
        The symbols of the system.
    columns : dict of str to SX
        The expressions.
    more : dict of str to SX
        Further symbols, such as multipliers.
    """

    def __init__(self, symbols: Symbols, columns: Mapping[str, ca.SX], **more: ca.SX) -> None:
        self.symbols, self._names = symbols, tuple(columns)
        self._sizes = {name: x.numel() for name, x in more.items()}
        self.columns, self.more = dict(columns), more

    @cached_property
    def columns(self) -> dict[str, ca.SX]:
        return dict(zip(self._names, self.of(*self._all), strict=True))

    @cached_property
    def more(self) -> dict[str, ca.SX]:
        return {name: ca.SX.sym(name, n) for name, n in self._sizes.items()}

    def of(self, *symbols: ca.SX) -> list[ca.SX]:
        """Return the expressions of other symbols, in the same order."""
        return read(self._function, symbols)

    @property
    def _all(self) -> list[ca.SX]:
        return [*self.symbols.all, *self.more.values()]

    @cached_property
    def _function(self) -> str:
        return written(self._all, self.columns.values())

    def __getstate__(self) -> dict[str, Any]:
        """Return the expressions as a function."""
        own = {name: self.__dict__[name] for name in ("symbols", "_names", "_sizes")}
        return {**own, "_function": self._function}


class Recorded:
    """A function of the user's that was called with symbols: it is pickled without itself.

    It can be called with other symbols, and the namespace of the parameters last.
    """

    def __init__(self, what: str, function: Callable[..., Any], args: _trace.Args) -> None:
        own = [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in args]
        self.__signature__ = Signature(own)
        *symbols, params = args.values()
        self._function = written([*symbols, params.vector], [_trace.column(what, function, args)])

    def __call__(self, *args: Any) -> ca.SX:
        """Return the expressions, of these symbols."""
        *symbols, namespace = args
        return read(self._function, [*symbols, _trace.vector_of(namespace)])[0]


def recorded(
    observe: Mapping[str, Any] | None, args_of: Callable[[Any], _trace.Args]
) -> dict[str, Recorded]:
    """Return functions to observe in a form that can be pickled, from the arguments of each."""
    return {
        name: Recorded(f"observed '{name}'", function, args_of(function))
        for name, function in _trace.mapping("observe", observe).items()
    }


def written(symbols: Iterable[ca.SX], expressions: Iterable[ca.SX]) -> str:
    """Write expressions of some symbols down as a function."""
    function: str = ca.Function("expressions", [*symbols], [*expressions]).serialize()
    return function


def read(function: str, symbols: Iterable[ca.SX]) -> list[ca.SX]:
    """Return the expressions of a function that :func:`written` made, of other symbols."""
    found: list[ca.SX] = ca.Function.deserialize(function).call([*symbols])
    return found
