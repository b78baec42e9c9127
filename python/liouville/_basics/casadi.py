"""CasADi, imported at its first use: models are traced by it, and run without it.

A module that traces writes ``from liouville import _casadi as ca`` and uses it as CasADi itself.
Its one name besides is ``raw``, the module of the functions that CasADi's classes wrap.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from casadi import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Give what CasADi has under this name."""
    if name.startswith("__"):  # of Python's own
        raise AttributeError(name)
    globals()[name] = found = getattr(_imported(), "_casadi" if name == "raw" else name)
    return found


def __dir__() -> list[str]:
    """List the names of CasADi."""
    return dir(_imported())


def _imported() -> Any:
    try:
        return importlib.import_module("casadi")
    except ImportError as error:
        sentence = "models are traced and differentiated by CasADi, which cannot be imported"
        raise ImportError(f"{sentence}\nhint: pip install casadi", name="casadi") from error
