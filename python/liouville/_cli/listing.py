"""``liouville problems`` and ``liouville methods``."""

from __future__ import annotations

from dataclasses import fields

import liouville as lv
from liouville import problems
from liouville._cli.options import default_of
from liouville._cli.screen import headed, say, show, title_of
from liouville._methods import METHODS


def list_problems() -> None:
    """List the library of problems."""
    table = headed("problem", "n", "m", "until", "h", "what")
    for name in problems.names():
        module = problems.load(name)
        system, until = module.system, module.interval[1]
        n = system.size if isinstance(system, lv.Schrodinger) else len(system.coordinates)
        m, h = len(getattr(system, "constraints", ())), getattr(module, "h", None)
        step = "" if h is None else f"{h:g}"
        table.add_row(name, str(n), str(m), f"{until:g}", step, title_of(module))
    show(table)
    say(
        "n coordinates, or places of a wave function, m constraints; "
        "liouville run PROBLEM integrates one"
    )


def list_methods() -> None:
    """List the methods and their options."""
    table = headed("method", "option", "what")
    for name, method in METHODS.items():
        table.add_row(name, "", title_of(method))
        for item in fields(method):
            text = f"{item.metadata.get('help', '')}{default_of(item)}"
            table.add_row("", f"--{item.name.replace('_', '-')}", text)
    show(table)
