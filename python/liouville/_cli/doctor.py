"""``liouville doctor``: what is installed, and what the machine gives."""

from __future__ import annotations

import importlib
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

import typer

from liouville._basics.arguments import memory
from liouville._cli.screen import DONE, FAILED, headed, show
from liouville._runs.runner import processors

#: The packages of each extra.
EXTRAS = {
    "analysis": ("scipy",),
    "plot": ("matplotlib", "pillow"),
    "io": ("google-crc32c", "h5netcdf", "h5py", "scipy", "xarray", "zarr"),
    "parquet": ("pyarrow",),
    "cli": ("rich", "typer"),
    "fem": ("scikit-fem",),
    "robots": ("mujoco-core",),
    "sympy": ("sympy",),
}

#: Instruction sets that the core is compiled for, the widest first, and NumPy's names of what each
#: needs: those of NumPy 2.4 on, and those before.
WIDEST = {
    "AVX-512 (x86-64-v4)": ({"X86_V4"}, {"AVX512F", "AVX512CD", "AVX512_SKX"}),
    "AVX2 (x86-64-v3)": ({"X86_V3"}, {"AVX2", "FMA3"}),
    "NEON": ({"ASIMD"},),
}


def diagnose() -> None:
    """Show versions, missing extras, instruction set, threads and available memory.

    The exit code is 1 where the core does not load, and 0 else.
    """
    core, is_loaded = _core()
    table = headed("what", "found", "")
    table.add_row("liouville", core)
    table.add_row("Python", f"{platform.python_version()}, {sys.executable}")
    table.add_row("machine", f"{platform.system()} {platform.machine()}")
    for name in ("numpy", "casadi"):
        table.add_row(name, _version(name) or "missing")
    wanted = {name: [e for e, named in EXTRAS.items() if name in named]
              for packages in EXTRAS.values() for name in packages}  # fmt: skip
    for name, extras in wanted.items():
        found = _version(name)
        hint = "" if found else f'pip install "liouville[{extras[0]}]"'
        table.add_row(name, found or "missing", hint)
    table.add_row("instructions", _instructions(_features()))
    table.add_row("threads", str(processors()))
    table.add_row("memory", f"{memory() / 2**30:.1f} GiB available")
    show(table)
    raise typer.Exit(DONE if is_loaded else FAILED)


def _core() -> tuple[str, bool]:
    """Return the version of the core, or why it does not load."""
    try:
        return str(importlib.import_module("liouville._core").VERSION), True
    except ImportError as error:
        return f"the core does not load: {error}", False


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _features() -> set[str]:
    """Return NumPy's description of this processor; nothing where there is none."""
    try:
        found = importlib.import_module("numpy._core._multiarray_umath").__cpu_features__
    except (ImportError, AttributeError):
        return set()
    return {name for name, is_there in found.items() if is_there}


def _instructions(features: set[str]) -> str:
    """Name the widest instructions that the core takes of those of a processor."""
    if not features:
        return "not known"
    for name, ways in WIDEST.items():
        if any(way <= features for way in ways):
            return name
    return "the least of its kind, without wide registers"
