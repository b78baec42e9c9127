"""Small tables and sparklines for notebooks and reports: plain HTML without scripts or links.

Lines take ``currentColor``, so they are seen on a light and on a dark page.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from liouville._solution.solution import Solution

#: Width and height of a sparkline, its points at most, and its curves.
WIDTH, HEIGHT, POINTS, CURVES = 120, 22, 120, 6

#: As many numbers of a row are shown, and as many names or lines of a list.
NUMBERS, NAMES = 4, 12

CELL = "text-align:left;padding:0.1em 1em 0.1em 0;vertical-align:middle"


class Markup(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


def table(title: str, rows: Iterable[Sequence[str]], heads: Sequence[str] = ()) -> Markup:
    """Return a table below a title; all text is escaped but for `Markup`."""
    head = _row("th", heads) if heads else ""
    body = "".join(_row("td", row) for row in rows)
    return Markup(
        f'<div style="font-family:monospace"><div>{_text(title)}</div>'
        f'<table style="border-collapse:collapse;border:0">{head}{body}</table></div>'
    )


def facts(title: str, given: Mapping[str, Any]) -> Markup:
    """Return a table of what is there, by name; what is empty is left out."""
    rows = [(name, _listed(value)) for name, value in given.items() if np.size(value)]
    return table(title, rows)


def text(title: str, lines: str) -> Markup:
    """Return text of several lines as it stands, below a title."""
    return Markup(
        f'<details open><summary style="font-family:monospace">{_text(title)}</summary>'
        f"<pre>{_text(lines)}</pre></details>"
    )


def of_system(system: Any) -> Markup:
    """Return the table of a system's parts."""
    names = ("coordinates", "unknowns", "constraints", "nonholonomic", "invariants")
    parts = {name: tuple(getattr(system, name, ())) for name in names}
    if not parts["coordinates"]:
        parts["components"] = (str(system.size),)
    # they are among the constraints
    own = parts.pop("nonholonomic")
    parts["constraints"] = tuple(
        f"{name} (nonholonomic)" if name in own else name for name in parts["constraints"]
    )
    params = {"parameters": tuple(f"{name} = {_numbers(x)}" for name, x in system.params.items())}
    return facts(repr(system), parts | params)


def of_solution(solution: Solution) -> Markup:
    """Return the arrays of a solution: shapes, ends and how they look."""
    if not solution.t.size:
        return table(repr(solution), [])
    unit = f" ({solution.units['t']})" if "t" in solution.units else ""
    t, rows = solution.t, [("t" + unit, _shape(solution.t), _ends(solution.t), "")]
    columns = dict(solution.states)
    for group in (solution.invariants, solution.balance, solution.observed):
        columns |= {name: x for name, x in group.items() if name not in columns}
    is_many = solution.members is not None
    named = {name: f"{name} ({unit})" for name, unit in solution.units.items()}
    rows += [
        (named.get(name, name), _shape(x), _ends(x, is_many), sparkline(x))
        for name, x in columns.items()
    ]
    kept = {f"|{name}|": np.abs(x) for name, x in solution.residuals.items() if x.size}
    rows += [(name, _shape(x), f"at most {_most(x)}", sparkline(x)) for name, x in kept.items()]
    drifts = {name: solution.invariant_drift(name) for name in solution.invariants}
    kinds = {x: "change" if x in solution.changing else "drift" for x in drifts}
    words = {x: f"{kind} of {x}{solution.drift_words(x)}" for x, kind in kinds.items()}
    rows += [(words[name], "", f"at most {_most(x)}", "") for name, x in drifts.items()]
    rows += [(f"event {name}", f"{len(x)}", "", "") for name, x in solution.events.items()]
    rows += [(f"contact {name}", x.counted, "", "") for name, x in solution.contacts.items()]
    rows += [("params", "", _listed(_params(solution)), "")] if solution.params else []
    rows += [("message", "", solution.message, "")] if solution.message else []
    rows += [("folder", "", solution.path, "")] if solution.path is not None else []
    return table(solution.headline, rows, ("name", "shape", f"t = {t[0]:g} → {t[-1]:g}", ""))


def described(values: NDArray[Any]) -> tuple[str, str]:
    """Return shape and ends of an array for a table."""
    return _shape(values), _ends(values) if values.size else ""


