"""Draw the figure of docs/benchmarks.md from its first table."""

from pathlib import Path

import matplotlib.pyplot as plt
from report import read

from liouville.plot import STYLE

DOCS = Path(__file__).resolve().parent.parent / "docs"
FIGURE = DOCS / "_static" / "work_precision.png"
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


def drawn(rows):
    """Return a figure of work against precision, a panel a problem."""
    names = list(dict.fromkeys(row["problem"] for row in rows))
    plt.style.use(STYLE)
    count = -(-(len(names) + 1) // 3)  # the last panel has the names
    figure, axes = plt.subplots(count, 3, figsize=(9, 2.8 * count), squeeze=False)
    for axis, name in zip(axes.flat, names, strict=False):
        for code, (colour, line) in LINES.items():
            cells = [(row["error"], row[code]) for row in rows if row["problem"] == name]
            points = [(float(x), float(y)) for x, y in cells if y]
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


if __name__ == "__main__":
    drawn(read(DOCS / "measured" / "work_precision.csv")).savefig(FIGURE, dpi=150)
