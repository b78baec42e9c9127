"""The solution of a run with contacts, from the records of its stretches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.mode import ModeSystem
from liouville._runs.contacts.stretch import Part, Stretch
from liouville._runs.contacts.switching import Switching
from liouville._runs.contacts.tangent import summed
from liouville._runs.contacts.traced import Contacts
from liouville._solution.contacts import ContactRecord
from liouville._solution.parts import GROUPS
from liouville._solution.points import Points
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._runs.runner import Request
    from liouville._solution.solution import Solution
    from liouville._solution.states import Stats

#: Numbers of a run whose sum says nothing of many, and what does.
NOT_SUMMED: dict[str, Callable[[Any, Any], Any]] = {
    "h_next": lambda _, last: last,
    "h_smallest": min,
    "h_largest": max,
}


#: Time, state and angles of a record.
Last = tuple[float, Array, Array, dict[str, float]]


@dataclass(frozen=True)
class Columns:
    """Records of all stretches: times, groups of a solution, modes and forces of contacts."""

    t: Array
    groups: dict[str, dict[str, Array]]
    mode: Array
    normal: Array
    friction: Array


@dataclass
class Records:
    """The records of stretches, joined one part of a run after another.

    Attributes
    ----------
    stats : dict
        Sums over the stretches before.
    work, energy : float
        Work done by their ends, and the energy at the start of the run.
    last : tuple, or None
        The last record: its time, state and angles by name.
    first : float
        The time at the start of the run.
    told : list of int
        How many of the changes that are kept of each contact were given before.
    """

    stats: dict[str, Any] = field(default_factory=lambda: {"stretches": 0})
    work: float = 0.0
    energy: float = 0.0
    last: Last | None = None
    first: float = 0.0
    told: list[int] = field(default_factory=list)

    def joined(
        self, stretches: Sequence[Stretch], now: Switching, request: Request, *, goes_on: bool
    ) -> Solution:
        """Join the records of stretches: at a change that after it is kept, and one in `every`.

        Where the run goes on, its last record is the first of the next part.
        """
        contacts, every, run = now.contacts, request.every, stretches[-1].whole.run
        uses = used(stretches)
        if not goes_on:
            uses[-1] = stretches[-1].whole.count
        whole = _columns(now, [x.whole for x in stretches], uses)
        if self.last is None:
            self.first, self.told = float(whole.t[0]), [0] * len(contacts.names)
            self.energy = whole.groups["invariants"].get("energy", np.zeros(1))[0]
        found, kept = whole, np.concatenate([np.arange(use) % every == 0 for use in uses])
        kept[-1] |= not goes_on
        initial, last = run.initial, self.last
        self._continue(now, whole, whole, last)
        if request.t_eval is not None:
            initial = {name: float(x[0]) for name, x in whole.groups["invariants"].items()}
            given = [x.given for x in stretches if x.given is not None]
            uses = _given(given, [x.whole.run.t[0] for x in stretches[1:]] + [now.t] * goes_on)
            found = _columns(now, given, uses)
            self._continue(now, whole, found, last)
            kept = np.ones(len(found.t), dtype=bool)
        self._balance(found, stretches, uses, now.t)
        self._add(stretches)
        arrays: dict[str, Any] = {
            group: {name: x[kept] for name, x in own.items()} for group, own in found.groups.items()
        }
        is_dense = every == 1 and request.t_eval is None and request.states
        return replace(
            run,
            **(arrays | ({} if request.states else {"states": {}})),
            t=found.t[kept],
            initial=initial,
            names={**run.names, "constraints": contacts.system.constraints},
            events=_events(stretches),
            stats=cast("Stats", self.stats),
            message="; ".join(dict.fromkeys(now.messages)),
            dense_order=run.dense_order if is_dense else 0,
            stretches=tuple((x.whole.run, x.whole.system.own) for x in stretches if is_dense),
            h=self.mean(now.h, whole.t[-1]),
            system=contacts.system,
            changing=tuple(x for x in ("energy",) if x in run.invariants),
            contacts=self._contacts(now, found, kept),
        )

    def mean(self, h: float, end: float) -> float:
        """Return the step: of controlled ones their mean until a time."""
        if "h_next" not in self.stats:
            return h
        return float(end - self.first) / max(int(self.stats["steps"]), 1)

    def _continue(self, now: Switching, whole: Columns, found: Columns, last: Last | None) -> None:
        """Put the angles that all steps continue, from those at the last record, with others."""
        system = now.contacts.system
        parts = [
            (x.t, *(x.groups["states"][name] for name in system.states)) for x in (whole, found)
        ]
        if last is not None:
            parts.insert(0, (np.array([last[0]]), last[1][None], last[2][None]))
        t, y, z = (np.concatenate(x) for x in zip(*parts, strict=True))
        order = np.argsort(t if t[-1] >= t[0] else -t, kind="stable")
        known = None if last is None else last[3]
        angles = system.continued(t[order], y[order], z[order], now.params, known)
        back = np.argsort(order)[len(t) - len(found.t) :]
        found.groups["angles"] = {name: x[back] for name, x in angles.items()}
        if found is whole:
            ends = {name: float(x[back][-1]) for name, x in angles.items()}
            self.last = float(whole.t[-1]), parts[-1][1][-1].copy(), parts[-1][2][-1].copy(), ends

    def _balance(
        self, found: Columns, stretches: Sequence[Stretch], uses: Sequence[int], end: float
    ) -> None:
        """Let work and dissipation be those since the start of the run, not of each stretch."""
        if not found.groups["balance"]:
            return
        runs = [x.whole.run for x in stretches]
        ends = [*(after.t[0] for after in runs[1:]), end]
        done = [np.interp(t, x.t, x.balance["work"]) for t, x in zip(ends, runs, strict=True)]
        before = np.cumsum([self.work, *done])
        work = found.groups["balance"]["work"] + np.repeat(before[:-1], uses)
        lost = self.energy + work - found.groups["invariants"]["energy"]
        found.groups["balance"] = {"work": work, "dissipated": lost}
        self.work = float(before[-1])

    def _contacts(self, now: Switching, found: Columns, kept: Array) -> dict[str, ContactRecord]:
        """Return the records of contacts by name."""
        y, z = (found.groups["states"][name] for name in now.contacts.system.states)
        gap, slip = now.contacts.records(found.t, y, z, now.params, 0.0, 0.0)[:2]
        columns = {"mode": found.mode, "gap": gap, "normal": found.normal}
        columns |= {"friction": found.friction, "slip": now.contacts.seen(slip)}
        return {
            name: ContactRecord(
                changes=tuple(now.changes[k][self.told[k] :]),
                **{what: x[kept, k] for what, x in columns.items()},
            )
            for k, name in enumerate(now.contacts.names)
        }

    def _add(self, stretches: Sequence[Stretch]) -> None:
        """Add the numbers of stretches."""
        self.stats = dict(self.stats)
        self.stats["stretches"] += len(stretches)
        for stretch in stretches:
            for name, value in stretch.whole.run.stats.items():
                if isinstance(value, str):
                    self.stats[name] = value
                elif name in NOT_SUMMED:
                    self.stats[name] = NOT_SUMMED[name](self.stats.get(name, value), value)
                else:
                    self.stats[name] = self.stats.get(name, 0) + value


def used(stretches: Sequence[Stretch]) -> list[int]:
    """Return how many records are those of each stretch, which others follow."""
    uses = [x.used for x in stretches]
    for k, stretch in enumerate(stretches):
        if stretch.whole.is_stop and k:
            uses[k - 1 : k + 1] = stretches[k - 1].whole.count, 0
    return uses


def _given(parts: Sequence[Part], ends: Sequence[float]) -> list[int]:
    """Return how many records at given times are those of each part, which end at these times."""
    counts = [int(np.sum(x.run.t[: x.count] < t)) for x, t in zip(parts, ends, strict=False)]
    return counts if len(ends) == len(parts) else [*counts, parts[-1].count]


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


def _own(system: ModeSystem, group: str, name: str, values: Array) -> Array:
    """Return the columns of the system itself, without the constraints of a mode."""
    if name == "lam":
        return values[:, system.own]
    if group == "residuals":
        return values[:, : system.rows_of(name)]
    return values


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
