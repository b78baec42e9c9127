"""The command line: ``liouville run``, ``order``, ``plan``, ``problems`` and ``methods``.

Results go to standard output and everything else to standard error. Exit codes: 0 done, 1 a run
failed (what was computed before is saved and drawn all the same), 2 a wrong call, 130 interrupted
(saved and drawn too). All of it is one file, for nothing else in the package prints.
"""

from __future__ import annotations

import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields
from pathlib import Path
from types import ModuleType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np

import liouville as lv
from liouville import convergence, export, plot, problems

try:
    import typer
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.table import Table
    from rich.text import Text
except ImportError as error:
    raise ImportError(
        'the command line needs typer and rich\nhint: pip install "liouville[cli]"'
    ) from error

#: As many coordinates of the end state are printed; the others are in the file.
ROWS = 100

DONE, FAILED, WRONG, INTERRUPTED = 0, 1, 2, 130

app = typer.Typer(
    help="Integrate mechanical systems and polynomial fields, and keep their structure.",
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line and leave with its exit code."""
    try:
        code = app(prog_name="liouville", standalone_mode=False)
    except Exception as error:
        # Only a call that typer could not read is formatted: its class has moved between versions.
        if not hasattr(error, "format_message"):
            raise
        command = getattr(getattr(error, "ctx", None), "command_path", "liouville")
        message = error.format_message().rstrip(".")
        _complain(f"{message}\nhint: {command} --help shows what there is")
        code = WRONG
    sys.exit(code)


def _method_options(function: Callable[..., None]) -> Callable[..., None]:
    """Give a command with ``**options`` one option for each field of each method."""
    found: dict[str, tuple[Any, list[str]]] = {}
    for name, method in lv.METHODS.items():
        for item in fields(method):
            kind = get_type_hints(method)[item.name]
            text = f"{item.metadata.get('help', '')} ({name}{_default(item)})"
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


def _default(item: Field[Any]) -> str:
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


Model = Annotated[
    str, typer.Argument(help="A problem's name, or MODEL.PY:SYSTEM.", show_default=False)
]
Method = Annotated[
    str | None,
    typer.Option(
        help="One of 'liouville methods'.", show_default="spark, or volume-splitting of a field"
    ),
]
Until = Annotated[float | None, typer.Option(help="End time.", show_default="the model's own")]
Step = Annotated[float | None, typer.Option(help="Step size.", show_default="the model's")]
Start = Annotated[list[str] | None, typer.Option(help="Start value, as q=1,0; may be repeated.")]
Param = Annotated[list[str] | None, typer.Option(help="Parameter, as m=2.0; may be repeated.")]
PlanFile = Annotated[
    Path | None,
    typer.Option("--plan", help="Split a field by a plan that 'liouville plan' saved."),
]


@app.command()
@_method_options
def run(
    model: Model,
    method: Method = None,
    h: Step = None,
    rtol: Annotated[
        float | None, typer.Option(help="Control the steps by this relative tolerance.")
    ] = None,
    atol: Annotated[
        float | None, typer.Option(help="Absolute tolerance.", show_default="rtol/1000")
    ] = None,
    h_min: Annotated[float | None, typer.Option(help="Least of the controlled steps.")] = None,
    until: Until = None,
    every: Annotated[int, typer.Option(help="Keep one step in this many.")] = 1,
    start: Start = None,
    param: Param = None,
    plan: PlanFile = None,
    out: Annotated[
        Path | None, typer.Option(help=f"Save the solution: {', '.join(export.SUFFIXES)}.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--plot", help=f"Draw it: {', '.join(plot.FIGURES)}.")
    ] = None,
    film: Annotated[
        Path | None, typer.Option("--animate", help="Animate a planar mechanism: .gif.")
    ] = None,
    **options: Any,
) -> None:
    """Integrate a problem of the library or a model of your own."""
    with _leaving_with(WRONG):
        module, system = _load(model)
        chosen = _method(method, options, system, plan)
        begin = {**getattr(module, "start", {}), **_assigned("--start", start or [])}
        values = _parameters(param)
        interval = _interval(module, until)
        h = _step(module, chosen) if h is None and rtol is None else h
        outline: Any = getattr(module, "outline", None)
        if out is not None:
            export.check(out)
        if figure is not None:
            plot.check(figure)
        if film is not None:
            plot.check(film, plot.ANIMATIONS)
            if outline is None:
                raise ValueError(
                    f"{model} cannot be animated: it has no outline(q, params)\n"
                    "hint: leave --animate out, or define outline as the planar problems do"
                )
        try:
            with _progress(model, "steps" if rtol is None else "of time") as report:
                solution = lv.integrate(
                    system, chosen, t=interval, h=h, rtol=rtol, atol=atol, h_min=h_min,
                    every=every, params=values, progress=report, **begin,
                )  # fmt: skip
        except lv.IntegrationError as error:
            _complain(error)
            if error.solution is None or not error.solution.t.size:
                raise typer.Exit(FAILED) from error
            solution = error.solution
    with _leaving_with(FAILED):
        if out is not None:
            solution.save(out)
        if figure is not None:
            plot.overview(solution).savefig(figure)
        if film is not None:
            plot.animation(solution, outline, film)
    reference = {} if start or param else getattr(module, "reference", {})
    conserved = getattr(module, "conserved", tuple(solution.invariants))
    _summary(solution, _at(reference, solution.t[-1]), conserved)
    for path in (out, figure, film):
        if path is not None:
            _say(f"wrote {path}")
    if solution.status == "interrupted":
        _complain(f"interrupted at t = {solution.t[-1]:.6g}; what was done is kept")
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(DONE if solution.status == "done" else FAILED)


@app.command()
@_method_options
def order(
    model: Model,
    method: Method = None,
    h: Annotated[
        list[float] | None,
        typer.Option(help="Step size; repeat it.", show_default="8 h to h/4 of the model's h"),
    ] = None,
    until: Until = None,
    plan: PlanFile = None,
    **options: Any,
) -> None:
    """Show the error against the step size, with its slope.

    The error is taken to the problem's reference, or else to a run with a quarter of the smallest
    step. It is relative, in the largest component of each state. What the splitting of a field
    leaves open is chosen once, for the step size in the middle.
    """
    with _leaving_with(WRONG):
        module, system = _load(model)
        chosen = _method(method, options, system, plan)
        references = getattr(module, "reference", {})
        if until is None and references:
            until = min(references)
        interval = _interval(module, until)
        reference = _at(references, interval[1])
        sizes = h or [_step(module, chosen) * 2.0**k for k in range(3, -3, -1)]
        begin = getattr(module, "start", {})
        of = tuple(name for name in (reference or begin) if name != "lam")
        study = convergence.study(system, chosen, interval, sizes, begin, reference or None, of)
    table = _table("h", *(column for name in of for column in (f"error of {name}", "slope")))
    for i, size in enumerate(study.h):
        cells = []
        for name in of:
            error, slope = study.errors[name][i], study.slopes(name)[i]
            cells += ["failed" if np.isnan(error) else f"{error:.2e}"]
            cells += [f"{slope:.2f}" if np.isfinite(slope) else ""]
        table.add_row(f"{size:.6g}", *cells)
    fits = [f"{fit:.2f}" if np.isfinite(fit) else "none" for fit in study.order.values()]
    table.add_row("fitted", *(cell for fit in fits for cell in ("", fit)))
    _print(table)
    _say(f"of {study.method}")
    if "none" in fits:
        _say("a slope needs three errors above roundoff: give other steps with --h")
    if np.isnan(list(study.errors.values())).any():
        raise typer.Exit(FAILED)


@app.command("plan")
@_method_options
def show_plan(
    model: Model,
    h: Step = None,
    start: Start = None,
    param: Param = None,
    seed: Annotated[int, typer.Option(help="Of the random search.")] = 0,
    trials: Annotated[int, typer.Option(help="How many orders of the pieces are tried.")] = 50,
    out: Annotated[
        Path | None, typer.Option(help="Save the plan as .json, for --plan of 'run'.")
    ] = None,
    **options: Any,
) -> None:
    """Choose how to split a polynomial field, and say why.

    What the options fix is not chosen: --composition BM6, for one.
    """
    with _leaving_with(WRONG):
        module, system = _load(model)
        if not isinstance(system, lv.PolynomialField):
            raise TypeError(
                f"{model} is no polynomial field, and plans are for those\n"
                "hint: liouville methods lists what steps it"
            )
        chosen = _method(None, options, system)
        begin = {**getattr(module, "start", {}), **_assigned("--start", start or [])}
        if out is not None and not out.absolute().parent.is_dir():
            raise FileNotFoundError(f"the folder of {str(out)!r} does not exist\nhint: create it")
        h = _step(module, chosen) if h is None else h
        found = lv.plan(
            system, chosen, h=h, t=_begin(module), params=_parameters(param), seed=seed,
            trials=trials, **begin,
        )  # fmt: skip
    print(found)
    with _leaving_with(FAILED):
        if out is not None:
            found.save(out)
            _say(f"wrote {out}")


@app.command("problems")
def list_problems() -> None:
    """List the library of problems."""
    table = _table("problem", "n", "m", "until", "h", "what")
    for name in problems.names():
        module = problems.load(name)
        sizes = len(module.system.coordinates), len(getattr(module.system, "constraints", ()))
        until, title = module.interval[1], _title(module)
        table.add_row(name, *map(str, sizes), f"{until:g}", f"{module.h:g}", title)
    _print(table)
    _say("n coordinates, m constraints; liouville run PROBLEM integrates one")


@app.command("methods")
def list_methods() -> None:
    """List the methods and their options."""
    table = _table("method", "option", "what")
    for name, method in lv.METHODS.items():
        table.add_row(name, "", _title(method))
        for item in fields(method):
            text = f"{item.metadata.get('help', '')}{_default(item)}"
            table.add_row("", f"--{item.name.replace('_', '-')}", text)
    _print(table)


def _load(model: str) -> tuple[ModuleType, Any]:
    """Import a problem by its name or a model file, and find the system in it."""
    path, _, attribute = model.rpartition(":") if ".py:" in model else (model, "", "system")
    if not path.endswith(".py"):
        module = problems.load(model)
        return module, module.system
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"there is no model file {path!r}")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(file.parent.absolute()))
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        lines = [
            f":{frame.lineno}"
            for frame in traceback.extract_tb(error.__traceback__)
            if Path(frame.filename) == file.absolute() or frame.filename == str(file)
        ]
        where = path + (lines[-1] if lines else "")
        raise ValueError(f"{where}: {type(error).__name__}: {error}") from error
    system = getattr(module, attribute, None)
    if not hasattr(system, "coordinates"):
        found = [name for name, value in vars(module).items() if hasattr(value, "coordinates")]
        raise ValueError(
            f"{path} has no system called {attribute!r}\n"
            f"hint: name one after a colon, {path}:NAME; it has {', '.join(found) or 'none'}"
        )
    return module, system


def _method(
    name: str | None,
    options: Mapping[str, Any],
    system: Any = None,
    plan: Path | None = None,
) -> Any:
    """Make the method asked for, or read it from a plan, which leaves nothing to ask for."""
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
        name = "volume-splitting" if isinstance(system, lv.PolynomialField) else "spark"
    if name not in lv.METHODS:
        raise ValueError(f"no method is called {name!r}\nhint: there are {', '.join(lv.METHODS)}")
    given = {option: value for option, value in options.items() if value is not None}
    known = [item.name for item in fields(lv.METHODS[name])]
    for option in given:
        if option not in known:
            raise ValueError(
                f"method {name} has no option {option!r}\nhint: it has {', '.join(known)}"
            )
    return lv.METHODS[name](**given)


def _assigned(option: str, items: Sequence[str]) -> dict[str, list[float]]:
    values = {}
    for item in items:
        name, equals, numbers = item.partition("=")
        try:
            values[name.strip()] = [float(number) for number in numbers.split(",")]
        except ValueError:
            equals = ""
        if not (name.strip() and equals):
            raise ValueError(
                f"{option} {item!r} is no assignment of numbers\nhint: write {option} name=1.0,2.0"
            )
    return values


def _parameters(items: Sequence[str] | None) -> dict[str, Any] | None:
    values = _assigned("--param", items or [])
    return {name: x[0] if len(x) == 1 else x for name, x in values.items()} or None


def _begin(module: ModuleType) -> float:
    return float(getattr(module, "interval", (0.0, None))[0])


def _interval(module: ModuleType, until: float | None) -> tuple[float, float]:
    _, last = getattr(module, "interval", (0.0, None))
    end = last if until is None else until
    if end is None:
        raise ValueError(
            "the end time is not said\n"
            f"hint: give --until, or define interval = (t0, t1) in {module.__name__}.py"
        )
    return _begin(module), float(end)


def _step(module: ModuleType, method: Any) -> float:
    """Give the model's step; one made for Spark(3), for about as much work with any method."""
    if not hasattr(module, "h"):
        raise ValueError(
            f"the step size is not said\nhint: give --h, or define h in {module.__name__}.py"
        )
    return float(module.h) / (8 if method.form == "second order" else 1)


def _at(reference: Mapping[float, Any], t: float) -> dict[str, Any]:
    """Give the reference at a time, empty if there is none."""
    for time, states in reference.items():
        if abs(time - t) <= 1e-12 * max(abs(time), abs(t)):
            return dict(states)
    return {}


def _summary(solution: lv.Solution, reference: Mapping[str, Any], conserved: Sequence[str]) -> None:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_row("status", solution.status)
    table.add_row("method", solution.method)
    table.add_row("mean h" if solution.tolerances else "h", f"{solution.h:.10g}")
    for name, tolerance in solution.tolerances.items():
        table.add_row(name, f"{tolerance:g}")
    table.add_row("t", f"{solution.t[0]:.10g} to {solution.t[-1]:.10g}")
    for name, number in solution.stats.items():
        table.add_row(name, f"{number:.4g}" if isinstance(number, float) else str(number))
    for name, values in solution.residuals.items():
        if values.size:
            table.add_row(f"{name} residual", f"{np.max(np.abs(values)):.2e}")
    for name in solution.invariants:
        word = "drift" if name in conserved else "change"
        table.add_row(f"{name} {word}", f"{np.max(solution.invariant_drift(name)):.2e}")
    for name, values in solution.balance.items():
        table.add_row(name, f"{values[-1]:.6g}")
    for name, values in reference.items():
        if name in solution.states:
            error = convergence.distance(solution.states[name][-1], values)
            table.add_row(f"{name} from reference", f"{error:.2e}")
    _print(table)
    names = [name for name in solution.states if name not in ("lam", "acceleration", "a")]
    if names:
        table = _table("at the end", *names)
        coordinates = solution.names["coordinates"]
        for i, coordinate in enumerate(coordinates[:ROWS]):
            numbers = [f"{solution.states[name][-1, i]:.15g}" for name in names]
            table.add_row(coordinate, *numbers)
        if len(coordinates) > ROWS:
            table.add_row(f"and {len(coordinates) - ROWS} more")
        _print(table)


class _Rate(ProgressColumn):
    """Steps a second, or the time of the model where steps are controlled."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self.unit = unit

    def render(self, task: Task) -> Text:
        speed = task.speed or 0.0
        number = f"{speed:,.0f}" if speed >= 100 else f"{speed:.3g}"
        return Text(f"{number} {self.unit}/s" if speed else "", style="dim")


@contextmanager
def _progress(name: str, unit: str) -> Iterator[Callable[[float, float], None] | None]:
    """Show a bar with rate and time left while the block runs, if someone is there to see it."""
    console = _console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        _Rate(unit),
        TimeRemainingColumn(),
        TextColumn("left", style="dim"),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(name, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextmanager
def _leaving_with(code: int) -> Iterator[None]:
    """Turn what the library refuses into a message and an exit code."""
    try:
        yield
    except (ValueError, TypeError, ImportError, OSError, MemoryError) as error:
        _complain(error)
        raise typer.Exit(code) from error


def _title(thing: Any) -> str:
    """Give the first line of a docstring, without the marks of Sphinx's roles."""
    line = (inspect.getdoc(thing) or "").partition("\n")[0].rstrip(".")
    return re.sub(r":\w+:`([^`]*)`", r"\1", line).replace("--", "-")


def _table(*heads: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in heads:
        table.add_column(head)
    return table


def _console(stderr: bool = False) -> Console:
    console = Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    if not console.is_terminal:
        console.width = 1000  # what reads a pipe does not want its lines folded
    return console


def _print(table: Table) -> None:
    _console().print(table)


def _say(message: str) -> None:
    _console(stderr=True).print(message, style="dim", soft_wrap=True)


def _complain(trouble: Exception | str) -> None:
    text = Text()
    first, *rest = str(trouble).splitlines() or [type(trouble).__name__]
    for line in (f"error: {first}", *rest):
        head, colon, tail = line.partition(":")
        style = {"error": "bold red", "hint": "bold cyan"}.get(head) if colon else None
        text.append(head + colon, style).append(tail + "\n")
    _console(stderr=True).print(text, soft_wrap=True, end="")
