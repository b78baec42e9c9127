"""Write what was measured into the tables of docs/benchmarks.md.

A table stands between two comments, ``<!-- table NAME -->`` and ``<!-- end -->``, and is made of
results/NAME.json, with the machine, the date and the versions under it; one that has not been
measured stays as it is. Run as ``python benchmarks/tables.py`` to rewrite the page and to take the
figure over, or with the name of a file to write a copy of the page.
"""

import argparse
import json
import math
import re
import shutil
from pathlib import Path
from textwrap import wrap

from report import RESULTS

ROOT = RESULTS.parent.parent
PAGE = ROOT / "docs" / "benchmarks.md"
FIGURE = "work_precision.png"
TABLE = re.compile(r"<!-- table (\w+) -->\n.*?<!-- end -->", re.DOTALL)
WIDEST = 160  # characters of a line that is no table
NO_VERSIONS = ("taken", "processor", "cores", "load", "platform")


def text(value):
    """Return a cell: three digits of a number, a dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "\N{EN DASH}"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def table(name):
    """Return the lines of a table and of what it was taken on."""
    found = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    columns = list(dict.fromkeys(key for row in found["rows"] for key in row))
    yield f"| {' | '.join(columns)} |"
    yield "|" + "---|" * len(columns)
    for row in found["rows"]:
        yield f"| {' | '.join(text(row.get(key)) for key in columns)} |"
    place = found["surroundings"]
    versions = ", ".join(f"{k} {v}" for k, v in place.items() if v and k not in NO_VERSIONS)
    yield ""
    line = f"*{place['processor']}, {place['cores']} cores, {place['taken'][:10]}; {versions}.*"
    yield from wrap(line, WIDEST, break_on_hyphens=False)


def filled(page):
    """Return the page with all tables that there are results for."""

    def fill(found):
        name = found[1]
        if not (RESULTS / f"{name}.json").exists():
            return found[0]
        return "\n".join([f"<!-- table {name} -->", *table(name), "<!-- end -->"])

    return TABLE.sub(fill, page)


def main():
    """Rewrite the page or write a copy."""
    parser = argparse.ArgumentParser(description="write the tables of docs/benchmarks.md")
    parser.add_argument("target", nargs="?", type=Path, default=PAGE, help="where to write them")
    target = parser.parse_args().target
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    if target == PAGE and (ROOT / "build" / FIGURE).exists():
        shutil.copyfile(ROOT / "build" / FIGURE, PAGE.parent / "_static" / FIGURE)
    print(f"tables written to {target}")


if __name__ == "__main__":
    main()
