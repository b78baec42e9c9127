"""The solution of a run with contacts, from the records of its stretches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.margin import forces_of
from liouville._runs.contacts.record import ContactRecord
from liouville._runs.contacts.switching import AT_REST, Switching
from liouville._runs.contacts.traced import ModeSystem
from liouville._solution.parts import GROUPS
from liouville._solution.points import Points
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._solution.solution import Solution

#: A gap penetrates beyond this part of the sizes of its terms.
PENETRATES = 1e-9
#: What slips as it must not has more than this part of the sizes of its terms: it begins at rest.
BACKWARDS = 2 * AT_REST

#: Numbers of a run whose sum says nothing of many, and what does.
NOT_SUMMED: dict[str, Callable[[Any, Any], Any]] = {
    "h_next": lambda _, last: last,
    "h_smallest": min,
    "h_largest": max,
}


@dataclass(frozen=True)
class Stretch:
    """A run in one mode, of which so many records count."""

    run: Solution
    system: ModeSystem
    count: int


def joined(stretches: Sequence[Stretch], switching: Switching, every: int) -> Solution:
    """Join the records of stretches: at a change that after it is kept, and one in `every`."""
    contacts = switching.contacts
    first, second = contacts.system.states
    groups: dict[str, dict[str, list[Array]]] = {group: {} for group in GROUPS}
    times: list[Array] = []
    columns: list[list[Array]] = [[] for _ in range(5)]
    keep: list[Array] = []
    for number, stretch in enumerate(stretches):
        run, system = stretch.run, stretch.system
        is_last = number == len(stretches) - 1
        # the last record is that of the next stretch, but where forces gave way within a step
        is_whole = stretch.count == len(run.t)
        used = max(stretch.count - 1, 1) if is_whole and not is_last else stretch.count
        times.append(run.t[:used])
        for group in GROUPS:
            for name, values in getattr(run, group).items():
                if group != "residuals" or name != "nonholonomic" or system.rows_of(name):
                    own = _own(system, group, name, values[:used])
                    groups[group].setdefault(name, []).append(own)
        states = zip(run.t[:used], run.states[first], run.states[second], strict=False)
        found = [
            _at_record(switching, system, (float(t), y, z), run.states["lam"][k])
            for k, (t, y, z) in enumerate(states)
        ]
        for column, values in zip(columns, zip(*found, strict=True), strict=True):
            column.append(np.array(values))
        keep.append(np.arange(used) % every == 0)
        keep[-1][-1] |= is_last
    kept = np.concatenate(keep)
    last, stats = stretches[-1].run, _stats(stretches)
    h = switching.h
    if "h_next" in stats:  # of controlled steps
        h = float(times[-1][-1] - times[0][0]) / max(stats["steps"], 1)
    arrays: dict[str, Any] = {
        group: {name: np.concatenate(parts)[kept] for name, parts in own.items()}
        for group, own in groups.items()
    }
    mode, gap, normal, friction, slip = (np.concatenate(column)[kept] for column in columns)
    modes = np.array([[Mode(x) for x in row] for row in mode], dtype=object)
    records = {}
    for k, name in enumerate(contacts.names):
        rows = modes[:, k], gap[:, k], normal[:, k], friction[:, k], slip[:, k]
        records[name] = ContactRecord(*rows, tuple(switching.changes[k]))
    return replace(
        last,
        **arrays,
        t=np.concatenate(times)[kept],
        names={**last.names, "constraints": contacts.system.constraints},
        events=_events(stretches),
        stats=stats,
        message="; ".join(dict.fromkeys(switching.messages)),
        dense_order=0,
        h=h,
        system=contacts.system,
        changing=tuple(x for x in ("energy",) if x in last.invariants),
        contacts=records,
    )


def _own(system: ModeSystem, group: str, name: str, values: Array) -> Array:
    """Return what belongs to the system itself, without the constraints of a mode."""
    if name == "lam":
        return values[:, system.own]
    if group == "residuals":
        return values[:, : system.rows_of(name)]
    return values


def _at_record(
    switching: Switching, system: ModeSystem, state: tuple[float, Array, Array], lam: Array
) -> tuple[Array, ...]:
    """Return modes, gaps, normal forces, friction and slips at a record."""
    contacts, modes = switching.contacts, system.modes
    at = switching.at(*state)
    if (at.gap < -PENETRATES * at.size).any():
        place = int(np.argmin(at.gap + PENETRATES * at.size))
        name = contacts.names[place]
        sentence = f"contact '{name}' penetrates by {-at.gap[place]:.2g} at t = {state[0]:g}"
        raise IntegrationError(sentence, t=state[0], quantity=name)
    fast = np.abs(at.rows[-len(modes) :]).sum(axis=1) * at.speed
    back = at.slip * [mode.sign for mode in modes] < -BACKWARDS * fast
    if back.any():
        name = contacts.names[int(np.argmax(back))]
        sentence = f"contact '{name}' slips against its own friction at t = {state[0]:g}"
        raise IntegrationError(hinted(sentence, "try a smaller h"), t=state[0], quantity=name)
    closed = [k for k, mode in enumerate(modes) if mode is not Mode.OPEN]
    sticks = [k for k, mode in enumerate(modes) if mode is Mode.STICK]
    if system.is_shared:
        normal, friction = forces_of(contacts, at, modes)
    else:
        normal, friction = np.zeros(len(modes)), np.zeros(len(modes))
        for k in closed:
            normal[k] = -lam[system.normals[k]]
            friction[k] = -modes[k].sign * contacts.friction[k] * normal[k]
        for k in sticks:
            friction[k] = -lam[system.tangents[k]]
    return np.array([int(mode) for mode in modes]), at.gap, normal, friction, at.slip


def _events(stretches: Sequence[Stretch]) -> dict[str, Points]:
    """Join the events of the user."""
    found: dict[str, Points] = {}
    for stretch in stretches:
        system = stretch.system
        for name, points in stretch.run.events.items():
            if name in system.own_events:
                continue
            states = dict(points.states)
            if "lam" in states:
                states["lam"] = states["lam"][:, system.own]
            t = points.t
            if (before := found.get(name)) is not None:
                t = np.concatenate([before.t, t])
                states = {key: np.concatenate([before.states[key], states[key]]) for key in states}
            found[name] = Points(t, states)
    return found


def _stats(stretches: Sequence[Stretch]) -> Any:
    """Return the sums of all stretches, and how many there are."""
    stats: dict[str, Any] = {"stretches": len(stretches)}
    for stretch in stretches:
        for name, value in stretch.run.stats.items():
            if isinstance(value, str):
                stats[name] = value
            elif name in NOT_SUMMED:
                stats[name] = NOT_SUMMED[name](stats.get(name, value), value)
            else:
                stats[name] = stats.get(name, 0) + value
    return stats
