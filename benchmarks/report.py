"""Tables of benchmark results, printed and written with the machine they were taken on."""

import json
import os
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).resolve().parent / "results"


def processor() -> str:
    """Return the processor's name, where the system tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def surroundings(packages: Sequence[str] = ()) -> dict[str, Any]:
    """Return what figures depend on besides the code: machine, load and versions."""
    return {
        "taken": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": processor(),
        "cores": os.cpu_count(),
        "load": [round(x, 2) for x in os.getloadavg()],
        "platform": platform.platform(),
        "python": platform.python_version(),
        **{name: installed(name) for name in ("liouville", "casadi", "numpy", *packages)},
    }


def installed(name: str) -> str | None:
    """Return a package's version, None if it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def publish(name: str, rows: Sequence[dict[str, Any]], packages: Sequence[str] = ()) -> None:
    """Print rows as a Markdown table and write them to results/<name>.json."""
    header = list(dict.fromkeys(key for row in rows for key in row))
    cells = [[_text(row.get(key)) for key in header] for row in rows]
    widths = [max(map(len, column)) for column in zip(header, *cells, strict=True)]
    print(_line(header, widths))
    print("|" + "|".join("-" * (width + 2) for width in widths) + "|")
    print(*(_line(row, widths) for row in cells), sep="\n")
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    result = {"surroundings": surroundings(packages), "rows": list(rows)}
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(f"\n{processor()}; written to {path.relative_to(RESULTS.parent.parent)}")


def _text(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = (f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
    return f"| {' | '.join(padded)} |"
