"""``liouville show``, ``plot``, ``convert`` and ``report`` of a saved run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import liouville as lv
from liouville import plot as figures
from liouville._cli.report import check as check_report
from liouville._cli.report import write as write_report
from liouville._cli.screen import FAILED, WRONG, leaving_with, say, summary
from liouville._solution import export
from liouville._solution.solution import Solution

Run = Annotated[Path, typer.Argument(help="A saved run: .nc, .zarr or .npz.")]
FIGURE = ", ".join(figures.FIGURES)

#: What is drawn of a solution by its name.
PANELS = (
    *("overview", "trajectories", "invariants", "energy", "residuals", "multipliers", "steps"),
    *("observed", "density", "autocorrelation", "spectrum"),
)


def show(run: Run) -> None:
    """Show how a saved run went, what it kept and where it ended."""
    with leaving_with(WRONG):
        solution = lv.load(run)
    summary(solution, {}, _conserved(solution))
    if solution.message:
        say(solution.message)


def draw(
    run: Run,
    out: Annotated[Path, typer.Argument(help=f"The figure: {FIGURE}.")],
    of: Annotated[
        str, typer.Option(help="What to draw: overview, trajectories, invariants, energy, ...")
    ] = "overview",
) -> None:
    """Draw a saved run."""
    with leaving_with(WRONG):
        figures.check(out)
        if of not in PANELS:
            raise ValueError(f"--of must be one of {', '.join(PANELS)}, not {of!r}")
        solution = lv.load(run)
        found = getattr(figures, of)(solution)
    with leaving_with(FAILED):
        getattr(found, "figure", found).savefig(out)
    say(f"wrote {out}")


def convert(
    run: Run, out: Annotated[Path, typer.Argument(help=f"A file: {', '.join(export.SUFFIXES)}.")]
) -> None:
    """Write a saved run to a file of another kind."""
    with leaving_with(WRONG):
        solution = lv.load(run)
        export.check(out, solution.names["coordinates"])
    with leaving_with(FAILED):
        solution.save(out)
    say(f"wrote {out}")


def report(run: Run, out: Annotated[Path, typer.Argument(help="The page: .html.")]) -> None:
    """Write all about a saved run on one page."""
    with leaving_with(WRONG):
        check_report(out)
        solution = lv.load(run)
    with leaving_with(FAILED):
        write_report(out, run.name, solution, {}, _conserved(solution))
    say(f"wrote {out}")


def _conserved(solution: Solution) -> list[str]:
    return [name for name in solution.invariants if name not in solution.changing]
