"""The base of all plans: a method with nothing left to choose, and why."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from liouville._basics import checksum, html, schema
from liouville._basics.errors import hinted
from liouville._methods import METHODS, Method

#: The hint where a plan does not fit.
AGAIN = "make one for this run with lv.plan(...)"

#: The key of an array in a file.
ARRAY = "array"

#: What fields of plans hold, by what they are declared as.
KINDS = {
    "int": schema.integers(0),
    "float": schema.NUMBER,
    "str": schema.TEXT,
    "float | None": schema.either(schema.NUMBER, schema.one_of(None)),
    "tuple[str, ...]": schema.lists(schema.TEXT),
    "tuple[int, ...]": schema.lists(schema.integers(0)),
    "tuple[float, ...]": schema.lists(schema.NUMBER),
    "tuple[float, float]": schema.BOUNDS,
    "tuple[int, int]": schema.rows(schema.integers(0), schema.integers(0)),
    "tuple[tuple[float, int], ...]": schema.lists(schema.rows(schema.NUMBER, schema.integers(1))),
    "np.ndarray": schema.Kind(
        "an array of numbers", lambda x: isinstance(x, np.ndarray) and bool(np.isfinite(x).all())
    ),
}


@dataclass(frozen=True, repr=False)
class Plan(ABC):
    """A method with nothing left to choose, and why.

    :func:`liouville.plan` makes it, :func:`liouville.integrate` takes it as a method, and ``print``
    explains it. Of a polynomial field it is a :class:`FieldPlan`, of a Schrödinger equation a
    :class:`WavePlan`.

    Attributes
    ----------
    method : Method
        The method that it carries out.
    reasons : tuple of str
        Why, and what else there was.
    """

    form: ClassVar[str]
    method: Method
    reasons: tuple[str, ...]

    @abstractmethod
    def _lines(self) -> list[str]:
        """Return the explanation, line by line."""

    def __str__(self) -> str:
        """Explain the plan."""
        return "\n".join(self._lines())

    def _repr_html_(self) -> str:
        """Show the explanation in a notebook."""
        return html.text(repr(self), str(self))

    @property
    def _why(self) -> list[str]:
        return ["why", *(f"  {reason}" for reason in self.reasons)]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan to a JSON file, for :meth:`load`: all digits, and a checksum.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        found = {"form": self.form, **_encoded(asdict(self)), "method": written(self.method)}
        Path(path).write_text(checksum.signed(found), encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return a plan that :meth:`save` wrote.

        Raises
        ------
        FileNotFoundError
            There is no such file.
        ValueError
            The file is no plan, one of another kind of system, or not as it was saved.
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"there is no plan file {str(path)!r}")
        kinds: dict[str, type[Self]] = {
            kind.form: kind for kind in (cls, *cls.__subclasses__()) if hasattr(kind, "form")
        }
        try:
            given = checksum.verified(Path(path))
            form = given.pop("form")
            if form not in kinds:
                raise ValueError(f"its form must be {' or '.join(kinds)}, not {form!r}")
            given["method"] = read_method(given["method"])
            return kinds[form]._read(given)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            why = f"{error} is missing" if isinstance(error, KeyError) else error
            message = f"{str(path)!r} is no plan that liouville saved: {why}"
            raise ValueError(hinted(message, "lv.plan(...).save(path) writes one")) from error

    @classmethod
    @abstractmethod
    def _read(cls, given: dict[str, Any]) -> Self:
        """Make a plan of what a file holds; an error states why there is none."""


def written(method: Any) -> dict[str, Any]:
    """Return a method by its name and its numbers."""
    name = next(name for name, kind in METHODS.items() if type(method) is kind)
    return {"name": name, **asdict(method)}


def read_method(given: Any) -> Method:
    """Make a method from its name and its numbers."""
    if not isinstance(given, dict):
        raise TypeError("its method is none")
    numbers = dict(given)
    return METHODS[numbers.pop("name")](**numbers)


def _encoded(value: Any) -> Any:
    """Return plain values, arrays marked as such."""
    if isinstance(value, np.ndarray):
        return {ARRAY: value.tolist()}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {name: _encoded(x) for name, x in value.items()}
    return [_encoded(x) for x in value] if isinstance(value, list | tuple) else value


def decoded(value: Any) -> Any:
    """Return the content of a file with arrays decoded, and tuples for lists."""
    if isinstance(value, dict) and set(value) == {ARRAY}:
        return np.array(value[ARRAY], dtype=float)
    if isinstance(value, dict):
        return {name: decoded(x) for name, x in value.items()}
    return tuple(decoded(x) for x in value) if isinstance(value, list) else value


def check_fields(of: Any) -> None:
    """Refuse a plan, or a part of one, whose fields are not what they are declared as."""
    for each in fields(of):
        if each.type in KINDS:
            schema.checked(getattr(of, each.name), KINDS[str(each.type)], f"its {each.name}")
