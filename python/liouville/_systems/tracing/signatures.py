"""The arguments that a user's function takes, and those that it is given."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from liouville._basics.errors import hinted

#: States that are not the same numbers: a velocity that is called p, or a momentum called v.
MISTAKEN = {("v", "p"), ("p", "v")}

#: The kinds of arguments that are given by their places.
PLACED = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def check_signature(what: str, function: Callable[..., Any], args: Mapping[str, Any]) -> None:
    """Refuse a function that does not take these arguments, one after another."""
    signature = _signature(function)
    if signature is None:
        return
    try:
        signature.bind(*args.values())
    except TypeError:
        raise misfitting(what, function, args) from None


def takes_multipliers(function: Callable[..., Any]) -> bool:
    """Return whether a function has an argument lam, or needs five, as an event's may."""
    signature = _signature(function)
    own = {} if signature is None else signature.parameters
    needed = [x for x in own.values() if x.kind in PLACED and x.default is x.empty]
    return "lam" in own or len(needed) == 5


def misnamed(function: Callable[..., Any], args: Mapping[str, Any]) -> list[str]:
    """Return the arguments that a function calls by the name of another.

    They are given by their places, and a function may call them as it likes: but
    ``torque(angle, rate, t, params)`` is not what it seems.
    """
    signature, states = _signature(function), [x for x in args if x != "params"]
    given = signature.parameters.values() if signature else ()
    pairs = [
        (x.name, own) for own, x in zip(states, given, strict=False) if x.kind != x.VAR_POSITIONAL
    ]
    return [own for x, own in pairs if (x in states and x != own) or (x, own) in MISTAKEN]


def misfitting(what: str, function: Callable[..., Any], args: Mapping[str, Any]) -> TypeError:
    """Return the error of a function that takes other arguments."""
    signature = _signature(function)
    parameters = signature.parameters.values() if signature else ()
    given = ", ".join(str(x.replace(annotation=x.empty)) for x in parameters)
    wanted = ", ".join(args)
    return TypeError(
        hinted(
            f"{what} is called with ({wanted}), and the function given takes ({given})",
            f"write it as def function({wanted}): it takes all of these, whichever it uses",
        )
    )


def _signature(function: Callable[..., Any]) -> inspect.Signature | None:
    """Return the signature of a function, None for some that are not written in Python."""
    try:
        return inspect.signature(function)
    except (TypeError, ValueError):
        return None
