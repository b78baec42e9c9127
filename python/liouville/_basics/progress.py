"""A bar that shows how far a run is, on terminals and in notebooks."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from liouville._basics.errors import hinted

#: A function of the amount done and of the total.
Report = Callable[[float, float], None]

#: Values of ``progress=``.
Progress = bool | Report | None

#: Seconds between two lines of the plain bar.
PAUSE = 0.2


def reported(progress: Progress, unit: str) -> AbstractContextManager[Report | None]:
    """Give what is to be called while a block runs: a bar's for True, a function's own.

    Raises
    ------
    TypeError
        `progress` is neither.
    """
    if progress is None or progress is False:
        return nullcontext()
    if progress is True:
        return bar("", unit)
    if callable(progress):
        return nullcontext(progress)
    hint = "or True, which shows a bar"
    raise TypeError(hinted(f"progress must be a function, not {progress!r}", hint))


@contextmanager
def bar(name: str, unit: str) -> Iterator[Report | None]:
    """Show a bar with rate and time left while the block runs, on a terminal or in a notebook.

    It is drawn by rich. Without it, and in notebooks without ipywidgets, which rich needs there, it
    is a line of text. Where nobody looks, as in a file, there is none.
    """
    is_notebook = _is_notebook()
    if not (is_notebook or sys.stderr.isatty()):
        yield None
    elif _has("rich") and (not is_notebook or _has("ipywidgets")):
        with _of_rich(name, unit) as report:
            yield report
    else:
        yield from _plain(name, unit)


def _has(package: str) -> bool:
    """Say whether a package can be imported."""
    try:
        return importlib.util.find_spec(package) is not None
    except ValueError:  # it is blocked
        return False


def _is_notebook() -> bool:
    """Say whether the output is a notebook's, by its kernel."""
    shell = sys.modules.get("IPython")
    kernel = shell.get_ipython() if shell is not None else None
    return type(kernel).__name__ == "ZMQInteractiveShell"


@contextmanager
def _of_rich(name: str, unit: str) -> Iterator[Report]:
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
    from rich.text import Text

    class Rate(ProgressColumn):
        """Steps a second, or the time of the model where steps are controlled."""

        def render(self, task: Task) -> Text:
            return Text(_rate(task.speed or 0.0, unit), style="dim")

    columns: tuple[Any, ...] = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        Rate(),
        TimeRemainingColumn(),
        TextColumn("left", style="dim"),
    )
    console = Console(stderr=True, highlight=False, markup=False, emoji=False)
    with Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task(name, total=None)
        yield lambda done, total: shown.update(task, completed=done, total=total)


def _plain(name: str, unit: str) -> Iterator[Report]:
    start = time.monotonic()
    last, width = -PAUSE, 0

    def report(done: float, total: float) -> None:
        nonlocal last, width
        now = time.monotonic() - start
        if now - last < PAUSE:
            return
        last = now
        part = done / total if total else 0.0
        left = f"{now / part - now:.0f} s left" if part else ""
        words = [name, f"{part:4.0%}", _rate(done / now if now else 0.0, unit), left]
        line = "  ".join(filter(None, words))
        sys.stderr.write(f"\r{line:<{width}}")
        sys.stderr.flush()
        width = max(width, len(line))

    try:
        yield report
    finally:
        sys.stderr.write(f"\r{'':<{width}}\r")
        sys.stderr.flush()


def _rate(speed: float, unit: str) -> str:
    number = f"{speed:,.0f}" if speed >= 100 else f"{speed:.3g}"
    return f"{number} {unit}/s" if speed else ""
