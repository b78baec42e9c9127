"""Write what was measured into the tables of docs/benchmarks.md.

A table stands between two comments, ``<!-- table NAME -->`` and ``<!-- end -->``, and is made of
results/NAME.json, with the machine and the date under it; one that has not been measured stays as
it is. ``<!-- table NAME: error, ms -->`` has these columns alone, ``<!-- table NAME; error 0.001
-->`` the rows with this cell. The table ``versions`` has those of all codes. The figure is drawn
from the first table of the page. Run as ``python benchmarks/tables.py`` to rewrite page and figure,
or with the name of a file to write a copy of the page.
"""

import argparse
import json
import math
import re
from pathlib import Path
from textwrap import wrap

import matplotlib.pyplot as plt
from report import RESULTS

from liouville.plot import STYLE

ROOT = RESULTS.parent.parent
PAGE = ROOT / "docs" / "benchmarks.md"
FIGURE = PAGE.parent / "_static" / "work_precision.png"
TABLE = re.compile(
    r"<!-- table (\w+)(?:: ([^;]*?))?(?:; (\w+) (\S+))? -->\n(.*?)<!-- end -->", re.DOTALL
)
WIDEST = 160  # characters of a line that is no table
NO_VERSIONS = ("taken", "processor", "cores", "load", "platform")
LINES = {  # of each code: ours in full, those for ordinary differential equations dotted
    "Spark": ("tab:red", "-"),
    "Spark to tolerance": ("tab:pink", "-"),
    "LobattoPair": ("tab:orange", "-"),
    "IDA in C": ("black", "--"),
    "IDA, scikit-sundae": ("tab:gray", "--"),
    "CasADi IDAS": ("tab:green", "--"),
    "scipy_dae": ("tab:purple", "--"),
    "Exudyn": ("tab:brown", "--"),
    "heyoka": ("tab:blue", ":"),
    "diffrax": ("tab:cyan", ":"),
}


def text(value):
    """Return a cell: three digits of a number, a dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "\N{EN DASH}"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def table(found, wanted=None, key=None, cell=None):
    """Return the lines of a table and of what it was taken on.

    Columns are those `wanted` if any, rows those with this `cell` in the column `key` if any.
    """
    columns = list(dict.fromkeys(key for row in found["rows"] for key in row))
    columns = [column for column in columns if not wanted or column in wanted]
    yield f"| {' | '.join(columns)} |"
    yield "|" + "---|" * len(columns)
    for row in found["rows"]:
        if key is None or text(row.get(key)) == cell:
            yield f"| {' | '.join(text(row.get(key)) for key in columns)} |"
    place = found["surroundings"]
    yield ""
    yield f"*{place['processor']}, {place['cores']} cores, {place['taken'][:10]}.*"


def versions(known, results):
    """Return the lines of all versions, those of the results in the place of older ones."""
    found = dict(part.rsplit(" ", 1) for part in " ".join(known.split()).strip("*.").split(", "))
    for result in results:
        place = result["surroundings"]
        found |= {k: v for k, v in place.items() if v and k not in NO_VERSIONS}
    line = ", ".join(f"{name} {version}" for name, version in sorted(found.items()))
    yield from wrap(f"*{line}.*", WIDEST, break_on_hyphens=False)


def filled(page):
    """Return the page with all tables that there are results for."""
    measured = {}
    for found in TABLE.finditer(page):
        path = RESULTS / f"{found[1]}.json"
        if path.exists():
            measured[found[1]] = json.loads(path.read_text(encoding="utf-8"))

    def fill(found):
        name, columns, key, cell, known = found.groups()
        opening = found[0].partition("\n")[0]
        if name == "versions":
            lines = versions(known, measured.values())
        elif name in measured:
            lines = table(measured[name], columns and columns.split(", "), key, cell)
        else:
            return found[0]
        return "\n".join([opening, *lines, "<!-- end -->"])

    return TABLE.sub(fill, page)


def drawn(page):
    """Return a figure of the table of work against precision, a panel a problem."""
    (found,) = (x[0] for x in TABLE.finditer(page) if x[1] == "work_precision")
    head, _, *rows = (line.strip("| ").split(" | ") for line in re.findall(r"^\|.*", found, re.M))
    rows = [dict(zip(head, row, strict=True)) for row in rows]
    names = list(dict.fromkeys(row["problem"] for row in rows))
    plt.style.use(STYLE)
    count = -(-(len(names) + 1) // 3)  # the last panel has the names
    figure, axes = plt.subplots(count, 3, figsize=(9, 2.8 * count), squeeze=False)
    for axis, name in zip(axes.flat, names, strict=False):
        for code, (colour, line) in LINES.items():
            cells = [(row["error"], row[code]) for row in rows if row["problem"] == name]
            points = [(float(x), float(y)) for x, y in cells if y != text(None)]
            if points:
                axis.loglog(*zip(*points, strict=True), line, marker=".", color=colour, label=code)
        axis.set(title=name, xlabel="error of positions", xlim=(3e-3, 3e-13))
    for axis in axes[:, 0]:
        axis.set_ylabel("milliseconds")
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    curves = {line.get_label(): line for axis in axes.flat for line in axis.lines}
    axes.flat[-1].legend(curves.values(), curves, loc="center left")
    return figure


def main():
    """Rewrite the page or write a copy."""
    parser = argparse.ArgumentParser(description="write the tables of docs/benchmarks.md")
    parser.add_argument("target", nargs="?", type=Path, default=PAGE, help="where to write them")
    target = parser.parse_args().target
    target.parent.mkdir(parents=True, exist_ok=True)
    page = filled(PAGE.read_text(encoding="utf-8"))
    target.write_text(page, encoding="utf-8")
    if target == PAGE:
        drawn(page).savefig(FIGURE, dpi=150)
    print(f"tables written to {target}")


if __name__ == "__main__":
    main()
