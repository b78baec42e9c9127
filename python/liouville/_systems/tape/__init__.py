"""CasADi functions as tapes; the only folder with CasADi's instruction codes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, repeat
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._core import OPERATIONS, Column, Tape
from liouville._systems.tape.lookups import LOOKUP, columns_of
from liouville._systems.tape.lookups import Lookup as Lookup

_INPUT, _CONSTANT, _OUTPUT = -1, -2, -3

#: The hint where an expression has another operation than those of a tape.
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
    minus : (Part, ndarray) or None
        Instead of the expressions, another part of the tape and the order in which these are the
        negatives of its own.
    """

    values: ca.SX
    places: np.ndarray
    size: int
    minus: tuple[Part, np.ndarray] | None = None

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
    lines[:, 0] = _codes(name, function, lines[:, 0], values)
    starts = np.cumsum([0, *(part.size for part in parts)])
    places = np.concatenate(
        [
            np.empty(0, dtype=np.int64),
            *(x.places + at for x, at in zip(parts, starts, strict=False)),
        ]
    )
    own = [np.full(x.places.size, x.minus is None) for x in parts]
    traced = np.concatenate([np.empty(0, dtype=bool), *own])
    zeros = np.ones(starts[-1], dtype=bool)
    zeros[places] = False
    is_output = lines[:, 0] == _OUTPUT
    order = lines[is_output, 2]
    slots = np.empty(order.size, dtype=np.int64)
    slots[order] = lines[is_output, 1]
    lines[is_output, 2] = places[traced][order]
    lines, values = _with_negatives(lines, values, slots[_negatives(parts)], places[~traced])
    lines, values = _with_zeros(lines, values, np.flatnonzero(zeros))
    lines, values, columns = _with_columns(function, lines, values)
    return Tape([x.numel() for x in inputs.values()], int(starts[-1]), lines, values, columns)


def check(name: str, inputs: Mapping[str, ca.SX], expression: ca.SX) -> None:
    """Refuse an expression that :func:`record` would refuse."""
    function = _function(name, inputs, ca.vec(expression.nz[:]))
    codes = _instructions(function)
    _codes(name, function, codes, _constants_of(function, codes))


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
        "input", "const", "output", the name of CasADi's operation, or a :class:`Lookup`.
    slot : int
        What it writes; of an output, its place in the column.
    reads : list of int
        The slots that it reads; of an input, the group and the place in it.
    value : float
        The constant.
    """
    function, names = _function(name, inputs, column), _names()
    code_of, outputs, reads = (_ask(function, what) for what in ("id", "output", "input"))
    called = {k: Lookup.of(f) for k, f in _called(function, _instructions(function)).items()}
    for k in range(function.n_instructions()):
        code = code_of(k)
        slot = outputs(k)[1 if code == ca.OP_OUTPUT else 0]
        value = _constants(function, [k])[0] if code == ca.OP_CONST else 0.0
        yield called.get(k, names[code]), slot, reads(k), value


def operations(name: str, inputs: Mapping[str, ca.SX], column: ca.SX) -> set[str]:
    """Return the names of CasADi's operations in a dense column of expressions."""
    codes = _instructions(_function(name, inputs, column))
    return {_names()[code] for code in _distinct(codes)}


def evaluate(operation: str, *values: float) -> float:
    """Apply CasADi's operation of this name to one or two numbers."""
    if isinstance(operation, Lookup):
        return float(operation.function(*values))
    code = getattr(ca, f"OP_{operation.upper()}")
    apply = ca.DM.unary if len(values) == 1 else ca.DM.binary
    return float(apply(code, *(ca.DM(x) for x in values)))


def applied(operation: str, *args: ca.SX) -> ca.SX:
    """Apply CasADi's operation of this name to one or two expressions."""
    if isinstance(operation, Lookup):
        called: ca.SX = operation.function.call([*args], False, True)[0]
        return called
    code = getattr(ca, f"OP_{operation.upper()}")
    return (ca.SX.unary if len(args) == 1 else ca.SX.binary)(code, *args)


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


def _ask(function: ca.Function, what: str) -> partial[Any]:
    """Return a query of an instruction, without CasADi's wrapper.

    Large systems have 10^5 instructions and more, and through the methods of the class each call
    takes three times as long.
    """
    pointer: Any = function.this  # type: ignore[attr-defined]
    return partial(getattr(ca.raw, f"Function_instruction_{what}"), pointer)


def _each(function: ca.Function, what: str, places: Iterable[int]) -> Iterator[Any]:
    """Ask something of many instructions."""
    asked = _ask(function, what)
    return map(asked.func, repeat(*asked.args), places)


def _instructions(function: ca.Function) -> np.ndarray:
    """Return CasADi's code of each instruction."""
    count = function.n_instructions()
    return np.fromiter(_each(function, "id", range(count)), np.int64, count)


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
    for code in _distinct(codes):
        at = np.flatnonzero(codes == code)
        places = at.tolist()
        if code == ca.OP_CONST:
            continue
        first, count = 1 if code == ca.OP_OUTPUT else 2, len(_ask(function, "input")(places[0]))
        operands = chain.from_iterable(_each(function, "input", places))
        found = np.fromiter(operands, np.int64, count * at.size)
        lines[at, first : first + count] = found.reshape(-1, count)
    return lines, _constants_of(function, codes)


