"""Functions of a model by cases, and the model on a branch of each of them.

``fabs``, a comparison, ``floor`` and the like have a number for the case that holds, their side:
of ``fabs(x)`` the sign of x, of ``x < y`` one or zero, of ``floor(x)`` its value. With the side
held, each is a smooth function of its operands, and so is the model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.mechanics.motion import kept
from liouville._systems.program import elements, parameters
from liouville._systems.tape import Lookup, applied, operations, read, record

if TYPE_CHECKING:
    from liouville._systems.fields.field import Field
    from liouville._systems.mechanics.general import Mechanics
    from liouville._systems.mechanics.semi_explicit import SemiExplicit
    from liouville._systems.tracing.expressions import Expressions, Symbols
    from liouville._systems.waves.sensitivity import DriveSensitivity

#: Longer expressions are shown by the name of their function alone.
LONGEST = 60

#: The side of each operation by cases, from its operands.
SIDES: dict[str, Callable[..., Any]] = {
    "fabs": lambda x: _way(x),
    "sign": lambda x: _way(x),
    "floor": lambda x: ca.floor(x),
    "ceil": lambda x: ca.ceil(x),
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "fmin": lambda x, y: x < y,
    "fmax": lambda x, y: x > y,
    "fmod": lambda x, y: _way(x / y) * ca.floor(ca.fabs(x / y)),
    "copysign": lambda x, y: _way(x) * _way(y),
    "atan2": lambda y, x: ca.if_else(x < 0, _way(y), 0),
}

#: The value of each on a side: those of comparisons, ``sign``, ``floor`` and ``ceil`` are the side.
VALUES: dict[str, Callable[..., Any]] = {
    "fabs": lambda side, x: side * x,
    "fmin": lambda side, x, y: ca.if_else(side, x, y),
    "fmax": lambda side, x, y: ca.if_else(side, x, y),
    "fmod": lambda side, x, y: x - side * y,
    "copysign": lambda side, x, y: side * x,
    "atan2": lambda side, y, x: (
        side * np.pi + ca.atan2(*((1 - 2 * side**2) * part for part in (y, x)))
    ),
}

#: Operations that are continuous, whatever stands in them.
CONTINUOUS = ("fabs", "fmin", "fmax")

#: Comparisons with larger numbers are never true: a table has one.
LARGEST = 1e300

#: Symbols of comparisons in messages.
WRITTEN = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}


@dataclass(frozen=True)
class Branches:
    """The functions by cases of a system.

    Tapes take w: the time, the states, all multipliers of the user's and the parameters.

    Attributes
    ----------
    names : tuple of str
        The functions, in the user's names.
    may_jump : ndarray of bool
        Which of them are not continuous by themselves.
    sides : Tape
        Their sides at w.
    values : Tape
        What the equations consist of at w, with sides held.
    slopes : Tape
        The derivative of that at w along a direction, with sides held.
    switches : Tape
        The functions at whose zeros controlled steps end, at w.
    """

    names: tuple[str, ...]
    may_jump: np.ndarray
    sides: _core.Tape
    values: _core.Tape
    slopes: _core.Tape
    switches: _core.Tape


def branches(system: Mechanics | SemiExplicit | Field | DriveSensitivity) -> Branches | None:
    """Return the functions by cases of a system, None where it has none."""
    return kept(system, "branches", lambda: _branches(system.expressions))


def _branches(expressions: Expressions | None) -> Branches | None:
    if expressions is None:
        return None
    # imported here, as it names the symbols of expressions by these
    from liouville._systems.mechanics.traced import INVARIANT, SWITCH

    *states, params = expressions.symbols.all
    multipliers = ca.vertcat(ca.SX(0, 1), *expressions.more.values())
    columns, others = expressions.columns, (INVARIANT, SWITCH, "power")
    equations = [x for name, x in columns.items() if not name.startswith(others)]
    column = ca.vertcat(ca.SX(0, 1), *(ca.densify(x) for x in equations))
    inputs = {"w": ca.vertcat(*states, multipliers, params), "params": ca.SX(0, 1)}
    if not operations("equations", inputs, column).intersection(SIDES):
        return None
    names = _names(expressions.symbols, multipliers.numel())
    symbols = ca.vertcat(*(ca.SX.sym(name) for name in names))
    model, found = _by_cases(symbols, read("equations", inputs, column), column.numel())
    if not found:
        return None
    side, along = ca.vertcat(*(x.held for x in found)), ca.SX.sym("along", symbols.numel())
    at, none = {"w": symbols, "side": side}, {"params": ca.SX(0, 1)}
    switches = [x for name, x in columns.items() if name.startswith(SWITCH)]
    return Branches(
        tuple(x.name for x in found),
        np.array([x.operation not in CONTINUOUS for x in found]),
        record("sides", {"w": symbols, **none}, *(x.side for x in found)),
        record("values", {**at, **none}, model),
        record("slopes", {**at, "along": along, **none}, ca.jtimes(model, symbols, along)),
        record("switches", inputs, ca.vertcat(ca.SX(0, 1), *switches)),
    )


@dataclass(frozen=True)
class _Case:
    """A function by cases: its operation and name, its side, and the symbol of that held."""

    operation: str
    name: str
    side: ca.SX
    held: ca.SX


def _by_cases(
    symbols: ca.SX, operations: Iterator[tuple[str, int, list[int], float]], size: int
) -> tuple[ca.SX, list[_Case]]:
    """Return the expressions of operations with all sides held, and their functions by cases."""
    found: list[_Case] = []
    as_is, held, out = dict[int, ca.SX](), dict[int, ca.SX](), dict[int, ca.SX]()
    looked_up, constants = set[int](), dict[int, float]()  # by slots
    for operation, slot, reads, value in operations:
        if operation == "output":
            out[slot] = held[reads[0]]
            continue
        # numbers of a table are whole, and its floor has no cases
        is_case = operation in SIDES and not looked_up.intersection(reads)
        never = operation in WRITTEN and any(abs(constants.get(k, 0.0)) > LARGEST for k in reads)
        looked_up.discard(slot)
        constants.pop(slot, None)
        if operation == "input":
            as_is[slot] = held[slot] = symbols[reads[1]]
        elif operation == "const":
            as_is[slot] = held[slot] = ca.SX(value)
            constants[slot] = value
        else:
            operands, on_side = ([each[k] for k in reads] for each in (as_is, held))
            as_is[slot] = applied(operation, *operands)
            held[slot] = applied(operation, *on_side)
            if is_case and not never:
                side = SIDES[operation](*operands)
                own = _Case(operation, _written(operation, operands), side, ca.SX.sym("side"))
                held[slot] = (
                    VALUES[operation](own.held, *on_side) if operation in VALUES else own.held
                )
                found.append(own)
        if isinstance(operation, Lookup):
            looked_up.add(slot)
    return ca.vertcat(*(out[k] for k in range(size))), found


def _way(x: ca.SX) -> ca.SX:
    """Return one where x is not negative, else minus one."""
    return 2 * (x >= 0) - 1


def _names(symbols: Symbols, multipliers: int) -> list[str]:
    """Return names of the elements of w."""
    _, *vectors, _ = symbols.args.items()
    states = [x for name, vector in vectors for x in elements(name, vector.numel())]
    return ["t", *states, *elements("lam", multipliers), *parameters(symbols.params.defaults)]


def _written(operation: str, operands: list[ca.SX]) -> str:
    """Write an operation down, in short where its operands are long."""
    each = [str(x) for x in operands]
    if any("@" in x for x in each) or sum(map(len, each)) > LONGEST:
        each = ["..."] * len(each)
    if operation in WRITTEN:
        return f" {WRITTEN[operation]} ".join(each)
    # CasADi writes a sum in brackets
    inner = (x[1:-1] if x.startswith("(") and x.endswith(")") else x for x in each)
    return f"{operation}({', '.join(inner)})"
