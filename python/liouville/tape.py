"""CasADi functions as tapes; this file alone knows CasADi's instruction codes."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from liouville._core import OPERATIONS, Tape
from liouville.errors import hinted

_INPUT, _CONSTANT, _OUTPUT = -1, -2, -3
_NAMES: dict[int, str] = {
    code: name.removeprefix("OP_").lower()
    for name, code in vars(ca).items()
    if name.startswith("OP_") and isinstance(code, int)
}


def record(name: str, inputs: Mapping[str, ca.SX], *outputs: ca.SX, dense: bool = True) -> Tape:
    """Record expressions as one tape, what they have in common once.

    Parameters
    ----------
    name : str
        What the tape is called in messages.
    inputs : mapping of str to SX
        The input groups in order; the last is the parameters.
    *outputs : SX
        Expressions whose values follow one another, column by column.
    dense : bool, default True
        Whether structural zeros of the outputs are values too.

    Returns
    -------
    Tape

    Raises
    ------
    ValueError
        An expression has an operation that is not on the tape, a symbol that is not an input, or
        the constant NaN.
    """
    columns = [ca.vec(ca.densify(x)) if dense else ca.vec(x.nz[:]) for x in outputs]
    column = ca.cse(ca.vertcat(*columns))
    function = ca.Function("tape", list(inputs.values()), [column], {"allow_free": True})
    if function.has_free():
        free = ", ".join(sorted(str(x) for x in function.free_sx()))
        raise ValueError(f"{name} depends on symbols that are not its arguments: {free}")
    lines, values = _program(name, function)
    if np.isnan(values).any():
        raise ValueError(
            hinted(
                f"{name} contains the constant nan",
                "on symbols use casadi's functions (ca.sin); math.sin makes them nan",
            )
        )
    return Tape([x.numel() for x in inputs.values()], column.numel(), lines, values)


def _program(name: str, function: ca.Function) -> tuple[np.ndarray, np.ndarray]:
    """Flatten a function into the core's lines (code, slot, a, b) and their values."""
    count = function.n_instructions()
    lines = np.zeros((count, 4), dtype=np.int64)
    values = np.zeros(count)
    for k in range(count):
        code = function.instruction_id(k)
        if code == ca.OP_INPUT:
            lines[k] = (_INPUT, *function.instruction_output(k), *function.instruction_input(k))
        elif code == ca.OP_CONST:
            lines[k, :2] = (_CONSTANT, *function.instruction_output(k))
            values[k] = function.instruction_constant(k)
        elif code == ca.OP_OUTPUT:
            (slot,), (_, element) = function.instruction_input(k), function.instruction_output(k)
            lines[k, :3] = (_OUTPUT, slot, element)
        else:
            operands = function.instruction_input(k)
            (slot,) = function.instruction_output(k)
            lines[k, : 2 + len(operands)] = (_operation(name, code), slot, *operands)
    return lines, values


def _operation(name: str, code: int) -> int:
    operation = _NAMES.get(code, str(code))
    if operation not in OPERATIONS:
        raise ValueError(f"{name} uses the operation '{operation}', which has no place on a tape")
    return OPERATIONS[operation]
