"""The solution of a run with contacts, from the records of its stretches."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.margin import Shared
from liouville._runs.contacts.mode import ModeSystem
from liouville._runs.contacts.switching import AT_REST, Switching
from liouville._runs.contacts.tangent import summed
from liouville._runs.contacts.traced import Contacts
from liouville._solution.contacts import ContactRecord
from liouville._solution.parts import GROUPS
from liouville._solution.points import Points
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.runner import Request
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
class Part:
    """A run in one mode, of which so many records count, and how contacts shared loads there."""

    run: Solution
    system: ModeSystem
    count: int
    shared: Sequence[Shared]
    #: Its end, before that of the run where this does not count to its end.
    until: float = np.inf
    #: The contacts that slide in space, though the run holds them: it is as short as roundoff.
    slides: Collection[int] = ()

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The mode of each contact."""
        own = enumerate(self.system.modes)
        return tuple(Mode.SLIDE if k in self.slides else mode for k, mode in own)


@dataclass(frozen=True)
class Stretch:
    """A run in one mode, and its records at the times that were asked for, where they are given."""

    whole: Part
    given: Part | None = None

    @property
    def used(self) -> int:
        """How many records are its own: the last is that of the next stretch."""
        # but where forces gave way within a step
        is_whole = self.whole.count == len(self.whole.run.t)
        return max(self.whole.count - 1, 1) if is_whole else self.whole.count


@dataclass(frozen=True)
class Link:
    """How a stretch began and ended, for a pullback.

    Attributes
    ----------
    adjoint : Adjoint
        Its transposed derivative.
    ended : str or None
        The event that ended it, if one of the mode did.
    impacts : list of tuple
        What the change at its start did to velocities, as :class:`Switching` has it.
    before : tuple of (float, ndarray, ndarray)
        Time and state before that.
    """

    adjoint: Adjoint
    ended: str | None
    impacts: list[Any]
    before: tuple[float, Array, Array]


@dataclass(frozen=True)
class Columns:
    """Records of all stretches: times, groups of a solution, modes and forces of contacts."""

    t: Array
    groups: dict[str, dict[str, Array]]
    mode: Array
    normal: Array
    friction: Array


def joined(
    stretches: Sequence[Stretch], switching: Switching, accelerated: float, request: Request
) -> Solution:
    """Join the records of stretches: at a change that after it is kept, and one in `every`.

    Accelerations without contact forces were up to `accelerated`.
    """
    contacts, every = switching.contacts, request.every
    last = stretches[-1].whole.run
    uses = [x.used for x in stretches[:-1]] + [stretches[-1].whole.count]
    found = _columns(switching, [x.whole for x in stretches], uses)
    gap, slip = _gaps(switching, accelerated, found)
    stats, h = _stats(stretches), switching.h
    if "h_next" in stats:  # of controlled steps
        h = float(found.t[-1] - found.t[0]) / max(stats["steps"], 1)
    found.groups["angles"] = _angles(switching, found, found)
    kept = np.concatenate([np.arange(use) % every == 0 for use in uses])
    kept[-1] = True
    initial = last.initial
    if request.t_eval is not None:
        initial = {name: float(x[0]) for name, x in found.groups["invariants"].items()}
        given = [x.given for x in stretches if x.given is not None]
        ends = [x.whole.run.t[0] for x in stretches[1:]]
        counts = [int(np.sum(x.run.t[: x.count] < t)) for x, t in zip(given, ends, strict=False)]
        uses, whole = [*counts, given[-1].count], found
        found = _columns(switching, given, uses)
        found.groups["angles"] = _angles(switching, whole, found)
        gap, slip = _gaps(switching, accelerated, found)
        kept = np.ones(len(found.t), dtype=bool)
    _balanced(found, stretches, uses)
    columns = {"mode": found.mode, "gap": gap, "normal": found.normal}
    columns |= {"friction": found.friction, "slip": slip}
    records = {
        name: ContactRecord(
            changes=tuple(switching.changes[k]),
            **{what: x[kept, k] for what, x in columns.items()},
        )
        for k, name in enumerate(contacts.names)
    }
    arrays: dict[str, Any] = {
        group: {name: x[kept] for name, x in own.items()} for group, own in found.groups.items()
    }
    is_dense = every == 1 and request.t_eval is None and request.states
    return replace(
        last,
        **(arrays | ({} if request.states else {"states": {}})),
        t=found.t[kept],
        initial=initial,
        names={**last.names, "constraints": contacts.system.constraints},
        events=_events(stretches),
        stats=stats,
        message="; ".join(dict.fromkeys(switching.messages)),
        dense_order=last.dense_order if is_dense else 0,
        stretches=tuple((x.whole.run, x.whole.system.own) for x in stretches) if is_dense else (),
        h=h,
        system=contacts.system,
        changing=tuple(x for x in ("energy",) if x in last.invariants),
        contacts=records,
    )