def _constants(function: ca.Function, places: list[int]) -> list[float]:
    return list(_each(function, "constant", places))


def _constants_of(function: ca.Function, codes: np.ndarray) -> np.ndarray:
    """Return the constants of instructions with these codes, zero of all others."""
    values, at = np.zeros(codes.size), np.flatnonzero(codes == ca.OP_CONST)
    values[at] = _constants(function, at.tolist())
    return values


def _called(function: ca.Function, codes: np.ndarray) -> dict[int, ca.Function]:
    """Return the functions that instructions with these codes call."""
    at = np.flatnonzero(codes == ca.OP_CALL).tolist()
    nodes: Any = function.instructions_sx().nz if at else []
    return {k: nodes[k].which_function() for k in at}


def _with_columns(
    function: ca.Function, lines: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[Column]]:
    """Let calls find pieces, and what CasADi's floor is applied to look up their numbers."""
    search, entry, floor = (OPERATIONS[name] for name in ("search", "entry", "floor"))
    calls = _called(function, np.where(lines[:, 0] == search, ca.OP_CALL, 0))
    if not calls:
        return lines, values, []
    first, columns, slots = lines[:, 1].max() + 1, dict[Column, int](), dict[int, int]()
    for at, lookup in calls.items():
        starts, column = columns_of(lookup)
        held = [x for x in (starts, column) if x is not None]
        own = [first + columns.setdefault(x, len(columns)) for x in held]
        slots[lines[at, 1]] = own[-1]
        if starts is None:  # the place is there, a whole number
            lines[at, 0] = floor
        else:
            lines[at, 3] = own[0]
    is_looked_up = (lines[:, 0] == floor) & np.isin(lines[:, 2], [*slots])
    for at in np.flatnonzero(is_looked_up).tolist():
        lines[at, 0], lines[at, 3] = entry, slots[lines[at, 2]]
    numbers = np.zeros((len(columns), 4), dtype=np.int64)
    numbers[:, 0], numbers[:, 1] = _CONSTANT, first + np.arange(len(columns))
    values = np.concatenate([np.arange(len(columns), dtype=float), values])
    return np.vstack([numbers, lines]), values, [*columns]


def _codes(name: str, function: ca.Function, codes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the core's codes for CasADi's, once each is seen to have a place on a tape."""
    found = np.empty_like(codes)
    called = {f.name() for f in _called(function, codes).values()}
    for code in _distinct(codes):
        at = codes == code
        if code == ca.OP_CONST and np.isnan(values[at]).any():
            raise ValueError(
                hinted(
                    f"{name} contains the constant nan",
                    "on symbols use casadi's functions (ca.sin); math.sin makes them nan, as all "
                    "code for numbers does: lv.table(x, y) stands in for it by its values",
                )
            )
        is_lookup = code == ca.OP_CALL and all(of.startswith(LOOKUP) for of in called)
        found[at] = OPERATIONS["search"] if is_lookup else _operation(name, code)
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


def _negatives(parts: Sequence[Part]) -> np.ndarray:
    """Return the expressions, by their place in the column, that negatives are of."""
    traced = [part for part in parts if part.minus is None]
    starts = np.cumsum([0, *(part.places.size for part in traced)])
    found = [np.empty(0, dtype=np.int64)]
    for part in parts:
        if part.minus is not None:
            other, order = part.minus
            at = next(k for k, own in enumerate(traced) if own is other)
            found.append(starts[at] + order)
    return np.concatenate(found)


def _with_negatives(
    lines: np.ndarray, values: np.ndarray, slots: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Write the negatives of slots to outputs, as CasADi does: those of constants are constants.

    A negative of a negative is what that is of.
    """
    if places.size == 0:
        return lines, values
    makers = np.flatnonzero(lines[:, 0] != _OUTPUT)[slots]
    first = lines[:, 1].max(initial=-1) + 1
    count, minus = slots.size, OPERATIONS["neg"]
    is_constant, is_minus = (lines[makers, 0] == code for code in (_CONSTANT, minus))
    more = np.zeros((2 * count, 4), dtype=np.int64)
    made, written = more[:count], more[count:]
    made[:, 0] = np.where(is_constant, _CONSTANT, minus)
    made[:, 1] = first + np.arange(count)
    made[:, 2] = np.where(is_constant, 0, slots)
    written[:, 0], written[:, 2] = _OUTPUT, places
    written[:, 1] = np.where(is_minus, lines[makers, 2], made[:, 1])
    constants = np.where(is_constant, 0.0 - values[makers], 0.0)  # zero has no sign
    keep = np.append(~is_minus, np.ones(count, dtype=bool))
    more_values = np.append(constants, np.zeros(count))
    return np.vstack([lines, more[keep]]), np.append(values, more_values[keep])


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
