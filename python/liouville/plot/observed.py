"""The panel of what was observed along a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from liouville._basics.errors import hinted
from liouville._solution.solution import Array, Solution
from liouville.plot.canvas import names_of, text
from liouville.plot.curves import draw_curves, of_solution
from liouville.plot.fans import chosen

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@of_solution
def observed(
    solution: Solution,
    names: Sequence[str] | None = None,
    *,
    fan: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw what ``observe=`` recorded against time.

    Parameters
    ----------
    solution : Solution
        What to draw. Of an ensemble are drawn up to 50 members, evenly chosen.
    names : sequence of str, optional
        Names in ``solution.observed``; by default those with one real number at a time. An
        observable with j numbers has j curves.
    fan : bool, default False
        Of an ensemble, draw the median and the bands that half of all members and 90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With its curves.

    Raises
    ------
    ValueError
        Nothing of one of these names was observed, or it is complex; or a fan is of a single run.
    TypeError
        The names are one string.
    """
    wanted = names_of(names, [*scalars(solution)], [*solution.observed], "observable")
    columns: dict[str, Array] = {}
    for name in wanted:
        values = solution.observed[name]
        if values.dtype.kind == "c":
            hint = "plot.autocorrelation draws that of a wave function"
            raise ValueError(hinted(f"{name!r} is complex and has no curve", hint))
        if values.ndim == _ndim(solution):
            columns[name] = values
        else:
            columns |= {f"{name}{j}": values[..., j] for j in range(values.shape[-1])}
    columns, note = chosen(solution, columns, fan)
    return draw_curves(
        ax, solution.t, columns, f"observed{note}", ", ".join(map(text, wanted[:3])), fan
    )


def scalars(solution: Solution) -> dict[str, Array]:
    """Return the observables with one real number at each time."""
    return {
        name: values
        for name, values in solution.observed.items()
        if values.dtype.kind != "c" and values.ndim == _ndim(solution)
    }


def _ndim(solution: Solution) -> int:
    return 1 if solution.members is None else 2
