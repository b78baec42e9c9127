"""How methods are written."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any


class Brief:
    """A base of methods whose repr leaves out what is as by default, but for a first number."""

    def __repr__(self) -> str:
        """Name what is not as by default."""
        own: list[Any] = [*fields(self)]  # type: ignore[arg-type]
        values = {x.name: getattr(self, x.name) for x in own}
        first = own[0].name if own and isinstance(values[own[0].name], int | float) else ""
        shown = [
            f"{x.name}={values[x.name]!r}"
            for x in own
            if x.repr and (x.name == first or x.default is MISSING or values[x.name] != x.default)
        ]
        return f"{type(self).__name__}({', '.join(shown)})"
