"""Tapes as they run, for people to read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from liouville import _core

#: Of longer programs ``print`` shows so many lines at the start and at the end.
SHOWN = 200

#: Operations whose second operand is the number of a column.
LOOKUPS = ("search", "entry")

#: An operation's name, the register that it writes, and those that it reads.
Line = tuple[str, int, list[int]]


class Program:
    """A tape as it runs: ``print`` shows it, with registers by number and the rest by name.

    Attributes
    ----------
    name : str
        The name of the tape.
    inputs : tuple of str
        Its inputs, element by element.
    outputs : tuple of str
        Its outputs, element by element; of a part only those of the part.
    once : tuple of str
        What runs once a run, as it depends on parameters alone, an operation a line.
    each : tuple of str
        What every evaluation runs, in this order.
    terms : tuple of str
        Constants and products with sparse matrices that are added to the outputs after that.
    columns : tuple of ndarray
        The numbers of tables: ``search(x, columns[k])`` is how many of them are not above x,
        ``entry(i, columns[k])`` number i.
    """

    def __init__(
        self,
        name: str,
        tape: _core.Tape,
        inputs: Sequence[str],
        outputs: Sequence[str],
        part: range | None = None,
    ) -> None:
        constants, once, each = _core.listing(tape)
        first = len(inputs)
        if part is not None:
            needed = {first + k for k in part}
            each = _leading_to(each, needed)
            once = _leading_to(once, needed)
        names = dict(enumerate([*inputs, *outputs])) | {at: repr(x) for at, x in constants}
        self.name, self.inputs = name, tuple(inputs)
        self.outputs = tuple(outputs[k] for k in part or range(len(outputs)))
        self.once, self.each = _written(once, names), _written(each, names)
        self.terms = tuple(_terms(tape, inputs, outputs, part))
        columns = tape.__reduce__()[1][4]  # as it is pickled
        self.columns = tuple(column.__reduce__()[1][0] for column in columns)

    def __len__(self) -> int:
        """Return how many operations an evaluation runs."""
        return len(self.each)

    def __repr__(self) -> str:
        """Return the program in lines."""
        head = f"{self.name}: {len(self)} operations for {_joined(self.outputs)}"
        blocks = {"once a run:": self.once, "each time:": self.each, "and adds:": self.terms}
        lines = [head]
        for title, block in blocks.items():
            if block:
                lines += [f"  {title}", *(f"    {line}" for line in _cut(block))]
        return "\n".join(lines)


def elements(name: str, count: int) -> list[str]:
    """Name the elements of a vector: q[0], q[1]."""
    return [f"{name}[{k}]" for k in range(count)]


def parameters(defaults: Mapping[str, np.ndarray]) -> list[str]:
    """Name the elements of all parameters: params.g, params.m[0]."""
    found: list[str] = []
    for name, value in defaults.items():
        whole = f"params.{name}"
        found += elements(whole, len(value)) if value.ndim else [whole]
    return found


def _leading_to(lines: list[Line], needed: set[int]) -> list[Line]:
    """Return the lines that these registers come from; afterwards `needed` are those read."""
    found = []
    for line in reversed(lines):
        _, out, operands = line
        if out in needed:
            needed.discard(out)
            needed.update(operands)
            found.append(line)
    return found[::-1]


def _written(lines: Iterable[Line], names: Mapping[int, str]) -> tuple[str, ...]:
    def named(register: int) -> str:
        return names.get(register, f"r{register}")

    def written(operation: str, operands: Sequence[int]) -> str:
        if operation not in LOOKUPS:
            return ", ".join(map(named, operands))
        x, column = map(named, operands)
        return f"{x}, columns[{float(column):.0f}]"

    return tuple(
        f"{named(out)} = {operation}({written(operation, operands)})"
        for operation, out, operands in lines
    )


def _terms(
    tape: _core.Tape, inputs: Sequence[str], outputs: Sequence[str], part: range | None
) -> Iterable[str]:
    """Give what is added to the outputs of a program."""
    _, _, _, terms, _ = tape.__reduce__()[1]  # as it is pickled
    if terms is None:
        return
    constant, products, forms = terms
    wanted = part or range(len(outputs))
    for k in wanted:
        if len(constant) and constant[k]:
            yield f"{outputs[k]} += {float(constant[k])!r}"
    starts = [sum(tape.inputs[:group]) for group in range(len(tape.inputs))]
    for is_form, added in ((False, products), (True, forms)):
        for first, group, factor, matrix in added:
            rows, columns, row, *_ = matrix.__reduce__()[1]
            if not set(wanted).intersection(range(first, first + (1 if is_form else rows))):
                continue
            x = inputs[starts[group]].partition("[")[0]
            product = f"{x}^T A {x}" if is_form else f"A {x}"
            whose = outputs[first] if is_form else outputs[first].partition("[")[0]
            of_a = f"A {rows} by {columns} with {len(row)} entries"
            yield f"{whose} += {factor!r} * {product}, {of_a}"


def _joined(names: Sequence[str]) -> str:
    return ", ".join(names if len(names) <= 6 else (*names[:3], "...", names[-1]))


def _cut(lines: Sequence[str]) -> Sequence[str]:
    if len(lines) <= 2 * SHOWN:
        return lines
    left = len(lines) - 2 * SHOWN
    return (*lines[:SHOWN], f"... and {left} lines more ...", *lines[-SHOWN:])
