"""``liouville plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import liouville as lv
from liouville._cli.models import interval_of, kept_times, start_of, step_of, system_of
from liouville._cli.options import (
    Keep,
    Model,
    Param,
    Start,
    Step,
    Until,
    assigned,
    method_named,
    method_options,
    parameters,
)
from liouville._cli.screen import FAILED, WRONG, leaving_with, say
from liouville._systems import Field


@method_options
def show_plan(
    model: Model,
    h: Step = None,
    start: Start = None,
    param: Param = None,
    until: Until = None,
    keep: Keep = 100,
    seed: Annotated[int, typer.Option(help="Of the random search.")] = 0,
    trials: Annotated[int, typer.Option(help="How many orders of the pieces are tried.")] = 50,
    out: Annotated[
        Path | None, typer.Option(help="Save the plan as .json, for --plan of 'run'.")
    ] = None,
    **options: Any,
) -> None:
    """Choose how to split a polynomial field or propagate a wave function, and say why.

    What the options fix is not chosen: --composition BM6, for one.
    """
    with leaving_with(WRONG):
        module, system = system_of(model)
        chosen = method_named(None, options, system)
        if not isinstance(system, Field | lv.Schrodinger):
            raise TypeError(
                f"{model} is no polynomial field or Schrodinger equation, and plans are for those\n"
                "hint: liouville methods lists what steps it"
            )
        if out is not None and not out.absolute().parent.is_dir():
            raise FileNotFoundError(f"the folder of {str(out)!r} does not exist\nhint: create it")
        begin = {**getattr(module, "start", {}), **assigned("--start", start or [])}
        found: lv.Plan
        if isinstance(system, lv.Schrodinger):
            times = kept_times(interval_of(module, until), keep)
            found = lv.plan(system, chosen, t=times, params=parameters(param), **begin)
        else:
            h = step_of(module, chosen) if h is None else h
            found = lv.plan(
                system, chosen, h=h, t=start_of(module), params=parameters(param), seed=seed,
                trials=trials, **begin,
            )  # fmt: skip
    print(found)
    with leaving_with(FAILED):
        if out is not None:
            found.save(out)
            say(f"wrote {out}")
