"""Records of contacts as named arrays, and back.

At each record there is a number for each contact: ``contact_mode``, ``contact_gap`` and so on. All
changes are in the order of time along ``change``: ``change_t``, the number of the contact
``change_contact``, the number of the kind ``change_kind``, impulses, and ``change_rest``, which is
NaN where bounces have not died down; of an ensemble ``change_member``. A mode is -1 where a member
did not come to. Numbers that stand for words have them as ``flag_meanings``,
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

#: What is whole numbers.
WHOLE = ("contact_mode", "change_kind", "change_contact", "change_member")

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
        if what == "mode":
            flat = [-1 if mode is None else int(mode) for mode in columns.ravel()]
            columns = np.array(flat, dtype=np.int64).reshape(columns.shape)
        yield _named(f"contact_{what}", columns)


def changes_of(contacts: Mapping[str, ContactRecord]) -> Iterator[Named]:
    """Yield the changes of all contacts, in the order of time."""
    if not contacts:
        return
    all_of = [(m, k, x) for k, own in enumerate(contacts.values()) for m, x in own.each]
    all_of.sort(key=lambda found: found[2].t)
    kinds = [*KINDS]
    rows = [
        (x.t, k, kinds.index(x.kind), x.normal, x.friction, np.nan if x.rest is None else x.rest)
        for _, k, x in all_of
    ]
    columns = np.array(rows, dtype=float).reshape(-1, len(CHANGES)).T
    for what, values in zip(CHANGES, columns, strict=True):
        whole = values.astype(np.int64) if f"change_{what}" in WHOLE else values
        yield _named(f"change_{what}", np.ascontiguousarray(whole))
    if next(iter(contacts.values())).mode.ndim > 1:
        yield _named("change_member", np.array([m for m, _, _ in all_of], dtype=np.int64))


def contacts_of(
    variables: Mapping[str, tuple[Any, Array, Any]],
    names: Sequence[str],
    members: int | None,
    where: str,
) -> dict[str, ContactRecord]:
    """Return the contacts of a file by name; ValueError where it lacks some of them."""
    if not names:
        return {}
    wanted = [f"contact_{x}" for x in COLUMNS] + [f"change_{x}" for x in CHANGES]
    wanted += ["change_member"] * (members is not None)
    for name in wanted:
        if name not in variables:
            raise ValueError(f"{where} has contacts and no {name!r}")
    arrays = {name: variables[name][1] for name in wanted}
    _check("contact_mode", arrays, (0 if members is None else -1, len(Mode)), where)
    for name, many in (("kind", len(KINDS)), ("contact", len(names)), ("member", members)):
        if many is not None:
            _check(f"change_{name}", arrays, (0, many), where)
    kinds, modes = [*KINDS], np.array([*Mode, None], dtype=object)
    changes: list[list[list[Change]]] = [[[] for _ in range(members or 1)] for _ in names]
    whose = arrays.get("change_member", np.zeros(len(arrays["change_t"]), dtype=int)).tolist()
    rows = zip(whose, *(arrays[f"change_{x}"].tolist() for x in CHANGES), strict=True)
    for member, t, k, kind, normal, friction, rest in rows:
        own = Change(t, kinds[kind], normal, friction, None if np.isnan(rest) else rest)
        changes[k][member].append(own)
    columns = {x: arrays[f"contact_{x}"] for x in COLUMNS}
    columns["mode"] = modes[columns["mode"]]
    return {
        name: ContactRecord(
            changes=tuple(changes[k][0]) if members is None else tuple(map(tuple, changes[k])),
            **{x: values[..., k] for x, values in columns.items()},
        )
        for k, name in enumerate(names)
    }


def _check(name: str, arrays: Mapping[str, Array], bounds: tuple[int, int], where: str) -> None:
    """Refuse numbers beyond bounds, of which the upper one is none of them."""
    values, (low, high) = arrays[name], bounds
    if values.size and not (values.min() >= low and values.max() < high):
        raise ValueError(f"{name!r} of {where} must be from {low} to {high - 1}")


def _named(name: str, values: Array) -> Named:
    return name, values, {"flag_meanings": _MEANINGS[name]} if name in _MEANINGS else {}
