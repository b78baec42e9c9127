"""Records of contacts as named arrays, and back.

At each record there is a number for each contact: ``contact_mode``, ``contact_gap`` and so on. All
changes are in the order of time along ``change``: ``change_t``, the number of the contact
``change_contact``, the number of the kind ``change_kind``, impulses, and ``change_rest``, which is
NaN where bounces have not died down. Numbers that stand for words have them as ``flag_meanings``,
as CF has it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from liouville._solution.contacts import COLUMNS, KINDS, Array, Change, ContactRecord
from liouville._systems.mechanics.contact import Mode

#: The changes as columns.
CHANGES = ("t", "contact", "kind", "normal", "friction", "rest")

#: What is whole numbers, from 0 to below how many; of the changed contacts as many as there are.
WHOLE = {"contact_mode": len(Mode), "change_kind": len(KINDS), "change_contact": None}

_MEANINGS = {
    "contact_mode": " ".join(mode.name.lower() for mode in Mode),
    "change_kind": " ".join(KINDS),
}

#: A variable: its name, its values, its attributes.
Named = tuple[str, Array, dict[str, str]]


def columns_of(contacts: Mapping[str, ContactRecord]) -> Iterator[Named]:
    """Yield what is known of all contacts at each record."""
    for what in COLUMNS if contacts else ():
        columns = np.stack([getattr(own, what) for own in contacts.values()], axis=-1)
        yield _named(f"contact_{what}", columns)


def changes_of(contacts: Mapping[str, ContactRecord]) -> Iterator[Named]:
    """Yield the changes of all contacts, in the order of time."""
    if not contacts:
        return
    all_of = [(k, x) for k, own in enumerate(contacts.values()) for x in own.changes]
    kinds = [*KINDS]
    rows = [
        (x.t, k, kinds.index(x.kind), x.normal, x.friction, np.nan if x.rest is None else x.rest)
        for k, x in sorted(all_of, key=lambda pair: pair[1].t)
    ]
    columns = np.array(rows, dtype=float).reshape(-1, len(CHANGES)).T
    for what, values in zip(CHANGES, columns, strict=True):
        yield _named(f"change_{what}", np.ascontiguousarray(values))


def contacts_of(
    variables: Mapping[str, tuple[Any, Array, Any]], names: Sequence[str], where: str
) -> dict[str, ContactRecord]:
    """Return the contacts of a file by name; ValueError where it lacks some of them."""
    if not names:
        return {}
    arrays: dict[str, Array] = {}
    for name in (*(f"contact_{x}" for x in COLUMNS), *(f"change_{x}" for x in CHANGES)):
        if name not in variables:
            raise ValueError(f"{where} has contacts and no {name!r}")
        arrays[name] = values = variables[name][1]
        if name in WHOLE:
            count = WHOLE[name] or len(names)
            if values.size and not (values.min() >= 0 and values.max() < count):
                raise ValueError(f"{name!r} of {where} must be from 0 to {count - 1}")
    kinds, modes = [*KINDS], np.array([*Mode], dtype=object)
    changes: list[list[Change]] = [[] for _ in names]
    rows = zip(*(arrays[f"change_{x}"].tolist() for x in CHANGES), strict=True)
    for t, k, kind, normal, friction, rest in rows:
        own = Change(t, kinds[kind], normal, friction, None if np.isnan(rest) else rest)
        changes[k].append(own)
    columns = {x: arrays[f"contact_{x}"] for x in COLUMNS}
    columns["mode"] = modes[columns["mode"]]
    return {
        name: ContactRecord(
            changes=tuple(changes[k]), **{x: values[:, k] for x, values in columns.items()}
        )
        for k, name in enumerate(names)
    }


def _named(name: str, values: Array) -> Named:
    if name in WHOLE:
        values = values.astype(np.int64)
    return name, values, {"flag_meanings": _MEANINGS[name]} if name in _MEANINGS else {}
