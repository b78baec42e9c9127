"""``liouville run``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import liouville as lv
from liouville import export, plot
from liouville.cli.models import interval_of, reference_at, step_of, system_of
from liouville.cli.options import (
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
from liouville.cli.screen import (
    DONE,
    FAILED,
    INTERRUPTED,
    WRONG,
    complain,
    leaving_with,
    progress,
    say,
    summary,
)


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
        typer.Option(help="'reversible': steps follow the motion, --h is the first of them."),
    ] = None,
    until: Until = None,
    every: Annotated[int, typer.Option(help="Keep one step in this many.")] = 1,
    at: Annotated[
        list[float] | None,
        typer.Option(help="Keep the state at this time, instead of steps; may be repeated."),
    ] = None,
    keep: Annotated[
        int, typer.Option(help="Keep so many wave functions, at equal distances.", min=1)
    ] = 100,
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
    with leaving_with(WRONG):
        module, system = system_of(model)
        chosen = method_named(method, options, system, plan)
        begin = {**getattr(module, "start", {}), **assigned("--start", start or [])}
        values = parameters(param)
        interval = interval_of(module, until)
        times: Any = interval
        if getattr(chosen, "form", "") == "wave" and hasattr(chosen, "tol") and h is None:
            times = np.linspace(interval[0], interval[1], keep + 1)
        elif h is None and rtol is None:
            h = step_of(module, chosen)
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
            is_equal = rtol is None and control is None
            with progress(model, "steps" if is_equal else "of time") as report:
                solution = lv.integrate(
                    system, chosen, t=times, h=h, rtol=rtol, atol=atol, h_min=h_min,
                    control=control, t_eval=at or None, every=every, params=values,
                    progress=report, **begin,
                )  # fmt: skip
        except lv.IntegrationError as error:
            complain(error)
            if error.solution is None or not error.solution.t.size:
                raise typer.Exit(FAILED) from error
            solution = error.solution
    with leaving_with(FAILED):
        if out is not None:
            solution.save(out)
        if figure is not None:
            plot.overview(solution).savefig(figure)
        if film is not None:
            plot.animation(solution, outline, film)
    reference = {} if start or param else getattr(module, "reference", {})
    conserved = getattr(module, "conserved", tuple(solution.invariants))
    summary(solution, reference_at(reference, solution.t[-1]), conserved)
    for path in (out, figure, film):
        if path is not None:
            say(f"wrote {path}")
    if solution.status == "interrupted":
        complain(f"interrupted at t = {solution.t[-1]:.6g}; what was done is kept")
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(DONE if solution.status == "done" else FAILED)
