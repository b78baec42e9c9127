"""Run the tests that compare with numbers of another code, or with bits, under two BLAS kernels.

``python tools/kernels.py`` runs them under OpenBLAS' oldest kernel with NumPy's instructions down
to its baseline, and under the newest that the processor has; ``--list`` prints which tests.

Roundings of NumPy, SciPy and LAPACK differ from processor to processor, and a reference that is not
good enough, or an answer that is right by luck, passes on one and fails on another. The tests are
found in their text: those that use what SciPy, ``ordinary`` or ``golden`` give, LAPACK by NumPy,
the references of problems, or bytes, by themselves or by a function or fixture of their file.
"""

# ruff: noqa: T201

import argparse
import ast
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

TESTS = Path(__file__).resolve().parent.parent / "tests"

#: Modules whose numbers are of another code, or stored.
MODULES = {"scipy", "ordinary", "golden"}

#: Attributes that stand for the same: LAPACK by NumPy or the library, references of problems, bits.
ATTRIBUTES = {"linalg", "consistent", "reference", "tobytes"}


def compared(path: Path) -> list[str]:
    """Return the names of the tests of a file that compare with such numbers."""
    used: dict[str, set[str]] = {}
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            found |= set(imported(node))
            continue
        names = {x.id for x in ast.walk(node) if isinstance(x, ast.Name)}
        names |= {x.arg for x in ast.walk(node) if isinstance(x, ast.arg)}
        attributes = {x.attr for x in ast.walk(node) if isinstance(x, ast.Attribute)}
        for own in defined(node):
            used[own] = names
            if attributes & ATTRIBUTES:
                found.add(own)
    size = -1
    while len(found) > size:
        size = len(found)
        found |= {own for own, names in used.items() if names & found}
    return [own for own in used if own.startswith("test_") and own in found]


def imported(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    """Give the names by which a file has one of the modules."""
    for alias in node.names:
        module = node.module if isinstance(node, ast.ImportFrom) else alias.name
        if (module or "").partition(".")[0] in MODULES:
            yield (alias.asname or alias.name).partition(".")[0]


def defined(node: ast.stmt) -> Iterator[str]:
    """Give the names that a statement of a file makes."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        yield node.name
    elif isinstance(node, ast.Assign):
        yield from (x.id for target in node.targets for x in ast.walk(target) if hasattr(x, "id"))


def kernels() -> dict[str, dict[str, str]]:
    """Return the environments of two kernels, the farthest apart that the processor has."""
    core = np._core._multiarray_umath
    present = [name for name in core.__cpu_dispatch__ if core.__cpu_features__.get(name)]
    oldest = {"NPY_DISABLE_CPU_FEATURES": " ".join(present)} if present else {}
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return {"ARMV8": {"OPENBLAS_CORETYPE": "ARMV8", **oldest}, "its own": {}}
    newest = {}
    if core.__cpu_features__.get("AVX512_SKX"):
        newest = {"OPENBLAS_CORETYPE": "SkylakeX"}
    return {
        "Prescott": {"OPENBLAS_CORETYPE": "Prescott", **oldest},
        newest.get("OPENBLAS_CORETYPE", "its own"): newest,
    }


def main() -> int:
    """Read the command line and run the tests."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", action="store_true", help="print the tests and run none")
    parser.add_argument("pytest", nargs="*", help="options for pytest, after --")
    given = parser.parse_args()
    tests = [f"{x}::{name}" for x in sorted(TESTS.glob("test_*.py")) for name in compared(x)]
    if given.list:
        print(*(Path(x).name for x in tests), sep="\n")
        return 0
    dropped = {"OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE", "NPY_DISABLE_CPU_FEATURES"}
    inherited = {name: value for name, value in os.environ.items() if name not in dropped}
    worst = 0
    for name, environment in kernels().items():
        print(f"under the kernel {name}:", flush=True)
        command = [sys.executable, "-m", "pytest", "-q", *given.pytest, *tests]
        worst |= subprocess.run(command, env=inherited | environment, check=False).returncode
    return worst


if __name__ == "__main__":
    raise SystemExit(main())
