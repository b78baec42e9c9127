"""The options of the commands: those of the methods come from their fields."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import typer

import liouville as lv
from liouville import _systems as systems
from liouville import problems
from liouville._methods import METHODS
from liouville._methods.planner.waves.choice import AUTO
from liouville._runs.choice import named

Model = Annotated[
    str,
    typer.Argument(
        help="A problem's name, or MODEL.PY:SYSTEM.",
        show_default=False,
        autocompletion=lambda: [*problems.names()],
    ),
]
Method = Annotated[
    str | None,
    typer.Option(
        help="One of 'liouville methods', or auto.",
        autocompletion=lambda: ["auto", *METHODS],
        show_default="spark, volume-splitting of a field, schrodinger-splitting of a wave function",
    ),
]
Until = Annotated[float | None, typer.Option(help="End time.", show_default="the model's own")]
Step = Annotated[float | None, typer.Option(help="Step size.", show_default="the model's")]
Keep = Annotated[int, typer.Option(help="Keep so many wave functions, at equal distances.", min=1)]
Start = Annotated[
    list[str] | None,
    typer.Option(help="Start value, as q=1,0 or psi=1,0.5j; may be repeated."),
]
Param = Annotated[list[str] | None, typer.Option(help="Parameter, as m=2.0; may be repeated.")]
PlanFile = Annotated[
    Path | None,
    typer.Option("--plan", help="Go by a plan that 'liouville plan' saved."),
]


def method_options(function: Callable[..., None]) -> Callable[..., None]:
    """Give a command with ``**options`` one option for each field of each method."""
    found: dict[str, tuple[Any, list[str]]] = {}
    for name, method in METHODS.items():
        for item in fields(method):
            kind = get_type_hints(method)[item.name]
            text = f"{item.metadata.get('help', '')} ({name}{default_of(item)})"
            found.setdefault(item.name, (kind, []))[1].append(text)
    signature = inspect.signature(function, eval_str=True)
    parameters = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    for name, (kind, texts) in found.items():
        option = typer.Option(
            help="; ".join(texts), show_default=False, rich_help_panel="Method options"
        )
        parameters.append(
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=None,
                annotation=Annotated[_plain(kind) | None, option],
            )
        )
    function.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    function.__annotations__ = {p.name: p.annotation for p in parameters}
    return function


def default_of(item: Field[Any]) -> str:
    """Return the default of an option, after a comma."""
    if item.default is MISSING:
        return ""
    return (
        f", default {item.default:g}"
        if isinstance(item.default, float)
        else f", default {item.default}"
    )


def _plain(kind: Any) -> Any:
    """Give the type a command line can parse: without None, and text where several would do."""
    if get_origin(kind) in (Union, UnionType):
        kinds = [part for part in get_args(kind) if part is not type(None)]
        return kinds[0] if len(kinds) == 1 else str
    return kind if kind in (int, float, bool) else str


def method_named(
    name: str | None,
    options: Mapping[str, Any],
    system: Any = None,
    plan: Path | None = None,
    rtol: float | None = None,
) -> Any:
    """Make the method asked for, or read it from a plan, which leaves nothing to ask for.

    "auto" is the method that :func:`liouville.integrate` takes by that name.
    """
    if plan is not None:
        asked = [option for option, value in options.items() if value is not None]
        if name is not None or asked:
            option = asked[0] if asked else "method"
            raise ValueError(
                f"a plan is a method with nothing left to choose: it takes no --{option}\n"
                "hint: give it to 'liouville plan', or leave --plan out"
            )
        return lv.Plan.load(plan)
    if name is None:
        name = _usual(system)
    given = {option: value for option, value in options.items() if value is not None}
    if name == "auto":
        if given:
            raise ValueError(f"method auto has no options, and --{next(iter(given))} is one")
        return AUTO if isinstance(system, lv.Schrodinger) else named(system, name, rtol)
    if name not in METHODS:
        names = ", ".join(["auto", *METHODS])
        raise ValueError(f"no method is called {name!r}\nhint: there are {names}")
    known = [item.name for item in fields(METHODS[name])]
    for option in given:
        if option not in known:
            raise ValueError(
                f"method {name} has no option {option!r}\nhint: it has {', '.join(known)}"
            )
    return METHODS[name](**given)


def _usual(system: Any) -> str:
    """Name the method for a system if none is asked for."""
    if isinstance(system, lv.Schrodinger):
        is_split = system.is_driven and system.grid is not None
        return "split-operator" if is_split else "schrodinger-splitting"
    return "volume-splitting" if isinstance(system, systems.Field) else "spark"


def assigned(option: str, items: Sequence[str]) -> dict[str, list[Any]]:
    """Read assignments of numbers, as ``q=1,0``, of a start complex ones too, as ``psi=1,0.5j``."""
    values: dict[str, list[Any]] = {}
    for item in items:
        name, equals, numbers = item.partition("=")
        try:
            values[name.strip()] = [
                _number(number, option == "--start") for number in numbers.split(",")
            ]
        except ValueError:
            equals = ""
        if not (name.strip() and equals):
            raise ValueError(
                f"{option} {item!r} is no assignment of numbers\nhint: write {option} name=1.0,2.0"
            )
    return values


def _number(text: str, may_be_complex: bool) -> float | complex:
    try:
        return float(text)
    except ValueError:
        if not may_be_complex:
            raise
        return complex(text.strip())


def parameters(items: Sequence[str] | None) -> dict[str, Any] | None:
    """Read the parameters of a model; None if there are none."""
    values = assigned("--param", items or [])
    return {name: x[0] if len(x) == 1 else x for name, x in values.items()} or None
