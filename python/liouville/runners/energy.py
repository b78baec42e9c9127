"""Whether an energy that is kept, or can only fall, changes as only too large steps change it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from typing import Literal

from liouville import _core

#: A finding of a watch: see :meth:`liouville._core.EnergyWatch.found`.
Found = tuple[Literal["change", "rise", "jump"], list[float]]


def watch_of(
    columns: Mapping[str, int], start: float | None, *, roundoff: float, falls: bool
) -> _core.EnergyWatch | None:
    r"""Return a watch over the energy of records, None if they lack the columns.

    The watch finds where the energy changed by more than its own size, or jumped and stayed. The
    size of an energy that is :math:`E_0` first is :math:`|E_0|` and the mean so far of the kinetic
    energy :math:`v^T p / 2`, but not below a tenth of the present one. A jump parts all energies
    before from all after it, by a thousandth of the size and a thousand times the median change.
    What roundings of the states make of an energy near zero, as at rest, is no change.
    An energy that can only fall may rise by a fifth of its size, in however many records.

    Parameters
    ----------
    columns : mapping of str to int
        Names and widths of the columns of a record.
    start : float or None
        The energy at the start; without one, that of the first record.
    roundoff : float
        What roundings of the states change the energy by.
    falls : bool
        Whether the energy can only fall, as of methods that damp or by friction.
    """
    has_states = "v" in columns and "p" in columns
    if "invariant energy" not in columns or not (has_states or "kinetic" in columns):
        return None
    at = dict(zip(columns, accumulate(columns.values(), initial=0), strict=False))
    kinetic = (at["v"], at["p"], columns["v"]) if has_states else at["kinetic"]
    return _core.EnergyWatch(at["invariant energy"], kinetic, start, roundoff, falls)


def sentence_of(found_of: Mapping[int, Found], *, is_ensemble: bool) -> str:
    """Return a sentence on what watches have found, of one motion or of members by their number."""
    found = [(member, *what) for member, what in sorted(found_of.items())]
    if not found:
        return ""
    # the earliest change of all members before a rise or a jump of any
    changes = [each for each in found if each[1] == "change"]
    member, kind, numbers = min(changes, key=lambda each: each[2][0]) if changes else found[0]
    of = f" of member {member}" if is_ensemble else ""
    if kind == "jump":
        begin, end, part = numbers
        return (
            f"the energy{of} has jumped by {100 * part:.2g} % of its size between "
            f"t = {begin:.6g} and t = {end:.6g}: steps were too large there"
        )
    if kind == "rise":
        begin, end, low, high = numbers
        return (
            f"the energy{of}, which can only fall, has risen from {low:.3g} at t = {begin:.6g} "
            f"to {high:.3g} at t = {end:.6g}: steps were too large there"
        )
    _, t, first, now = numbers
    return (
        f"the energy{of} has changed from {first:.3g} to {now:.3g} at t = {t:.6g}, "
        "by more than its own size: steps were too large before"
    )
