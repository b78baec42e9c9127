"""SciPy, imported when it is first needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from liouville._basics.errors import hinted


def scipy(module: str, what: str) -> Any:
    """Import a module of SciPy; ImportError names what needs it and the extra that has it."""
    try:
        return import_module(f"scipy.{module}")
    except ImportError as error:
        hint = 'pip install "liouville[analysis]"'
        raise ImportError(hinted(f"{what} needs SciPy", hint), name="scipy") from error
