"""The solution of a run with contacts, from the records of its stretches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.margin import Shared
from liouville._runs.contacts.record import ContactRecord
from liouville._runs.contacts.switching import AT_REST, Switching
from liouville._runs.contacts.traced import Contacts, ModeSystem
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
    """A run in one mode, of which so many records count, and how contacts shared loads there."""

    run: Solution
    system: ModeSystem
    count: int
    shared: Sequence[Shared]


def joined(
    stretches: Sequence[Stretch], switching: Switching, accelerated: float, every: int
) -> Solution:
    """Join the records of stretches: at a change that after it is kept, and one in `every`.

    Accelerations without contact forces were up to `accelerated`.
    """
    contacts = switching.contacts
    first, second = contacts.system.states
    groups: dict[str, dict[str, list[Array]]] = {group: {} for group in GROUPS}
    times: list[Array] = []
    modes: list[Array] = []
    forces: list[tuple[Array, Array]] = []
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
        modes.append(np.tile(np.array(system.modes, dtype=object), (used, 1)))
        forces.append(_forces(contacts, stretch, used))
        keep.append(np.arange(used) % every == 0)
        keep[-1][-1] |= is_last
    kept = np.concatenate(keep)
    last, stats = stretches[-1].run, _stats(stretches)
    h = switching.h
    if "h_next" in stats:  # of controlled steps
        h = float(times[-1][-1] - times[0][0]) / max(stats["steps"], 1)
    whole: dict[str, Any] = {
        group: {name: np.concatenate(parts) for name, parts in own.items()}
        for group, own in groups.items()
    }
    t, mode = np.concatenate(times), np.concatenate(modes)
    states = whole["states"][first], whole["states"][second]
    gap, slip = _checked(switching, accelerated, mode, (t, *states))
    normal, friction = (np.concatenate(parts) for parts in zip(*forces, strict=True))
    columns = {"mode": mode, "gap": gap, "normal": normal, "friction": friction, "slip": slip}
    columns = {what: x[kept] for what, x in columns.items()}
    records = {
        name: ContactRecord(
            changes=tuple(switching.changes[k]), **{what: x[:, k] for what, x in columns.items()}
        )
        for k, name in enumerate(contacts.names)
    }
    arrays: dict[str, Any] = {
        group: {name: x[kept] for name, x in own.items()} for group, own in whole.items()
    }
    return replace(
        last,
        **arrays,
        t=t[kept],
        names={**last.names, "constraints": contacts.system.constraints},
        events=_events(stretches),
        stats=stats,
        message="; ".join(dict.fromkeys(switching.messages)),
        dense_order=last.dense_order if every == 1 else 0,
        stretches=tuple((x.run, x.system.own) for x in stretches) if every == 1 else (),
        h=h,
        system=contacts.system,
        changing=tuple(x for x in ("energy",) if x in last.invariants),
        contacts=records,
    )


def _own(system: ModeSystem, group: str, name: str, values: Array) -> Array:
    """Return the columns of the system itself, without the constraints of a mode."""
    if name == "lam":
        return values[:, system.own]
    if group == "residuals":
        return values[:, : system.rows_of(name)]
    return values


def _checked(
    switching: Switching, accelerated: float, modes: Array, states: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """Return gaps and slips at records, which must not be those of penetration or of creep."""
    contacts, t = switching.contacts, states[0]
    gap, slip, size, fast = contacts.records(*states, switching.params, switching.h, accelerated)
    through = np.argwhere(gap < -PENETRATES * size)
    if through.size:
        k, which = through[0]
        name = contacts.names[which]
        sentence = f"contact '{name}' penetrates by {-gap[k, which]:.2g} at t = {t[k]:g}"
        raise IntegrationError(sentence, t=float(t[k]), quantity=name)
    back = np.argwhere(slip * _signs(modes) < -BACKWARDS * fast)
    if back.size:
        k, which = back[0]
        name = contacts.names[which]
        sentence = f"contact '{name}' slips against its own friction at t = {t[k]:g}"
        raise IntegrationError(hinted(sentence, "try a smaller h"), t=float(t[k]), quantity=name)
    return gap, slip


def _signs(modes: Array) -> Array:
    """Return the signs of the slips of modes."""
    found: Array = (modes == Mode.SLIP_UP).astype(int) - (modes == Mode.SLIP_DOWN).astype(int)
    return found


def _forces(contacts: Contacts, stretch: Stretch, used: int) -> tuple[Array, Array]:
    """Return normal forces and friction at the first records of a stretch."""
    system = stretch.system
    normal, friction = np.zeros((used, len(system.modes))), np.zeros((used, len(system.modes)))
    if system.is_shared:
        for k, own in enumerate(stretch.shared[:used]):
            normal[k], friction[k] = own.normal, own.friction
        return normal, friction
    lam = stretch.run.states["lam"][:used]
    for k, place in system.normals.items():
        normal[:, k] = -lam[:, place]
        friction[:, k] = -system.modes[k].sign * contacts.friction[k] * normal[:, k]
    for k, place in system.tangents.items():
        friction[:, k] = -lam[:, place]
    return normal, friction


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
