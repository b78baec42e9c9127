"""The base of runs as functions of arrays, whatever library the arrays are of."""

from __future__ import annotations

from typing import Any

from liouville._bridges.functions import run_function
from liouville._bridges.run import Runnable
from liouville._methods import Method
from liouville._runs.runner import Request


class Solver:
    """A run as a function, which can be pickled where its system can.

    Attributes
    ----------
    failures : dict of int to str
        The members of the last mapped call that failed, with what was said of each: a step, an
        input that is no number, a start that the constraints do not allow, or no derivative there.
    """

    def __init__(
        self, system: Runnable, method: Method | str, wrt: Any, returns: Any, request: Request
    ) -> None:
        self._given = system, method, wrt, returns, request
        self._function = run_function(*self._given)
        self.__name__, self.__doc__ = "solve", self._function.described

    @property
    def failures(self) -> dict[int, str]:
        """The members of the last mapped call that failed."""
        return dict(self._function.failures)

    def __repr__(self) -> str:
        """Return the description of a run, with its inputs and outputs."""
        library = type(self).__module__.rpartition(".")[2]
        return f"<lv.{library}.solver: {self._function.described}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments, of which it is made again."""
        return type(self), self._given
