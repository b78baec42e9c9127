"""Write what was measured into the tables of docs/benchmarks.md.

A table stands between two comments, ``<!-- table NAME -->`` and ``<!-- end -->``, and is made of
results/NAME.json, with the machine, the date and the versions under it; one that has not been
measured stays as it is. The figure is drawn from the first table of the page. Run as
``python benchmarks/tables.py`` to rewrite page and figure, or with the name of a file to write a
copy of the page.
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
TABLE = re.compile(r"<!-- table (\w+) -->\n.*?<!-- end -->", re.DOTALL)
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
