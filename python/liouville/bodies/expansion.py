"""How many elements a file of MuJoCo's stands for: few lines may ask for many."""

from __future__ import annotations

import html
import math
import re
from pathlib import Path

#: So many elements are read at most: they take minutes.
MOST = 100_000

#: Files are within one another so often at most.
DEEPEST = 100

#: What is no element, or a tag: whether it ends one, its name, its attributes.
TOKEN = re.compile(
    r"""<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<![^>]*>"""
    r"""|<(/?)([\w:.-]+)((?:[^<>"']|"[^"]*"|'[^']*')*)>""",
    re.DOTALL,
)
ATTRIBUTE = re.compile(r"""([\w:.-]+)\s*=\s*("[^"]*"|'[^']*')""")

#: Elements that stand for as many as the product of their counts.
GRIDS = ("composite", "flexcomp")


def elements(text: str, folder: Path) -> int:
    """Return how many elements a text stands for, once all of it is repeated that is to be.

    What ``replicate`` repeats, and each file that is included or attached, is counted as often as
    MuJoCo would write it out; numbers that it will refuse count as one.
    """
    return _Counting(folder).of(text, ())


class _Counting:
    """Files that have been counted, and those that have been included, which is done once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._included: set[Path] = set()
        self._sizes: dict[Path, int] = {}

    def of(self, text: str, within: tuple[Path, ...]) -> int:
        """Return the number of elements of a text, which is of files within one another."""
        total, times = 0, [1]
        models: dict[str, str] = {}
        attached: list[tuple[str, int]] = []
        for match in TOKEN.finditer(text):
            ends, name, rest = match.groups()
            if name == "replicate" and ends:
                times = times[:-1] or [1]
            if not name or ends:
                continue
            own = {key: html.unescape(value[1:-1]) for key, value in ATTRIBUTE.findall(rest)}
            total += times[-1] * (_product(own.get("count", "")) if name in GRIDS else 1)
            if name == "replicate" and not rest.endswith("/"):
                times.append(times[-1] * _product(own.get("count", "")))
            elif name == "include":
                total += times[-1] * self._of_include(own.get("file", ""), within)
            elif name == "model":
                models[own.get("name", "")] = own.get("file", "")
            elif name == "attach":
                attached.append((own.get("model", ""), times[-1]))
            if total > MOST:
                return total
        for model, count in attached:
            total += count * self._of_model(models.get(model, ""), within)
        return total

    def _of_include(self, file: str, within: tuple[Path, ...]) -> int:
        path = self._folder / file
        if path in self._included:
            return 0  # MuJoCo refuses it
        self._included.add(path)
        return self._of_file(path, within)

    def _of_model(self, file: str, within: tuple[Path, ...]) -> int:
        path = self._folder / file
        if path not in self._sizes:
            self._sizes[path] = self._of_file(path, within)
        return self._sizes[path]

    def _of_file(self, path: Path, within: tuple[Path, ...]) -> int:
        if len(within) > DEEPEST:
            return MOST + 1
        if path in within or not path.is_file():
            return 0
        text = path.read_text(encoding="utf-8", errors="replace")
        return self.of(text, (*within, path))


def _product(text: str) -> int:
    """Return the product of whole numbers, each of which is at least one."""
    numbers = (int(word) for word in text.split() if word.isdecimal() and len(word) < 20)
    return math.prod(max(number, 1) for number in numbers)
