"""The expressions of a mechanical system, and how they travel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from liouville.systems import _trace
from liouville.systems._form import Model, Nonholonomic, Symbols
from liouville.systems._linear import Linear
from liouville.systems._recorded import recorded
from liouville.systems._travel import Travels, opened, packed


@dataclass(frozen=True)
class Traced:
    """A model, what is recorded along a run, and the power of the forces without a potential."""

    symbols: Symbols
    model: Model
    invariants: dict[str, ca.SX]
    power: ca.SX | None

    def packed(self) -> Packed:
        """Return what makes them again."""
        s, model, own = self.symbols, self.model, self.model.nonholonomic
        symbols = [s.t, s.y, s.z, model.lam, own.nu, s.params.vector]
        expressions = [model.v, model.p, model.f, model.r, model.g, own.k, own.rn]
        expressions += [] if self.power is None else [self.power]
        return Packed(
            packed(symbols, [*expressions, *self.invariants.values()]),
            [x.numel() for x in symbols[1:-1]], s.params, tuple(self.invariants),
            self.power is not None, model.linear, model.is_ideal,
        )  # fmt: skip


@dataclass(frozen=True)
class Packed:
    """The expressions of a system on their way: a function, and what is no expression."""

    function: str
    sizes: list[int]
    params: _trace.Parameters
    invariants: tuple[str, ...]
    has_power: bool
    linear: Linear
    is_ideal: bool

    def opened(self) -> Traced:
        """Return the expressions, of new symbols."""
        names = ("y", "z", "lam", "nu")
        y, z, lam, nu = (ca.SX.sym(x, n) for x, n in zip(names, self.sizes, strict=True))
        s = Symbols(ca.SX.sym("t"), y, z, self.params)
        found = opened(self.function, [s.t, y, z, lam, nu, self.params.vector])
        v, p, f, r, g, k, rn, *rest = found
        power = rest.pop(0) if self.has_power else None
        own = Nonholonomic(k, rn, nu)
        model = Model(v, p, f, r, g, lam, own, self.linear, self.is_ideal)
        return Traced(s, model, dict(zip(self.invariants, rest, strict=True)), power)


class Expressed(Travels):
    """What has expressions; where it has travelled, they are read when they are first wanted."""

    _packed: Packed

    @cached_property
    def _traced(self) -> Traced:
        return self._packed.opened()

    @property
    def _symbols(self) -> Symbols:
        return self._traced.symbols

    @property
    def _model(self) -> Model:
        return self._traced.model

    def portable(self, observe: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return what is to be observed in a form that travels."""
        s = self._symbols
        return recorded(observe, (s.t, s.y, s.z, s.params))

    def _luggage(self) -> dict[str, Any]:
        if "_packed" not in self.__dict__:
            self._packed = self._traced.packed()
        return {name: x for name, x in self.__dict__.items() if name != "_traced"}
