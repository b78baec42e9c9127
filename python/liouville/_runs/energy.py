"""Whether an energy that is kept, or can only fall, changes as only too large steps change it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

#: What the core has found of the energy of a member; see :meth:`liouville._core.Run.found`.
Found = tuple[int, tuple[Literal["change", "rise", "jump"], list[float]]]


def sentence_of(found: Iterable[Found], *, is_ensemble: bool) -> str:
    """Return a sentence on what was found of the energy of a motion or of members."""
    each = [(member, *what) for member, what in found]
    if not each:
        return ""
    # the earliest change of all members before a jump or a rise of any
    changes = [one for one in each if one[1] == "change"]
    member, kind, numbers = min(changes or each[:1], key=lambda one: one[2][1])
    of = f" of member {member}" if is_ensemble else ""
    if kind == "jump":
        begin, end, part = numbers
        return (
            f"the energy{of} has jumped by {100 * part:.2g} % of its size between "
            f"t = {begin:.6g} and t = {end:.6g}: steps were too large there"
        )
    begin, end, before, now = numbers
    if kind == "rise":
        return (
            f"the energy{of}, which can only fall, has risen from {before:.3g} at t = {begin:.6g} "
            f"to {now:.3g} at t = {end:.6g}: steps were too large there"
        )
    return (
        f"the energy{of} has changed from {before:.3g} to {now:.3g} at t = {end:.6g}, "
        "by more than its own size: steps were too large before"
    )
