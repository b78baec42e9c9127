"""CasADi functions as tapes; this file alone knows CasADi's instruction codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain
from typing import Any

import numpy as np

from liouville import _casadi as ca
from liouville._core import OPERATIONS, Tape
from liouville.errors import hinted

_INPUT, _CONSTANT, _OUTPUT = -1, -2, -3

#: What helps where an expression has another operation than those of a tape.
ELEMENTARY = (
    "a tape takes + - * / and powers, square roots, exp, log, trigonometric and hyperbolic "
    "functions, fabs, sign, fmin, fmax, floor, ceil, comparisons and if_else of CasADi's"
)
CALLED = (
    "functions of CasADi's that have no expressions, such as interpolant, rootfinder or "
    "integrator, cannot be taken; for a table write lv.table(xs, ys)(x), "
    "ca.pw_lin(x, xs, ys) or np.interp(x, xs, ys)"
)


@dataclass(frozen=True)
class Part:
    """Outputs that follow one another: expressions at some places, zero at the others.

    Attributes
    ----------
    values : SX
        The expressions, a dense column of k.
    places : ndarray
        Where they are, shape (k,).
    size : int
        Number of outputs.
    """

    values: ca.SX
    places: np.ndarray
    size: int

    @classmethod
    def of(cls, x: ca.SX) -> Part:
        """Return all elements of a matrix, column by column."""
        return cls(ca.vec(x.nz[:]), np.array(x.sparsity().find(), dtype=np.int64), x.numel())


def record(name: str, inputs: Mapping[str, ca.SX], *outputs: ca.SX | Part) -> Tape:
    """Record expressions as one tape, what they have in common once.

    Parameters
    ----------
    name : str
        What the tape is called in messages.
    inputs : mapping of str to SX
        The input groups in order; the last is the parameters.
    *outputs : SX or Part
        What follows one another on the tape; of a matrix all elements, column by column.

    Returns
    -------
    Tape

    Raises
    ------
    ValueError
        An expression has an operation that is not on the tape, a symbol that is not an input, or
        the constant NaN.
    """
    parts = [x if isinstance(x, Part) else Part.of(x) for x in outputs]
    column = ca.vertcat(ca.SX(0, 1), *(part.values for part in parts))
    function = _function(name, inputs, column, reuse=False)
    lines, values = _program(function)
    lines[:, 0] = _codes(name, function, lines[:, 0])
    starts = np.cumsum([0, *(part.size for part in parts)])
    places = np.concatenate(
        [
            np.empty(0, dtype=np.int64),
            *(x.places + at for x, at in zip(parts, starts, strict=False)),
        ]
    )
    is_output = lines[:, 0] == _OUTPUT
    lines[is_output, 2] = places[lines[is_output, 2]]
    zeros = np.ones(starts[-1], dtype=bool)
    zeros[places] = False
    lines, values = _with_zeros(lines, values, np.flatnonzero(zeros))
    return Tape([x.numel() for x in inputs.values()], int(starts[-1]), lines, values)


def check(name: str, inputs: Mapping[str, ca.SX], expression: ca.SX) -> None:
    """Refuse an expression that :func:`record` would refuse."""
    function = _function(name, inputs, ca.vec(expression.nz[:]))
    _codes(name, function, _instructions(function))


def read(
    name: str, inputs: Mapping[str, ca.SX], column: ca.SX
) -> Iterator[tuple[str, int, list[int], float]]:
    """Take a dense column of expressions apart into elementary operations, in order.

    Parameters
    ----------
    name, inputs
        As for :func:`record`.
    column : SX
        The expressions.

    Yields
    ------
    operation : str
        "input", "const", "output", or the name of CasADi's operation.
    slot : int
        What it writes; of an output, its place in the column.
    reads : list of int
        The slots that it reads; of an input, the group and the place in it.
    value : float
        The constant.
    """
    function, names = _function(name, inputs, column), _names()
    code_of, outputs, reads = (_ask(function, what) for what in ("id", "output", "input"))
    for k in range(function.n_instructions()):
        code = code_of(k)
        slot = outputs(k)[1 if code == ca.OP_OUTPUT else 0]
        value = _constants(function, [k])[0] if code == ca.OP_CONST else 0.0
        yield names[code], slot, reads(k), value


def evaluate(operation: str, *values: float) -> float:
    """Apply CasADi's operation of this name to one or two numbers."""
    code = getattr(ca, f"OP_{operation.upper()}")
    apply = ca.DM.unary if len(values) == 1 else ca.DM.binary
    return float(apply(code, *(ca.DM(x) for x in values)))


