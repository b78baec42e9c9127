"""``liouville order``."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import typer

from liouville._cli.models import interval_of, reference_at, step_of, system_of
from liouville._cli.options import Method, Model, PlanFile, Until, method_named, method_options
from liouville._cli.screen import FAILED, WRONG, headed, leaving_with, say, show
from liouville.analysis import convergence


@method_options
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
    with leaving_with(WRONG):
        module, system = system_of(model)
        chosen = method_named(method, options, system, plan)
        references = getattr(module, "reference", {})
        if until is None and references:
            until = min(references)
        interval = interval_of(module, until)
        reference = reference_at(references, interval[1])
        sizes = h or [step_of(module, chosen) * 2.0**k for k in range(3, -3, -1)]
        begin = getattr(module, "start", {})
        of = tuple(name for name in (reference or begin) if name in begin and name != "lam")
        study = convergence.study(system, chosen, interval, sizes, begin, reference or None, of)
    heads, rows = study.table()
    table = headed(*heads)
    for row in rows:
        table.add_row(*row)
    show(table)
    say(f"of {study.method}")
    if np.isnan([*study.order.values()]).any():
        say("a slope needs three errors above roundoff: give other steps with --h")
    if np.isnan(list(study.errors.values())).any():
        raise typer.Exit(FAILED)
