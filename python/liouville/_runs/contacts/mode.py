"""Systems in one mode of their contacts."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.hit import has_closed_form, struck
from liouville._runs.contacts.sliding import frictions
from liouville._systems.events import Event, Impact, Touch
from liouville._systems.mechanics.contact import Mode
from liouville._systems.mechanics.form import Nonholonomic
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.mechanics.traced import INVARIANT, SWITCH
from liouville._systems.tape import record

if TYPE_CHECKING:
    from liouville._runs.contacts.traced import Contacts
    from liouville._solution.solution import Solution

#: A slip in space slows down where it changes within so many steps by itself.
FEW = 4.0


def _recorded(*args: Any) -> Any:
    """Stand for the function of an event whose tape a mode has."""
    raise AssertionError("the tapes of a mode are recorded")


#: What ends a mode: its tape is that of the mode.
ENDING = Touch(_recorded, "down", terminal=True)


class ModeSystem(Mechanics):
    """A system in one mode of its contacts: smooth, with the constraints and reactions of the mode.

    Attributes
    ----------
    modes : tuple of Mode
        What each contact does.
    normals, tangents : dict of int to int
        The places of the multipliers -N and -T among all, by the number of the contact, and of
        the slip.
    own : ndarray
        The places of the multipliers of the system's own constraints.
    is_shared : bool
        Whether more contacts bear than rows are independent: their forces are not determined.
    own_events : dict of str to tuple
        The events of the mode by name: the contact, and what happens there.
    bounces : dict of str to int
        The hits among them that the core answers by itself, and their contacts: of those that do
        not stay, where none is closed.
    is_redundant : bool
        Whether constraints of the system itself imply one another.
    """

    def __init__(
        self,
        contacts: Contacts,
        modes: tuple[Mode, ...],
        rows: tuple[int, ...],
        is_redundant: bool,
    ) -> None:
        base, c, its = contacts.system, len(modes), contacts.columns
        s, model = base.symbols, base.model
        self.modes, self.is_redundant = modes, is_redundant
        stuck = sum(modes[k] is Mode.STICK for k in contacts.owner)
        closed = [mode for k, mode in enumerate(modes) if contacts.has_gap(k)]
        self.is_shared = len(rows) < stuck + sum(mode is not Mode.OPEN for mode in closed)
        self._counts = len(base.holonomic), len(base.nonholonomic)
        gaps = [k for k in rows if k < c]
        slips = [row - c for row in rows if row >= c]
        m, own = model.lam.numel(), model.nonholonomic
        lam = ca.SX.sym("lam", m + len(gaps))
        nu = ca.SX.sym("nu", own.nu.numel() + len(slips))
        # friction whose size is known: of loads, and of what slides in space
        known, self._slowing = frictions(contacts, modes, gaps, slips)
        added, braked = ca.SX(s.y.numel(), 1), ca.SX(0)
        for row, force in known.items():
            added += its["along"][row, :].T * force
            braked += force * contacts.drives[c + row]
        r, rn = _reactions(contacts, modes, (gaps, slips), (lam, nu))
        holonomic = base.constraints[:m] + tuple(contacts.names[k] for k in gaps)
        rolling = base.nonholonomic + tuple(_held(contacts, row) for row in slips)
        self.normals = {k: m + place for place, k in enumerate(gaps)}
        first = m + len(gaps)
        self.tangents = {row: first + own.nu.numel() + place for place, row in enumerate(slips)}
        self.own = np.r_[np.arange(m), first + np.arange(own.nu.numel())].astype(int)
        columns = base.expressions.columns
        super().__init__(
            s,
            replace(
                model,
                f=model.f + added,
                force=model.force and (model.force[0], model.force[1] + added),
                r=r,
                g=ca.vertcat(model.g, *(its["phi"][k] for k in gaps)),
                lam=lam,
                is_ideal=model.is_ideal and not any(mode.sign for mode in modes),
                nonholonomic=Nonholonomic(
                    ca.vertcat(own.k, *(its["slips"][k] for k in slips)), rn, nu
                ),
                g_y=None,
            ),
            states=base.states,
            coordinates=base.coordinates,
            constraints=holonomic + rolling,
            invariants={name: columns[INVARIANT + name] for name in base.invariants},
            power=_power(contacts, modes, gaps, lam, braked),
            switches={name: columns[SWITCH + name] for name in base.switch_tapes},
        )
        # friction and impacts take from the energy, and walls that move may give
        self.is_conservative, self.may_only_lose = False, False
        self._record_events(contacts)
        self._add_resets(contacts)

    def _record_events(self, contacts: Contacts) -> None:
        """Record the functions whose fall to zero ends the mode."""
        self.own_events: dict[str, tuple[int, str]] = {}
        self._tapes_of_events: dict[str, Any] = {}
        self._tapes_of_slowing: dict[tuple[str, int], Any] = {}
        self._values_of_events: dict[str, ca.SX] = {}
        found: dict[str, tuple[int, str, ca.SX]] = {}
        multipliers = self._multipliers
        for k, (name, mode) in enumerate(zip(contacts.names, self.modes, strict=True)):
            if mode is Mode.OPEN:
                found[f"{name}: hit"] = k, "hit", contacts.columns["phi"][k]
                continue
            if mode.sign:
                slip = contacts.columns["slips"][contacts.slips_of(k)[0]]
                found[f"{name}: stop"] = k, "stop", mode.sign * slip
            if self.is_shared:
                continue  # how long forces last is found by the margin
            normal = contacts.columns["load"][k]
            if contacts.has_gap(k):
                normal = -multipliers[self.normals[k]]
                found[f"{name}: leave"] = k, "leave", normal
            if mode is Mode.STICK:
                most = contacts.columns["static"][k] * normal
                places = [self.tangents[row] for row in contacts.slips_of(k)]
                if len(places) > 1:
                    square = ca.sumsqr(multipliers[places])
                    found[f"{name}: tear"] = k, "tear", most**2 - square
                    continue
                tangent = -multipliers[places[0]]
                found[f"{name}: tear up"] = k, "tear", most - tangent
                found[f"{name}: tear down"] = k, "tear", most + tangent
        inputs = self.symbols.inputs(z=self.symbols.z, lam=multipliers)
        for name, (k, kind, value) in found.items():
            self.own_events[name] = k, kind
            needs = kind in ("leave", "tear")
            # modes share the tapes of what has the same multipliers
            held = self.normals.get(k), *(self.tangents.get(row) for row in contacts.slips_of(k))
            key = name, self.modes[k], multipliers.numel(), *held
            if key not in contacts.recorded:
                contacts.recorded[key] = record(f"event '{name}'", inputs, value)
            self._tapes_of_events[name] = contacts.recorded[key], needs, None
            self._values_of_events[name] = value

    @property
    def _args_of_events(self) -> dict[str, Any]:
        """The arguments of a user's functions, of the multipliers those of the system's own."""
        args = super()._args_of_events
        return {**args, "lam": args["lam"][self.own.tolist()]}

    def slows(self, contacts: Contacts, h: float) -> dict[str, Event]:
        """Return the events where slips in space come to change within few steps by themselves."""
        found: dict[str, Event] = {}
        for k, rate in self._slowing.items():
            name, slip = (
                f"{contacts.names[k]}: slows",
                contacts.columns["slips"][contacts.slips_of(k)],
            )
            key = name, round(float(np.log2(h)))
            if key not in self._tapes_of_slowing:
                own = ca.sumsqr(slip) - (FEW * 2.0 ** key[1]) ** 2 * ca.sumsqr(rate)
                inputs = self.symbols.inputs(z=self.symbols.z, lam=self._multipliers)
                tapes = record(f"event '{name}'", inputs, own), False, None
                self._tapes_of_slowing[key] = tapes, own
            self._tapes_of_events[name], self._values_of_events[name] = self._tapes_of_slowing[key]
            self.own_events[name] = k, "slow"
            found[name] = ENDING
        return found

    def _add_resets(self, contacts: Contacts) -> None:
        """Let hits of contacts that bounce be events with an impact, where none is closed."""
        self.bounces: dict[str, int] = {}
        self._resets: dict[str, Event] = {}
        self._tapes_of_resets: dict[str, Any] = {}
        if any(self.modes) or contacts.is_spatial.any():
            return
        for name, (k, _) in self.own_events.items():
            if not contacts.bounces[k] or (contacts.is_rough[k] and not has_closed_form(contacts)):
                continue
            self.bounces[name] = k
            gap, restitution = contacts.columns["phi"][k], contacts.columns["restitution"][k]
            law: Any = Impact(lambda *_, e=restitution: e)
            if contacts.is_rough[k]:
                after = struck(contacts, k)
                law = lambda *_, after=after: after  # noqa: E731
            self._resets[name] = Event(lambda *_, gap=gap: gap, "down", reset=law)

    def ended(self, run: Solution, t: float, kinds: Collection[str]) -> set[int]:
        """Return the contacts of which an event of these kinds was met at this time of a run."""
        own = ((name, k) for name, (k, kind) in self.own_events.items() if kind in kinds)
        times = ((k, run.events[name].t) for name, k in own if name in run.events)
        return {k for k, own in times if own.size and t in own}

    def resets(self) -> dict[str, Event]:
        """Return the events of hits that the core answers by itself."""
        for name, event in self._resets.items():
            if name not in self._tapes_of_resets:
                self._tapes_of_resets[name] = super().event(name, event)
        return self._resets

    def stepped(  # type: ignore[override]
        self, t: float, y: Array, z: Array, params: Array
    ) -> Mechanics:
        """Return the system without redundant constraints, which are its own ones."""
        return super().stepped(t, y, z, params) if self.is_redundant else self

    def rows_of(self, residual: str) -> int:
        """Return how many rows of residuals are those of the system itself."""
        return self._counts[residual == "nonholonomic"]

    def event_expressions(self, name: str, event: Event) -> tuple[ca.SX, list[ca.SX]]:
        """Return the function of an event, that of the mode as it is, and its reset."""
        if event.reset is None and name in self._values_of_events:
            return self._values_of_events[name], []
        return super().event_expressions(name, event)

    def event(self, name: str, event: Event) -> Any:
        """Return the tapes of an event, those of the mode as they were recorded."""
        tapes = self._tapes_of_events if event.reset is None else self._tapes_of_resets
        own = tapes.get(name)
        return own if own is not None else super().event(name, event)


def _reactions(
    contacts: Contacts,
    modes: tuple[Mode, ...],
    held: tuple[Sequence[int], Sequence[int]],
    multipliers: tuple[ca.SX, ca.SX],
) -> tuple[ca.SX, ca.SX]:
    """Return the reactions of gaps, with their friction in the plane, and those of slips.

    `held` are the contacts and the slips that a mode holds at zero.
    """
    model, its, (gaps, slips), (lam, nu) = (
        contacts.system.model,
        contacts.columns,
        held,
        multipliers,
    )
    own, m = model.nonholonomic, model.lam.numel()
    r = ca.substitute(model.r, model.lam, lam[:m]) if m else model.r
    for place, k in enumerate(gaps):
        friction = its["friction"][k] * modes[k].sign
        along = its["along"][contacts.slips_of(k)[0], :].T
        r += (-its["across"][k, :].T + friction * along) * lam[m + place]
    count = own.nu.numel()
    rn = ca.substitute(own.rn, own.nu, nu[:count]) if count else ca.SX(r.numel(), 1)
    for place, row in enumerate(slips):
        rn -= its["along"][row, :].T * nu[count + place]
    return r, rn


def _power(
    contacts: Contacts,
    modes: tuple[Mode, ...],
    gaps: Sequence[int],
    lam: ca.SX,
    braked: ca.SX,
) -> ca.SX | None:
    """Return the power of a system in a mode, `braked` that of friction whose size is known."""
    power = contacts.system.expressions.columns.get("power")
    if power is None:
        return None
    own, drives, its = contacts.system.model.lam, contacts.drives, contacts.columns
    m = own.numel()
    power = (ca.substitute(power, own, lam[:m]) if m else power) + braked
    for place, k in enumerate(gaps):
        friction = its["friction"][k] * modes[k].sign
        along = drives[len(modes) + contacts.slips_of(k)[0]]
        power += lam[m + place] * (friction * along - drives[k])
    return power


def _held(contacts: Contacts, row: int) -> str:
    """Return the name of a slip that is held at zero."""
    k = contacts.owner[row]
    way = f" along {row - contacts.slips_of(k)[0] + 1}" if contacts.is_spatial[k] else ""
    return f"{contacts.names[k]} sticks{way}"


def endings(contacts: Contacts, system: ModeSystem, rest: Array, h: float) -> dict[str, Event]:
    """Return the events that end a mode; slips stop too where they are so small and turn back."""
    found: dict[str, Event] = system.slows(contacts, h)
    for name, (k, kind) in system.own_events.items():
        if kind == "stop":
            found[name] = replace(ENDING, size=float(rest[contacts.slips_of(k)[0]]))
        elif kind != "slow":
            found[name] = ENDING
    return found
