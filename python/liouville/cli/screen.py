"""Output of the commands: tables, progress, messages."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

import liouville as lv
from liouville import convergence

#: As many coordinates of the end state are printed; the others are in the file.
ROWS = 100

DONE, FAILED, WRONG, INTERRUPTED = 0, 1, 2, 130


def summary(solution: lv.Solution, reference: Mapping[str, Any], conserved: Sequence[str]) -> None:
    """Show how a run went, what it kept, and where it ended."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_row("status", solution.status)
    table.add_row("method", solution.method)
    table.add_row("mean h" if solution.tolerances else "h", f"{solution.h:.10g}")
    for name, tolerance in solution.tolerances.items():
        table.add_row(name, f"{tolerance:g}")
    table.add_row("t", f"{solution.t[0]:.10g} to {solution.t[-1]:.10g}")
    for name, number in solution.stats.items():
        table.add_row(name, f"{number:.4g}" if isinstance(number, float) else str(number))
    # of a stored run only the first and the last record are here
    is_whole = solution.path is None
    for name, values in solution.residuals.items():
        if values.size and is_whole:
            table.add_row(f"{name} residual", f"{np.max(np.abs(values)):.2e}")
    for name in solution.invariants if is_whole else ():
        word = "drift" if name in conserved else "change"
        word += ", absolute" if solution.is_drift_absolute(name).all() else ""
        table.add_row(f"{name} {word}", f"{np.max(solution.invariant_drift(name)):.2e}")
    for name, values in solution.balance.items():
        table.add_row(name, f"{values[-1]:.6g}")
    for name, values in reference.items():
        if name in solution.states:
            error = convergence.distance(solution.states[name][-1], values)
            table.add_row(f"{name} from reference", f"{error:.2e}")
    show(table)
    unknowns = solution.names.get("unknowns", ())
    apart = ("lam", "acceleration", "a", "psi", *(("z",) if unknowns else ()))
    ends(solution, solution.names["coordinates"], [x for x in solution.states if x not in apart])
    ends(solution, unknowns, [x for x in solution.states if unknowns and x == "z"])


def ends(solution: lv.Solution, labels: Sequence[str], states: Sequence[str]) -> None:
    """Show where states ended that have a number for each label."""
    if not states:
        return
    table = headed("at the end", *states)
    for i, label in enumerate(labels[:ROWS]):
        table.add_row(label, *(f"{solution.states[name][-1, i]:.15g}" for name in states))
    if len(labels) > ROWS:
        table.add_row(f"and {len(labels) - ROWS} more")
    show(table)


@contextmanager
def leaving_with(code: int) -> Iterator[None]:
    """Turn what the library refuses into a message and an exit code."""
    try:
        yield
    except (ValueError, TypeError, ImportError, OSError, MemoryError) as error:
        complain(error)
        raise typer.Exit(code) from error


def title_of(thing: Any) -> str:
    """Give the first line of a docstring, without the marks of Sphinx's roles."""
    line = (inspect.getdoc(thing) or "").partition("\n")[0].rstrip(".")
    return re.sub(r":\w+:`([^`]*)`", r"\1", line).replace("--", "-")


def headed(*heads: str) -> Table:
    """Begin a table with these heads."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in heads:
        table.add_column(head)
    return table


def console(stderr: bool = False) -> Console:
    """Give the screen, or what stands for it."""
    screen = Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    if not screen.is_terminal:
        screen.width = 1000  # what reads a pipe does not want its lines folded
    return screen


def show(table: Table) -> None:
    """Print a table."""
    console().print(table)


def say(message: str) -> None:
    """Print a line beside the results."""
    console(stderr=True).print(message, style="dim", soft_wrap=True)


def complain(message: Exception | str) -> None:
    """Print an error and its hint."""
    text = Text()
    first, *rest = str(message).splitlines() or [type(message).__name__]
    for line in (f"error: {first}", *rest):
        head, colon, tail = line.partition(":")
        style = {"error": "bold red", "hint": "bold cyan"}.get(head) if colon else None
        text.append(head + colon, style).append(tail + "\n")
    console(stderr=True).print(text, soft_wrap=True, end="")