@cache
def _names() -> dict[int, str]:
    """Return the names of CasADi's operations by their codes."""
    codes = {name: getattr(ca, name) for name in dir(ca) if name.startswith("OP_")}
    return {code: name.removeprefix("OP_").lower() for name, code in codes.items()}


def _function(
    name: str, inputs: Mapping[str, ca.SX], column: ca.SX, reuse: bool = True
) -> ca.Function:
    options = {"allow_free": True, "live_variables": reuse}
    function = ca.Function("tape", list(inputs.values()), [column], options)
    if function.has_free():
        free = ", ".join(sorted(str(x) for x in function.free_sx()))
        raise ValueError(f"{name} depends on symbols that are not its arguments: {free}")
    return function


def _ask(function: ca.Function, what: str) -> Callable[[int], Any]:
    """Return the function that tells something of an instruction, without CasADi's wrapper.

    Large systems have 10^5 instructions and more, and through the methods of the class each call
    takes three times as long.
    """
    pointer: Any = function.this  # type: ignore[attr-defined]
    return partial(getattr(ca.raw, f"Function_instruction_{what}"), pointer)


def _instructions(function: ca.Function) -> np.ndarray:
    """Return CasADi's code of each instruction."""
    count = function.n_instructions()
    return np.fromiter(map(_ask(function, "id"), range(count)), np.int64, count)


def _distinct(codes: np.ndarray) -> list[int]:
    return np.flatnonzero(np.bincount(codes)).tolist()


def _program(function: ca.Function) -> tuple[np.ndarray, np.ndarray]:
    """Flatten a function into the core's lines (code, slot, a, b), codes CasADi's, and values.

    Without reuse of slots, values and outputs are numbered one after another: CasADi need not be
    asked where each goes.
    """
    codes = _instructions(function)
    is_output = codes == ca.OP_OUTPUT
    lines = np.zeros((codes.size, 4), dtype=np.int64)
    lines[:, 0] = codes
    lines[:, 1] = np.cumsum(~is_output) - 1
    lines[is_output, 2] = np.arange(is_output.sum())
    values = np.zeros(codes.size)
    operands = _ask(function, "input")
    for code in _distinct(codes):
        at = np.flatnonzero(codes == code)
        places = at.tolist()
        if code == ca.OP_CONST:
            values[at] = _constants(function, places)
            continue
        first, count = 1 if code == ca.OP_OUTPUT else 2, len(operands(places[0]))
        found = np.fromiter(chain.from_iterable(map(operands, places)), np.int64, count * at.size)
        lines[at, first : first + count] = found.reshape(-1, count)
    return lines, values


def _constants(function: ca.Function, places: list[int]) -> list[float]:
    return list(map(_ask(function, "constant"), places))


def _codes(name: str, function: ca.Function, codes: np.ndarray) -> np.ndarray:
    """Return the core's codes for CasADi's, once each is seen to have a place on a tape."""
    found = np.empty_like(codes)
    for code in _distinct(codes):
        at = codes == code
        is_constant = code == ca.OP_CONST
        if is_constant and np.isnan(_constants(function, np.flatnonzero(at).tolist())).any():
            raise ValueError(
                hinted(
                    f"{name} contains the constant nan",
                    "on symbols use casadi's functions (ca.sin); math.sin makes them nan, as all "
                    "code for numbers does: lv.table(x, y) stands in for it by its values",
                )
            )
        found[at] = _operation(name, code)
    return found


def _operation(name: str, code: int) -> int:
    special = {ca.OP_INPUT: _INPUT, ca.OP_CONST: _CONSTANT, ca.OP_OUTPUT: _OUTPUT}
    if code in special:
        return special[code]
    operation = _names().get(code, str(code))
    if operation not in OPERATIONS:
        sentence = f"{name} uses the operation '{operation}', which has no place on a tape"
        raise ValueError(hinted(sentence, CALLED if operation == "call" else ELEMENTARY))
    return OPERATIONS[operation]


def _with_zeros(
    lines: np.ndarray, values: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Write zero to these outputs, from a slot of its own."""
    if places.size == 0:
        return lines, values
    slot = lines[:, 1].max(initial=-1) + 1
    more = np.zeros((1 + places.size, 4), dtype=np.int64)
    more[0] = _CONSTANT, slot, 0, 0
    more[1:, 0], more[1:, 1], more[1:, 2] = _OUTPUT, slot, places
    return np.vstack([lines, more]), np.concatenate([values, np.zeros(len(more))])
