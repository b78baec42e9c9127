"""Records of what contacts did in a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from liouville._basics.errors import Suggesting

Array = NDArray[Any]

#: What is known of a contact at each record.
COLUMNS = ("mode", "gap", "normal", "friction", "slip")

#: How many contacts a solution shows by name.
SHOWN = 8

#: The kinds of changes, and the words for several of them.
KINDS = {
    "hit": "hits",
    "close": "closings",
    "leave": "departures",
    "stick": "stops",
    "slip": "slips",
}


@dataclass(frozen=True)
class Change(Suggesting):
    """A change of a contact.

    Attributes
    ----------
    t : float
        Its time.
    kind : str
        ``"hit"``, ``"close"`` (without an impulse, as where bounces have died down), ``"leave"``,
        ``"stick"`` or ``"slip"``.
    normal, friction : float
        The impulses of a hit, 0 otherwise.
    rest : float or None
        Where bounces have died down, when the last of infinitely many ends.
    """

    t: float
    kind: str
    normal: float = 0.0
    friction: float = 0.0
    rest: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class ContactRecord(Suggesting):
    """One contact in a run.

    Attributes
    ----------
    mode : ndarray of Mode, shape (k,) or (k, P)
        What it does at each record, with a ``name``; at a change what it does after it. Of an
        ensemble None where a member did not come to.
    gap, normal, friction, slip : ndarray, shape (k,) or (k, P)
        The gap, the normal force, the friction force and the slip at each record.
    changes : tuple of Change
        Its changes in the order of time; of an ensemble a tuple of them for each member.
    """

    mode: Array
    gap: Array
    normal: Array
    friction: Array
    slip: Array
    changes: tuple[Any, ...]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in COLUMNS:
            getattr(self, name).setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickle, its arrays read-only."""
        self.__dict__.update(state)
        self.__post_init__()

    def __repr__(self) -> str:
        """Return how often it changed."""
        return f"<ContactRecord: {self.counted}>"

    def between(self, rows: slice, low: float, high: float) -> ContactRecord:
        """Return these records, and the changes from one time to another."""

        def inside(changes: tuple[Change, ...]) -> tuple[Change, ...]:
            return tuple(change for change in changes if low <= change.t <= high)

        found: tuple[Any, ...] = (
            inside(self.changes) if self.mode.ndim == 1 else tuple(map(inside, self.changes))
        )
        columns = {name: getattr(self, name)[rows] for name in COLUMNS}
        return replace(self, changes=found, **columns)

    def of_member(self, member: int, count: int) -> ContactRecord:
        """Return the first records of a member of an ensemble."""
        columns = {name: getattr(self, name)[:count, member] for name in COLUMNS}
        return replace(self, changes=self.changes[member], **columns)

    @property
    def each(self) -> list[tuple[int, Change]]:
        """All changes with the number of the member, 0 of a single run."""
        members = [self.changes] if self.mode.ndim == 1 else self.changes
        return [(k, change) for k, own in enumerate(members) for change in own]

    @property
    def counted(self) -> str:
        """How many changes there were of each kind."""
        return _counted([self])


def counts_of(contacts: Mapping[str, ContactRecord]) -> list[tuple[str, str]]:
    """Return contacts, by name as far as they are few, and how often they changed."""
    shown = [name for name, record in contacts.items() if any(record.each)][:SHOWN]
    found = [(f"contact '{name}'", contacts[name].counted) for name in shown]
    rest = [record for name, record in contacts.items() if name not in shown]
    if rest:
        what = f"{len(rest)} {'other ' if shown else ''}contact{'s' if len(rest) > 1 else ''}"
        found.append((what, _counted(rest)))
    return found


def _counted(records: Iterable[ContactRecord]) -> str:
    kinds = Counter(change.kind for record in records for _, change in record.each)
    found = [
        f"{kinds[kind]} {word if kinds[kind] > 1 else word[:-1]}"
        for kind, word in KINDS.items()
        if kinds[kind]
    ]
    return ", ".join(found) or "no changes"
