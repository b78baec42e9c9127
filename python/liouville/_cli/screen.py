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
from liouville._solution.contacts import counts_of
from liouville.analysis import convergence

#: As many coordinates of the end state are printed; the others are in the file.
ROWS = 100

#: As many coordinates of each member are shown.
SHOWN = 3

DONE, FAILED, WRONG, INTERRUPTED = 0, 1, 2, 130


def summary(solution: lv.Solution, reference: Mapping[str, Any], conserved: Sequence[str]) -> None:
    """Show how a run went, what it kept, and where it ended."""
    table = Table(box=None, show_header=False, pad_edge=False)
    for row in kept(solution, reference, conserved):
        table.add_row(*row)
    show(table)
    if solution.members is not None:
        heads, rows = members(solution, conserved)
        table = headed(*heads)
        for cells in rows:
            table.add_row(*cells)
        show(table)
        return
    unknowns = solution.names.get("unknowns", ())
    apart = ("lam", "acceleration", "a", "psi", *(("z",) if unknowns else ()))
    ends(solution, solution.names["coordinates"], [x for x in solution.states if x not in apart])
    ends(solution, unknowns, [x for x in solution.states if unknowns and x == "z"])


def kept(
    solution: lv.Solution, reference: Mapping[str, Any], conserved: Sequence[str]
) -> list[tuple[str, str]]:
    """Return how a run went and what it kept, in rows of a table."""
    rows = [("status", solution.status), ("method", solution.method)]
    rows += [("mean h" if solution.tolerances else "h", f"{solution.h:.10g}")]
    rows += [(name, f"{tolerance:g}") for name, tolerance in solution.tolerances.items()]
    rows += [("t", f"{solution.t[0]:.10g} to {solution.t[-1]:.10g}")]
    for name, number in solution.stats.items():
        rows.append((name, f"{number:.4g}" if isinstance(number, float) else str(number)))
    # of a stored run only the first and the last record are here
    is_whole = solution.path is None
    for name, values in solution.residuals.items():
        if values.size and is_whole:
            rows.append((f"{name} residual", f"{_largest(np.abs(values)):.2e}"))
    for name in solution.invariants if is_whole else ():
        word = "drift" if name in conserved else "change"
        word += solution.drift_words(name)
        rows.append((f"{name} {word}", f"{_largest(solution.invariant_drift(name)):.2e}"))
    if solution.members is not None:
        return rows
    rows += [(name, f"{values[-1]:.6g}") for name, values in solution.balance.items()]
    rows += counts_of(solution.contacts)
    for name, values in reference.items():
        if name in solution.states:
            error = convergence.distance(solution.states[name][-1], values)
            rows.append((f"{name} from reference", f"{error:.2e}"))
    return rows


def members(
    solution: lv.Solution, conserved: Sequence[str]
) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return heads and rows of a table of the members: parameters, how each went and ended."""
    state = next(iter(solution.states), None)
    names = solution.names["coordinates"][:SHOWN] if state else ()
    drifts = [name for name in conserved if name in solution.invariants]
    heads = ["member", *solution.varied, "status", *(f"{name} drift" for name in drifts), *names]
    rows = []
    for k in range(min(ROWS, solution.members or 0)):
        one = solution.member(k)
        cells = [str(k), *(f"{one.params[name]:.6g}" for name in solution.varied), one.status]
        cells += [f"{_largest(one.invariant_drift(name)):.2e}" for name in drifts]
        last = one.states[state][-1] if state and len(one.t) else ()
        cells += [f"{x:.8g}" for x in last[: len(names)]]
        rows.append((*cells, *("" for _ in range(len(heads) - len(cells)))))
    rest = (solution.members or 0) - len(rows)
    return heads, [*rows, (f"and {rest} more", *("" for _ in heads[1:]))] if rest else rows


def _largest(sizes: np.ndarray) -> float:
    """Return the largest, of the members that have come so far."""
    return float(np.fmax.reduce(sizes, axis=None, initial=0.0))


def ends(solution: lv.Solution, labels: Sequence[str], states: Sequence[str]) -> None:
    """Show the last states kept that have a number for each label."""
    if not states:
        return
    table = headed(f"at t = {solution.t[-1]:.6g}", *states)
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