def _columns(switching: Switching, parts: Sequence[Part], uses: Sequence[int]) -> Columns:
    """Return the first records of parts one after another, so many of each."""
    groups: dict[str, dict[str, list[Array]]] = {group: {} for group in (*GROUPS, "tangents")}
    forces: list[tuple[Array, Array]] = []
    for part, used in zip(parts, uses, strict=True):
        system = part.system
        for group in GROUPS:
            for name, values in getattr(part.run, group).items():
                if group != "residuals" or name != "nonholonomic" or system.rows_of(name):
                    own = _own(system, group, name, values[:used])
                    groups[group].setdefault(name, []).append(own)
        for name, values in summed(part.run, system).items():
            groups["tangents"].setdefault(name, []).append(values[:used])
        forces.append(_forces(switching, part, used))
    modes = [
        np.tile(np.array(part.modes, dtype=object), (used, 1))
        for part, used in zip(parts, uses, strict=True)
    ]
    normal, friction = (np.concatenate(own) for own in zip(*forces, strict=True))
    return Columns(
        np.concatenate([part.run.t[:used] for part, used in zip(parts, uses, strict=True)]),
        {
            group: {name: np.concatenate(own) for name, own in each.items()}
            for group, each in groups.items()
        },
        np.concatenate(modes),
        normal,
        friction,
    )


def _angles(switching: Switching, whole: Columns, found: Columns) -> dict[str, Array]:
    """Return the angles at records that all steps continue, by name."""
    system = switching.contacts.system
    t = np.concatenate([whole.t, found.t])
    order = np.argsort(t if t[-1] >= t[0] else -t, kind="stable")
    y, z = (
        np.concatenate([x.groups["states"][name] for x in (whole, found)])[order]
        for name in system.states
    )
    angles = system.continued(t[order], y, z, switching.params)
    back = np.argsort(order)[len(whole.t) :]
    return {name: x[back] for name, x in angles.items()}


def _balanced(found: Columns, stretches: Sequence[Stretch], uses: Sequence[int]) -> None:
    """Let work and dissipation be those since the start of the run, not of each stretch."""
    if not found.groups["balance"]:
        return
    runs = [x.whole.run for x in stretches]
    ends = [after.t[0] for after in runs[1:]]
    done = [np.interp(t, x.t, x.balance["work"]) for t, x in zip(ends, runs, strict=False)]
    work = found.groups["balance"]["work"] + np.repeat(np.cumsum([0.0, *done]), uses)
    lost = runs[0].invariants["energy"][0] + work - found.groups["invariants"]["energy"]
    found.groups["balance"] = {"work": work, "dissipated": lost}


def _own(system: ModeSystem, group: str, name: str, values: Array) -> Array:
    """Return the columns of the system itself, without the constraints of a mode."""
    if name == "lam":
        return values[:, system.own]
    if group == "residuals":
        return values[:, : system.rows_of(name)]
    return values


def check_start(now: Switching, y: Array, z: Array) -> None:
    """Refuse a start that penetrates."""
    at = now.at(now.t, y, z)
    for name, gap, size in zip(now.contacts.names, at.gap, at.size, strict=True):
        if gap < -PENETRATES * size:
            sentence = f"contact '{name}' penetrates by {-gap:.3g} at the start"
            raise ValueError(hinted(sentence, "its gap must not be negative"))