def sparkline(values: NDArray[Any]) -> Markup:
    """Draw columns against their row as a small picture; those of members after one another."""
    columns = np.abs(values) if values.dtype.kind == "c" else values
    columns = columns.reshape(len(columns), -1)
    if len(columns) < 2 or not columns.shape[1]:
        return Markup("")
    chosen = np.linspace(0, columns.shape[1] - 1, min(CURVES, columns.shape[1])).astype(int)
    at = np.linspace(0, len(columns) - 1, min(POINTS, len(columns))).round().astype(int)
    shown = columns[np.ix_(at, chosen)]
    shown = np.where(np.isfinite(shown), shown, np.nan)
    if np.isnan(shown).all():
        return Markup("")
    low, high = np.nanmin(shown), np.nanmax(shown)
    with np.errstate(over="ignore", invalid="ignore"):
        part = (shown - low) / (high - low) if high > low else np.where(np.isnan(shown), shown, 0.5)
    x = 1 + (WIDTH - 2) * at / max(1, at[-1])
    y = 1 + (HEIGHT - 2) * (1 - part)
    paths = "".join(f'<path d="{_path(x, column)}"/>' for column in y.T)
    return Markup(
        f'<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" fill="none" '
        f'stroke="currentColor" stroke-opacity="0.7" role="img" aria-hidden="true">{paths}</svg>'
    )


def page(title: str, parts: Iterable[str]) -> str:
    """Return a whole page, which needs nothing else; all text is escaped but for `Markup`."""
    body = "\n".join(
        part if isinstance(part, Markup) else f"<p>{_text(part)}</p>" for part in parts
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}'
        '</title><meta name="viewport" content="width=device-width">\n'
        "<style>:root{color-scheme:light dark}body{font-family:sans-serif;max-width:70em;"
        "margin:2em auto;padding:0 1em}div{overflow-x:auto}pre{white-space:pre-wrap}"
        "img{max-width:100%;background:white}"
        f"</style></head>\n<body>\n<h1>{escape(title)}</h1>\n{body}\n</body></html>\n"
    )


def heading(words: str) -> Markup:
    """Return a heading of a part of a page."""
    return Markup(f"<h2>{_text(words)}</h2>")


def picture(kind: str, encoded: str, words: str) -> Markup:
    """Return a picture that is part of the page, given in base 64."""
    return Markup(f'<img alt="{_text(words)}" src="data:image/{kind};base64,{encoded}">')


def _row(tag: str, cells: Sequence[str]) -> str:
    inside = "".join(f'<{tag} style="{CELL}">{_text(cell)}</{tag}>' for cell in cells)
    return f"<tr>{inside}</tr>"


def _text(words: str) -> str:
    return words if isinstance(words, Markup) else escape(words).replace("\n", "<br>")


def _path(x: NDArray[Any], y: NDArray[Any]) -> str:
    """Give a curve as the path of a picture, with gaps where it has no number."""
    words, pen = [], "M"
    for across, up in zip(x, y, strict=True):
        if np.isnan(up):
            pen = "M"
            continue
        words.append(f"{pen}{across:.1f} {up:.1f}")
        pen = "L"
    return "".join(words)


def _params(solution: Solution) -> list[str]:
    return [
        f"{name} = {_numbers(np.asarray(x)[:1])} ... for each member"
        if name in solution.varied
        else f"{name} = {_numbers(x)}"
        for name, x in solution.params.items()
    ]


def _listed(names: Any) -> str:
    """Give names one after another, of very many the first."""
    words = [str(name) for name in names]
    shown = ", ".join(words[:NAMES])
    return f"{shown} and {len(words) - NAMES} more" if len(words) > NAMES else shown


def _shape(values: NDArray[Any]) -> str:
    return str(values.shape).replace(",)", ")")


def _ends(values: NDArray[Any], is_many: bool = False) -> str:
    """Give the first row and the last one, of members their medians."""
    ends = values[[0, -1]]
    if is_many:
        ends = np.abs(ends) if ends.dtype.kind == "c" else ends
        with catch_warnings(action="ignore", category=RuntimeWarning):  # all of them have failed
            ends = np.nanmedian(ends, axis=1)
    return f"{'median ' * is_many}{_numbers(ends[0])} → {_numbers(ends[1])}"


def _most(values: NDArray[Any]) -> str:
    return f"{np.fmax.reduce(values, axis=None, initial=0.0):.1e}"


def _numbers(values: Any) -> str:
    """Give a number, or a row of them, of many the first."""
    flat = np.ravel(values)
    words = ", ".join(_number(x) for x in flat[:NUMBERS])
    if not np.ndim(values):
        return words
    return f"({words}, ...)" if flat.size > NUMBERS else f"({words})"


def _number(x: Any) -> str:
    return f"{x.real:.4g}{x.imag:+.4g}i" if isinstance(x, complex) else f"{x:.4g}"
