"""Errors of a user's function that is called with symbols, in the user's names."""

from __future__ import annotations

import inspect
import os
import re
import traceback
from collections.abc import Callable, Mapping
from typing import Any

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted

#: Sizes or an index that do not fit: CasADi's sentence after the place in its own source.
ASSERTION = re.compile(r"(?s)\S*casadi/core/\S+: (Assertion .* failed:\n)?(?P<reason>.*?)\.?$")


def is_undecided(error: Exception) -> bool:
    """Return whether an error says that an expression was asked whether it is true."""
    return isinstance(error, RuntimeError) and "truth value" in str(error)


def undecided(what: str, function: Callable[..., Any], error: Exception) -> TypeError:
    """Return the error of a function that takes the truth value of an expression."""
    return TypeError(
        hinted(
            f"{what}{_line(function, error)} asks whether an expression is true, which has no "
            "value yet",
            "for `if` write ca.if_else(condition, a, b), for `and`, `or`, `max`, `min` "
            "ca.logic_and, ca.logic_or, ca.fmax, ca.fmin",
        )
    )


def is_complex(error: Exception) -> bool:
    """Return whether an error says that a complex number meets an expression."""
    words = str(error)
    return isinstance(error, TypeError) and "'complex'" in words and "'SX'" in words


def complex_value(what: str, function: Callable[..., Any], error: Exception) -> TypeError:
    """Return the error of a function that makes complex values."""
    return TypeError(
        hinted(
            f"{what}{_line(function, error)} has complex values, and expressions are real",
            "write real and imaginary parts: z K + h.c. of an H(t) is the drive ((x, y), K) of two "
            "functions, or z with K where complex numbers meet arithmetic and np.exp alone",
        )
    )


def misread(
    what: str, function: Callable[..., Any], error: Exception, args: Mapping[str, Any]
) -> Exception | None:
    """Return the error of a function that reads what a vector has not, None of another one.

    `args` are the function's symbols by name, the parameters last.
    """
    if isinstance(error, AttributeError) and isinstance(getattr(error, "obj", None), ca.SX):
        return _unnamed(what, function, error, args)
    found = _reading(error)
    if found is None:
        return None
    vector, index = found
    name = next((name for name, x in _vectors(args).items() if x is vector), None)
    many, called = vector.numel(), name or "it"
    has = "1 component" if many == 1 else f"{many} components"
    within = f"indices are integers from 0 to {many - 1}" if many > 1 else f"{called}[0] is all"
    if not vector.is_column():
        has, within = f"shape {vector.shape}", "indices are integers below these numbers"
    reads = f"reads {name}[{_written(index)}]" if name else f"reads [{_written(index)}] of a vector"
    sentence = f"{what}{_line(function, error)} {reads}, and {called} has {has}"
    if index is Ellipsis:
        sentence = f"{what}{_line(function, error)} iterates over {name or 'a vector'} of CasADi's"
        within = f"write `for k in range({many})`, and {name or 'the vector'}[k]"
    if isinstance(error, (NotImplementedError, TypeError)):
        return TypeError(hinted(sentence, within))
    return ValueError(hinted(sentence, within if many else f"there are {_sizes(args)}"))


def _unnamed(
    what: str, function: Callable[..., Any], error: AttributeError, args: Mapping[str, Any]
) -> AttributeError:
    """Return the error of a function that reads a component by a name."""
    name = next((name for name, x in _vectors(args).items() if x is error.obj), None)
    asks = f"{name}.{error.name}" if name else f".{error.name} of an expression"
    sentence = f"{what}{_line(function, error)} asks for {asks}"
    if name is None:
        return AttributeError(hinted(sentence, "functions of expressions are CasADi's, as ca.sin"))
    hint = f"components have numbers, {name}[0] and so on, in the order of the coordinates"
    return AttributeError(hinted(f"{sentence}, and a vector has no names", hint))


def misfit(
    what: str, function: Callable[..., Any], error: Exception, args: Mapping[str, Any]
) -> ValueError | None:
    """Return the error of a function whose operands have sizes that do not fit, else None."""
    found = ASSERTION.match(str(error)) if isinstance(error, RuntimeError) else None
    if found is None:
        return None
    line, reason = _line(function, error), found["reason"]
    sentence = f"{what}{line} combines arrays whose shapes do not match: {reason}"
    hint = f"there are {_sizes(args)}"
    if "roduct" in reason:  # of two columns, by @ or np.dot
        hint = (
            f"the product of two vectors is ca.dot(a, b), of one with itself ca.sumsqr(a); {hint}"
        )
    return ValueError(hinted(sentence, hint))


def _reading(error: Exception) -> tuple[ca.SX, Any] | None:
    """Return the vector that an error comes from, and the index that it was read with."""
    if not isinstance(error, (RuntimeError, NotImplementedError, TypeError)):
        return None
    for frame, _ in traceback.walk_tb(error.__traceback__):
        vector = frame.f_locals.get("self")
        if not isinstance(vector, ca.SX):
            continue
        if frame.f_code.co_name == "__getitem__":
            return vector, frame.f_locals.get("s")
        if frame.f_code.co_name == "__iter__":
            return vector, Ellipsis
    return None


def _line(function: Callable[..., Any], error: Exception) -> str:
    """Return the line of a user's file that an error comes from, as part of a sentence."""
    frames = traceback.extract_tb(error.__traceback__)
    own = inspect.unwrap(function)
    file = getattr(getattr(own, "__code__", None), "co_filename", None)
    lines = [
        f", line {x.lineno} of {os.path.basename(x.filename)},"
        for x in frames
        if x.filename == file
    ]
    return lines[-1] if lines else ""


def _vectors(args: Mapping[str, Any]) -> dict[str, ca.SX]:
    """Return the symbols that a function is given, by what it calls them."""
    *own, params = args
    found = {name: args[name] for name in own}
    return found | {f"{params}.{name}": x for name, x in vars(args[params].namespace).items()}


def _sizes(args: Mapping[str, Any]) -> str:
    vectors = _vectors(args).items()
    return ", ".join(f"{name} of {'x'.join(map(str, x.shape))}" for name, x in vectors)


def _written(index: Any) -> str:
    """Write an index as it stands between brackets."""
    if isinstance(index, slice):
        ends = ["" if x is None else str(x) for x in (index.start, index.stop)]
        return ":".join(ends if index.step is None else [*ends, str(index.step)])
    return ", ".join(map(_written, index)) if isinstance(index, tuple) else repr(index)
