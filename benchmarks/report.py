"""Tables of benchmark results: printed, and written as the files that the documentation shows."""

import csv
import os
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

#: Where tables and figures go: ``MEASURED=docs/measured`` puts them into the documentation.
FOLDER = Path(
    os.environ.get("MEASURED") or Path(__file__).resolve().parent.parent / "build" / "measured"
)
Row = dict[str, Any]


def processor() -> str:
    """Return the processor's name, where the system tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def surroundings(packages: Sequence[str] = ()) -> Row:
    """Return the date, the machine and the versions that figures were taken with."""
    versions = {name: installed(name) for name in ("liouville", "casadi", "numpy", *packages)}
    versions["python"] = platform.python_version()
    return {
        "taken": datetime.now(UTC).date().isoformat(),
        "processor": processor(),
        "cores": os.cpu_count(),
        "versions": ", ".join(f"{name} {found}" for name, found in versions.items() if found),
    }


def installed(name: str) -> str | None:
    """Return a package's version, None if it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def show(rows: Sequence[Row]) -> None:
    """Print rows as a Markdown table."""
    header, cells = _cells(rows)
    widths = [max(map(len, column)) for column in zip(header, *cells, strict=True)]
    print(_line(header, widths))
    print("|" + "|".join("-" * (width + 2) for width in widths) + "|")
    print(*(_line(row, widths) for row in cells), sep="\n")


def publish(
    name: str,
    rows: Sequence[Row],
    packages: Sequence[str] = (),
    columns: Sequence[str] | None = None,
) -> None:
    """Print rows, and write these columns of them, by default all, to NAME.csv.

    The file ``taken.csv`` beside it says when and where, and with which versions of the packages.
    """
    show(rows)
    found = [{key: row.get(key) for key in columns} for row in rows] if columns else rows
    path, taken = FOLDER / f"{name}.csv", FOLDER / "taken.csv"
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(path, found)
    known = {row["table"]: row for row in read(taken)} if taken.exists() else {}
    known[name] = {"table": name, **surroundings(packages)}
    write(taken, [known[key] for key in sorted(known)])
    print(f"\nwritten to {path}")


def read(path: Path) -> list[Row]:
    """Return the rows of a table that was published, their cells as text."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write rows as a CSV file."""
    with path.open("w", encoding="utf-8", newline="") as file:
        header, cells = _cells(rows)
        csv.writer(file, lineterminator="\n").writerows([header, *cells])


def _cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Return the header, and the cells: three digits of a number, empty where there is none."""
    header = list(dict.fromkeys(key for row in rows for key in row))
    return header, [[_text(row.get(key)) for key in header] for row in rows]


def _text(value: Any) -> str:
    if value is None or value != value:  # NaN
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = (f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
    return f"| {' | '.join(padded)} |"
