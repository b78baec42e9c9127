"""A function of time and place as one of functions of the time and of functions of the place.

A potential :math:`V(t, x) = F(g(t), u(x))` takes g once a time, and u once a point.
"""

from __future__ import annotations

from dataclasses import dataclass

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.tape import applied, read, record

#: With more functions of the place than these the coordinates themselves are taken.
MOST = 8

#: What a value depends on: nothing but parameters, the time, the place, or both.
NOTHING, TIME, PLACE, BOTH = range(4)


@dataclass(frozen=True)
class Parted:
    """The tapes of a function of time and place.

    Attributes
    ----------
    of_time : Tape
        g, of t and parameters.
    of_place : Tape
        u, of x and parameters.
    both : Tape
        F, of g, u and parameters.
    """

    of_time: _core.Tape
    of_place: _core.Tape
    both: _core.Tape


def parted(what: str, inputs: dict[str, ca.SX], expression: ca.SX) -> Parted:
    """Take an expression of the time, the point and parameters apart.

    Parameters
    ----------
    what : str
        Its name in messages.
    inputs : dict of str to SX
        The symbols of the time, of the point, and of the parameters.
    expression : SX
        The value.
    """
    t, x, params = inputs.values()
    found = _Walk(what, inputs, expression, kind=PLACE)
    if len(found.taken[PLACE]) > MOST:
        found = _Walk(what, inputs, expression, kind=BOTH)
        found.taken[PLACE] = [(each, each) for each in ca.vertsplit(x)]
    times = found.taken[TIME] or [(t, ca.SX.sym("g"))]
    places = found.taken[PLACE] or [(x[0], ca.SX.sym("u"))]
    g, u = (ca.vertcat(*(symbol for _, symbol in each)) for each in (times, places))
    own, of_place = (ca.vertcat(*(value for value, _ in each)) for each in (times, places))
    return Parted(
        record(what, {"t": t, "params": params}, own),
        record(what, {"x": x, "params": params}, of_place),
        record(what, {"g": g, "u": u, "params": params}, found.value),
    )


class _Walk:
    """Operations of an expression one after another: largest parts of the time or the place alone.

    Attributes
    ----------
    taken : dict of int to list of (SX, SX)
        Such parts of each kind and the symbols in their place.
    value : SX
        The expression of these symbols.
    """

    def __init__(self, what: str, inputs: dict[str, ca.SX], expression: ca.SX, kind: int) -> None:
        self.taken: dict[int, list[tuple[ca.SX, ca.SX]]] = {TIME: [], PLACE: []}
        self.symbols: dict[int, ca.SX] = {}
        groups = [*inputs.values()]
        kinds = (TIME, kind, NOTHING)
        slots: dict[int, tuple[int, ca.SX]] = {}
        for operation, slot, reads, constant in read(what, inputs, ca.densify(expression)):
            if operation == "input":
                slots[slot] = kinds[reads[0]], groups[reads[0]][reads[1]]
            elif operation == "const":
                slots[slot] = NOTHING, ca.SX(constant)
            elif operation == "output":
                self.value = self._in_both(slots[reads[0]])
            else:
                args = [slots[each] for each in reads]
                own = NOTHING
                for each, _ in args:
                    own |= each
                values = [self._in_both(arg) if own == BOTH else arg[1] for arg in args]
                slots[slot] = own, applied(operation, *values)

    def _in_both(self, part: tuple[int, ca.SX]) -> ca.SX:
        """Return a part of what depends on both: a symbol for one of the time or place alone."""
        kind, value = part
        if kind in (NOTHING, BOTH):
            return value
        key = id(value)
        if key not in self.symbols:
            self.symbols[key] = ca.SX.sym("gu"[kind - TIME])
            self.taken[kind].append((value, self.symbols[key]))
        return self.symbols[key]
