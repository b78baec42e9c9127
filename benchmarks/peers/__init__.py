"""Other codes on the library's problems, each with ``run(setting) -> (seconds, q, v)``.

A setting is a tolerance, or a number of steps for codes that take equal ones. What a code needs
once (symbols, C, compilers, warm functions) is done before; only the integration is timed.
"""

import sys
from importlib import import_module


def installed(kind, *given):
    """Yield what codes for robots run that are installed: ``runs(*given)`` of ``code_kind``."""
    for name in ("MuJoCo", "Exudyn", "Drake"):
        try:
            found = import_module(f"peers.{name.lower()}_{kind}")
        except ImportError as trouble:
            print(f"{name} is left out: {trouble}", file=sys.stderr)
            continue
        yield from found.runs(*given)