def check(
    run: Solution, system: ModeSystem, switching: Switching, accelerated: float, count: int
) -> IntegrationError | None:
    """Return the fault of the first records of a stretch: they penetrate, or slip back."""
    contacts, t = switching.contacts, run.t[:count]
    y, z = (run.states[name][:count] for name in contacts.system.states)
    gap, slip, size, fast = contacts.records(t, y, z, switching.params, switching.h, accelerated)
    through = np.argwhere(gap < -PENETRATES * size)
    if through.size:
        k, which = through[0]
        name = contacts.names[which]
        sentence = f"contact '{name}' penetrates by {-gap[k, which]:.2g} at t = {t[k]:g}"
        return IntegrationError(sentence, t=float(t[k]), quantity=name)
    loads = contacts.loads(t, y, switching.params)
    lifted = np.argwhere(loads < 0)
    if lifted.size:
        k, which = lifted[0]
        what = f"the load of contact '{contacts.names[which]}' is negative, {loads[k, which]:.3g}"
        return IntegrationError(f"{what}, at t = {t[k]:g}", t=float(t[k]))
    signs = np.array([mode.sign for mode in system.modes])
    back = np.argwhere(slip * signs[contacts.owner] < -BACKWARDS * fast)
    if back.size:
        k, row = back[0]
        name = contacts.names[contacts.owner[row]]
        against = f"contact '{name}' slips against its own friction"
        sentence = hinted(f"{against} at t = {t[k]:g}", "try a smaller h")
        return IntegrationError(sentence, t=float(t[k]), quantity=name)
    return None


def _gaps(switching: Switching, accelerated: float, found: Columns) -> tuple[Array, Array]:
    """Return gaps and slips at records, by contact."""
    contacts, own = switching.contacts, (switching.params, switching.h, accelerated)
    y, z = (found.groups["states"][name] for name in contacts.system.states)
    gap, slip = contacts.records(found.t, y, z, *own)[:2]
    return gap, contacts.seen(slip)


def _forces(switching: Switching, part: Part, used: int) -> tuple[Array, Array]:
    """Return normal forces and friction at the first records of a part, by contact."""
    system, contacts, params = part.system, switching.contacts, switching.params
    if not system.is_shared:
        states = {name: x[:used] for name, x in part.run.states.items()}
        normal, friction = forces_of(contacts, system, part.run.t[:used], states, params)
        friction = contacts.seen(friction)
        for k in part.slides:
            friction[:, k] = contacts.laws(params).friction[k] * normal[:, k]
        return normal, friction
    normal, friction = np.zeros((used, len(system.modes))), np.zeros((used, len(system.modes)))
    for k, own in enumerate(part.shared[:used]):
        normal[k], friction[k] = own.normal, own.friction
    return normal, friction


def forces_of(
    contacts: Contacts, system: ModeSystem, t: Array, states: Mapping[str, Array], params: Array
) -> tuple[Array, Array]:
    """Return normal forces, those given too, and friction of all slips, at states of a mode."""
    first, second = (states[name] for name in system.states)
    normal, lam, owner = contacts.loads(t, first, params).copy(), states["lam"], contacts.owner
    for k, place in system.normals.items():
        normal[:, k] = -lam[:, place]
    ways = np.tile([float(system.modes[k].sign) for k in owner], (len(t), 1))
    slides = [k for k, mode in enumerate(system.modes) if mode is Mode.SLIDE]
    slip = contacts.slips(t, first, second, params) if slides else ways
    for k in slides:
        own = contacts.slips_of(k)
        ways[:, own] = slip[:, own] / np.linalg.norm(slip[:, own], axis=1, keepdims=True)
    friction = -ways * (contacts.laws(params).friction * normal)[:, owner]
    for row, place in system.tangents.items():
        friction[:, row] = -lam[:, place]
    return normal, friction


def _events(stretches: Sequence[Stretch]) -> dict[str, Points]:
    """Join the events of the user."""
    found: dict[str, Points] = {}
    for stretch in stretches:
        system = stretch.whole.system
        for name, points in stretch.whole.run.events.items():
            if name in system.own_events:
                continue
            states = dict(points.states)
            if "lam" in states:
                states["lam"] = states["lam"][:, system.own]
            inside = points.t <= stretch.whole.until
            t, states = points.t[inside], {key: x[inside] for key, x in states.items()}
            if (before := found.get(name)) is not None:
                t = np.concatenate([before.t, t])
                states = {key: np.concatenate([before.states[key], states[key]]) for key in states}
            found[name] = Points(t, states)
    return found


def _stats(stretches: Sequence[Stretch]) -> Any:
    """Return the sums of all stretches, and how many there are."""
    stats: dict[str, Any] = {"stretches": len(stretches)}
    for stretch in stretches:
        for name, value in stretch.whole.run.stats.items():
            if isinstance(value, str):
                stats[name] = value
            elif name in NOT_SUMMED:
                stats[name] = NOT_SUMMED[name](stats.get(name, value), value)
            else:
                stats[name] = stats.get(name, 0) + value
    return stats
