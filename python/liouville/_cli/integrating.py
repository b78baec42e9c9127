"""``liouville run`` and ``liouville resume``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

import liouville as lv
from liouville import plot as figures
from liouville._basics.progress import bar
from liouville._cli.models import (
    check_given,
    interval_of,
    reference_at,
    system_of,
    times_of,
)
from liouville._cli.options import (
    Keep,
    Method,
    Model,
    Param,
    PlanFile,
    Start,
    Step,
    Until,
    assigned,
    method_named,
    method_options,
    parameters,
)
from liouville._cli.report import check as check_report
from liouville._cli.report import write as write_report
from liouville._cli.screen import (
    DONE,
    FAILED,
    INTERRUPTED,
    WRONG,
    complain,
    leaving_with,
    say,
    summary,
)
from liouville._cli.sweeping import sweep as swept_over
from liouville._cli.sweeping import swept
from liouville._solution import export

Checkpoint = Annotated[
    str | None,
    typer.Option(
        help="Steps or time between two checkpoints of a stored run, as 10000 or 30s.",
        show_default="30s",
    ),
]


@method_options
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
    control: Annotated[
        str | None,
        typer.Option(
            help="'adaptive': steps by their error, which --rtol asks for too; 'reversible': "
            "steps follow the motion, --h is the first of them."
        ),
    ] = None,
    until: Until = None,
    every: Annotated[int, typer.Option(help="Keep one step in this many.")] = 1,
    at: Annotated[
        list[float] | None,
        typer.Option(help="Keep the state at this time, instead of steps; may be repeated."),
    ] = None,
    keep: Keep = 100,
    start: Start = None,
    param: Param = None,
    sweep: Annotated[
        str | None,
        typer.Option(
            help="Run for many values of a parameter: g=1,2,3, or l=0.5:2:20, from:to:count."
        ),
    ] = None,
    plan: PlanFile = None,
    store: Annotated[
        Path | None, typer.Option(help="Store the run in this .zarr folder on its way.")
    ] = None,
    checkpoint: Checkpoint = None,
    out: Annotated[
        Path | None, typer.Option(help=f"Save the solution: {', '.join(export.SUFFIXES)}.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--plot", help=f"Draw it: {', '.join(figures.FIGURES)}.")
    ] = None,
    film: Annotated[
        Path | None, typer.Option("--animate", help="Animate a planar mechanism: .gif.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option("--report", help="Write all about it on one page: .html.")
    ] = None,
    **options: Any,
) -> None:
    """Integrate a problem of the library or a model of your own."""
    with leaving_with(WRONG):
        module, system = system_of(model)
        chosen = method_named(method, options, system, plan, rtol)
        begin = {**getattr(module, "start", {}), **assigned("--start", start or [])}
        values = parameters(param)
        is_stepped = chosen.form != "wave" and h is None and rtol is None
        check_given(module, system, until, is_stepped, begin)
        span = interval_of(module, until)
        times, at, h = times_of(module, chosen, span, at, keep, h, rtol)
        outline: Any = getattr(module, "outline", None)
        wanted = {"out": out, "plot": figure, "animate": film, "report": page}
        _check_stored(store, checkpoint, wanted)
        _check_paths(system, **wanted)
        if film is not None and outline is None and not isinstance(system, lv.bodies.Mechanism):
            raise ValueError(
                f"{model} cannot be animated: it has no outline(q, params)\n"
                "hint: leave --animate out, or define outline as the mechanical problems do"
            )
        options_of = {"t": times, "h": h, "every": every}
        single = {"rtol": rtol, "atol": atol, "control": control, "h-min": h_min, "at": at}
        try:
            if sweep is not None:
                unwanted = {**single, "store": store, "animate": film}
                solution = swept_over(
                    model, system, chosen, swept(sweep), begin, values, unwanted, **options_of
                )
            else:
                is_equal = rtol is None and control is None
                with bar(model, "steps" if is_equal else "of time") as report:
                    solution = lv.integrate(
                        system, chosen, rtol=rtol, atol=atol, control=control_of(control, h_min),
                        t_eval=at, params=values, progress=report,
                        store=store_of(store, checkpoint), **options_of, **begin,
                    )  # fmt: skip
        except lv.IntegrationError as error:
            solution = left_by(error)
    reference = {} if start or param or sweep else getattr(module, "reference", {})
    reference = reference_at(reference, solution.t[-1])
    conserved = [name for name in solution.invariants if name not in solution.changing]
    conserved = getattr(module, "conserved", conserved)
    with leaving_with(FAILED):
        if out is not None:
            solution.save(out)
        if figure is not None:
            figures.overview(solution).savefig(figure)
        if film is not None:
            figures.animation(solution, outline, film)
        if page is not None:
            write_report(page, model, solution, reference, conserved)
    summary(solution, reference, conserved)
    for path in (store, out, figure, film, page):
        if path is not None:
            say(f"wrote {path}")
    leave(solution)


def resume(
    store: Annotated[Path, typer.Argument(help="A folder that 'liouville run --store' made.")],
    checkpoint: Checkpoint = None,
) -> None:
    """Resume an interrupted run. Only resume runs you trust: the folder can execute code."""
    with leaving_with(WRONG):
        try:
            with bar(store.name, "") as report:
                solution = lv.resume(lv.Store(store, interval(checkpoint)), progress=report)
        except lv.IntegrationError as error:
            solution = left_by(error)
    summary(solution, {}, ())
    leave(solution)


def control_of(name: str | None, h_min: float | None) -> lv.Adaptive | lv.Reversible | None:
    """Return the control of the steps by its name; --h-min alone is for steps by the error."""
    if name is None:
        return None if h_min is None else lv.Adaptive(h_min)
    if name == "adaptive":
        return lv.Adaptive(h_min=h_min)
    if name == "reversible":
        return lv.Reversible(h_min=h_min)
    raise ValueError(f"--control must be 'adaptive' or 'reversible', not {name!r}")


def store_of(path: Path | None, checkpoint: str | None) -> lv.Store | None:
    """Return where a run is stored, if it is."""
    return None if path is None else lv.Store(path, interval(checkpoint))


def interval(checkpoint: str | None) -> int | str | None:
    """Read a number of steps; a time stays as it is."""
    return int(checkpoint) if checkpoint is not None and checkpoint.isdecimal() else checkpoint


def left_by(error: lv.IntegrationError) -> lv.Solution:
    """Print why a run failed, and return what it left, if anything."""
    complain(error)
    if error.solution is None or not error.solution.t.size:
        raise typer.Exit(FAILED) from error
    return error.solution


def leave(solution: lv.Solution) -> NoReturn:
    """Leave with the code of how a run went."""
    if solution.failures:
        complain(solution.message)
    if solution.status == "interrupted":
        way = "what was done is kept"
        if solution.path is not None:
            way = f"'liouville resume {solution.path}' goes on"
        complain(f"interrupted at t = {solution.t[-1]:.6g}; {way}")
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(DONE if solution.status == "done" else FAILED)


def _check_stored(
    store: Path | None, checkpoint: str | None, wanted: dict[str, Path | None]
) -> None:
    """Refuse what would need all records of a stored run at once, or a store that is not there."""
    if store is None and checkpoint is not None:
        raise ValueError("--checkpoint is for a stored run\nhint: give --store too, a .zarr folder")
    for option, path in wanted.items():
        if store is not None and path is not None:
            raise ValueError(
                f"a stored run keeps its records in its folder: it takes no --{option}\n"
                "hint: liouville.load reads the folder, if it fits in memory"
            )


def _check_paths(
    system: Any, out: Path | None, plot: Path | None, animate: Path | None, report: Path | None
) -> None:
    """Refuse files that nothing can be written to."""
    if out is not None:
        export.check(out, system.coordinates)
    if plot is not None:
        figures.check(plot)
    if animate is not None:
        figures.check(animate, figures.ANIMATIONS)
    if report is not None:
        check_report(report)
