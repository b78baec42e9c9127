"""Factors of a field that are no polynomials: expressions as they stand, and their tapes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from liouville._basics import casadi as ca
from liouville._systems import tape
from liouville._systems.fields.terms import Function

#: An expression as a tree: ("variable", place), ("const", number), or an operation by CasADi's name
#: and its operands. What an expression has twice is the same object.
Node: TypeAlias = tuple[Any, ...]

Found = TypeVar("Found")

#: Longer functions are written as f(x, y).
LONGEST = 40

#: Operations that have cases: they are not multiplied out.
BY_CASES = frozenset(
    ("lt", "le", "eq", "ne", "not", "and", "or", "if_else_zero", "sign", "fabs", "copysign")
) | {"floor", "ceil", "fmod", "fmin", "fmax"}


def is_case(operation: str) -> bool:
    """Whether an operation has cases, as a table has."""
    return operation in BY_CASES or isinstance(operation, tape.Lookup)


@dataclass(frozen=True)
class Opaque:
    """A function met in an expression.

    Attributes
    ----------
    places : tuple of int
        The variables that it depends on.
    key : Any
        Equal for equal functions.
    node : tuple
        The function as it stands.
    text : str
        In the user's names; empty where it is made of cases.
    reason : str
        Why it is no polynomial.
    is_by_cases : bool
        Whether it has cases, as a table has.
    """

    places: tuple[int, ...]
    key: Any
    node: Node
    text: str
    reason: str
    is_by_cases: bool

    def written(self, names: Sequence[str]) -> str:
        """Write the function in the user's names."""
        if 0 < len(self.text) <= LONGEST:
            return self.text
        return f"f({', '.join(names[place] for place in self.places)})"

    def recorded(self, names: Sequence[str]) -> Function:
        """Record the function, its partial derivatives, and what vanishes where it is singular."""
        symbols = {place: ca.SX.sym(names[place]) for place in self.places}
        x = ca.vertcat(*symbols.values())

        def made(node: Node, operands: list[ca.SX]) -> ca.SX:
            if node[0] == "variable":
                return symbols[node[1]]
            return ca.SX(node[1]) if node[0] == "const" else tape.applied(node[0], *operands)

        guarded = {id(guard): guard for node in _each(self.node) for guard in _guards(node)}
        own = _folded(self.node, made)
        vanishing = ca.vertcat(ca.SX(0, 1), *(_folded(guard, made) for guard in guarded.values()))
        inputs = {"x": x, "params": ca.SX(0, 1)}
        text = self.written(names)
        columns = (own, ca.densify(ca.jacobian(own, x)), vanishing)
        value, slopes, guards = (tape.record(text, inputs, column) for column in columns)
        return Function(self.places, self.key, text, value, slopes, guards)


def _folded(root: Node, made: Callable[[Node, list[Found]], Found]) -> Found:
    """Make something of an expression from what was made of its operands, each once."""
    done: dict[int, Found] = {}
    for node in _each(root):
        operands = [] if node[0] in ("variable", "const") else [done[id(x)] for x in node[1:]]
        done[id(node)] = made(node, operands)
    return done[id(root)]


def _each(root: Node) -> Iterator[Node]:
    """Return the parts of an expression, operands first, each once."""
    seen: set[int] = set()
    stack = [(root, False)]
    while stack:
        node, is_ready = stack.pop()
        if is_ready:
            yield node
        elif id(node) not in seen:
            seen.add(id(node))
            stack.append((node, True))
            if node[0] not in ("variable", "const"):
                stack.extend((operand, False) for operand in node[1:])


def _guards(node: Node) -> Iterator[Node]:
    """Return expressions that change their sign only where an operation is singular."""
    operation, *operands = node
    if operation in ("div", "inv"):
        yield from _factors(operands[-1])
    elif operation == "log":
        yield operands[0]
    elif operation == "tan":
        yield ("cos", operands[0])
    elif operation in ("pow", "constpow") and operands[1][0] == "const" and operands[1][1] < 0:
        yield from _factors(operands[0])


def _factors(node: Node) -> Iterator[Node]:
    """Return the factors of an expression, without even powers."""
    operation, *operands = node
    if operation in ("mul", "sq", "sqrt", "neg", "twice", "fabs", "pow", "constpow"):
        for operand in operands if operation == "mul" else operands[:1]:
            yield from _factors(operand)
    elif operation != "const":
        yield node
