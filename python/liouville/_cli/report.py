"""``--report``: a run on one page, which needs nothing else."""

from __future__ import annotations

import shlex
import sys
from base64 import b64encode
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import liouville as lv
from liouville import _core, plot
from liouville._basics import html
from liouville._basics.errors import hinted
from liouville._cli.screen import kept, members


def check(path: Path) -> None:
    """Refuse a path that a report could not be written to."""
    if path.suffix != ".html":
        raise ValueError(hinted(f"cannot write a report to {str(path)!r}", "name it .html"))
    plot.check(path.with_suffix(".png"))


def write(
    path: Path,
    model: str,
    solution: lv.Solution,
    reference: Mapping[str, Any],
    conserved: Sequence[str],
) -> None:
    """Write what was run, how it went, what it kept and how it looks."""
    picture = BytesIO()
    plot.overview(solution).savefig(picture, format="png")
    encoded = b64encode(picture.getvalue()).decode("ascii")
    ran = f"liouville {shlex.join(sys.argv[1:])}"
    parts: list[str] = [html.text("what was run", ran)]
    parts += [solution.message] if solution.message else []
    parts += [html.table("how it went", kept(solution, reference, conserved))]
    parts += [html.picture("png", encoded, f"overview of {model}")]
    if solution.members is not None:
        heads, rows = members(solution, conserved)
        parts += [html.heading("Members"), html.table("", rows, heads)]
    parts += [html.heading("Arrays"), html.of_solution(solution)]
    if solution.system is not None:
        parts += [html.heading("System"), html.of_system(solution.system)]
    parts += [f"liouville {_core.VERSION}"]
    path.write_text(html.page(model, parts), encoding="utf-8")
