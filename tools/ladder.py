"""Compute the ladder: shears whose step is as long as possible for the error it may make.

``python tools/ladder.py table [FILE]`` computes the error tables of a list of methods again, from
their coefficients rounded to doubles, and writes the list.
"""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from shears import FRACTIONS, error_tables, gain

TABLE = Path(__file__).parent.parent / "crates/core/src/tableau/ladder/table.txt"
HEAD = """\
# The ladder: q <- q + c h H p and p <- p - c h H q in turn, with c the coefficients.
# method: name, stable or fast, ratio, theta, gain. Then the coefficients, and the largest errors on
# [0, f theta] for the fractions f. Written by tools/ladder.py, which says what the errors are.
"""


@dataclass(frozen=True)
class Method:
    """A sequence of shears, by digits, for 0 <= x <= theta."""

    name: str
    is_stable: bool
    ratio: float
    theta: float
    digits: tuple[str, ...]

    @property
    def coefficients(self) -> list[float]:
        """The digits as doubles."""
        return [float(digits) for digits in self.digits]


def read(path: Path) -> Iterator[Method]:
    """Return the methods of a table; what it says of their errors is not read."""
    text = path.read_text(encoding="utf-8")
    for block in text.split("method ")[1:]:
        (name, kind, ratio, theta, _), *lines = (line.split() for line in block.splitlines())
        digits = [word for line in lines if line[0] == "c" for word in line[1:]]
        yield Method(name, kind == "stable", float(ratio), float(theta), tuple(digits))


def write(path: Path, methods: Iterable[Method]) -> None:
    """Write a table of methods and their errors, short steps first."""
    lines = [HEAD, "fractions " + " ".join(f"{f:g}" for f in FRACTIONS)]
    for method in sorted(methods, key=lambda method: (len(method.digits), method.theta)):
        kind = "stable" if method.is_stable else "fast"
        growth = gain(method.coefficients, method.theta)
        lines.append(f"method {method.name} {kind} {method.ratio:g} {method.theta} {growth:.3g}")
        rows = range(0, len(method.digits), 4)
        lines += ["c " + " ".join(method.digits[row : row + 4]) for row in rows]
        tables = error_tables(method.coefficients, method.theta)
        for key, table in zip(("err", "dphi", "kappa"), tables, strict=True):
            lines.append(f"{key} " + " ".join(f"{value:.3g}" for value in table))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("table").add_argument("file", nargs="?", type=Path, default=TABLE)
    arguments = parser.parse_args()
    write(arguments.file, list(read(arguments.file)))


if __name__ == "__main__":
    main()
