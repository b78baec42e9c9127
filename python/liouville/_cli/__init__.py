"""The command line: ``run``, ``resume``, what is done with a saved run, studies and lists.

Results go to standard output and everything else to standard error. Exit codes: 0 done, 1 a run
failed (what was computed before is saved and drawn all the same), 2 a wrong call, 130 interrupted
(saved and drawn too). Nothing else in the package prints.
"""

from __future__ import annotations

import sys
from typing import Annotated

try:
    import rich as rich
    import typer as typer
except ImportError as error:
    raise ImportError(
        'the command line needs typer and rich\nhint: pip install "liouville[cli]"'
    ) from error

from liouville import _core
from liouville._cli.doctor import diagnose
from liouville._cli.integrating import resume, run
from liouville._cli.listing import list_methods, list_problems
from liouville._cli.planning import show_plan
from liouville._cli.saved import convert, draw, report, show
from liouville._cli.screen import WRONG, complain
from liouville._cli.studying import order

app = typer.Typer(
    help="Integrate mechanisms, polynomial fields and wave functions, and keep their structure.",
    pretty_exceptions_enable=False,
)


def show_version(is_asked: bool) -> None:
    """Print the version and leave, if it is asked for."""
    if is_asked:
        print(f"liouville {_core.VERSION}")
        raise typer.Exit


@app.callback()
def general_options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", callback=show_version, is_eager=True),
    ] = False,
) -> None:
    """Take the options that stand before a command."""
    del version  # its callback has done it


app.command()(run)
app.command()(resume)
app.command()(order)
app.command()(show)
app.command("plot")(draw)
app.command()(convert)
app.command()(report)
app.command("plan")(show_plan)
app.command("problems")(list_problems)
app.command("methods")(list_methods)
app.command("doctor")(diagnose)


def main() -> None:
    """Run the command line and leave with its exit code."""
    try:
        code = app(prog_name="liouville", standalone_mode=False)
    except Exception as error:
        # Only a call that typer could not read is formatted: its class has moved between versions.
        if not hasattr(error, "format_message"):
            raise
        command = getattr(getattr(error, "ctx", None), "command_path", "liouville")
        message = error.format_message().rstrip(".")
        complain(f"{message}\nhint: {command} --help shows what there is")
        code = WRONG
    sys.exit(code)
