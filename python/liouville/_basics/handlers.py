"""Exceptions of signal handlers, which are raised as they are wherever a signal comes."""

from __future__ import annotations

import signal
import traceback
from types import CodeType
from typing import Any


def raise_of_handler(error: BaseException) -> None:
    """Raise an exception again if a handler of a signal has raised it, within the user's function.

    Python runs handlers between any two instructions of the main thread. What they raise is no
    failure of the function that was running, such as the TimeoutError of an alarm.
    """
    codes = {_code_of(signal.getsignal(number)) for number in signal.valid_signals()}
    if any(frame.f_code in codes for frame, _ in traceback.walk_tb(error.__traceback__)):
        raise error


def _code_of(handler: Any) -> CodeType | None:
    """Return the code of a handler that is written in Python."""
    if not callable(handler):
        return None
    handler = getattr(handler, "func", handler)  # of functools.partial
    found = getattr(handler, "__code__", None)
    if found is None:
        found = getattr(type(handler).__call__, "__code__", None)
    return found
