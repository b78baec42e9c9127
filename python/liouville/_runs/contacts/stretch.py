"""Stretches of a run with contacts, each in one mode, and what is checked of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.margin import Shared
from liouville._runs.contacts.matrices import AT_REST
from liouville._runs.contacts.mode import ModeSystem
from liouville._runs.contacts.switching import Switching
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.contacts.tangent import Jump
    from liouville._solution.solution import Solution

#: A gap penetrates beyond this part of the sizes of its terms.
PENETRATES = 1e-9
#: A contact pulls that changes its rate in a step by this part of the sizes of its terms.
PULLS = 1e-6
#: What slips as it must not has more than this part of the sizes of its terms: it begins at rest.
BACKWARDS = 2 * AT_REST


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
    #: Whether its first record is that at the end of the stretch before.
    is_stop: bool = False

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
    jumps : list of Jump
        What happened at once before it.
    is_bit : bool
        Whether it stands for the motion only as far as roundoff knows, so that what follows begins
        where it began.
    """

    adjoint: Adjoint
    ended: str | None
    jumps: list[Jump]
    is_bit: bool = False


class Penetrates(ValueError):
    """A start at which a contact penetrates."""


def check_start(now: Switching, y: Array, z: Array) -> None:
    """Refuse a start that penetrates."""
    at = now.at(now.t, y, z)
    for name, gap, size in zip(now.contacts.names, at.gap, at.size, strict=True):
        if gap < -PENETRATES * size:
            sentence = f"contact '{name}' penetrates by {-gap:.3g} at the start"
            raise Penetrates(hinted(sentence, "its gap must not be negative"))


def check(
    run: Solution, system: ModeSystem, switching: Switching, accelerated: float, count: int
) -> IntegrationError | None:
    """Return the fault of the first records of a stretch: they penetrate, pull, or slip back."""
    contacts, t = switching.contacts, run.t[:count]
    y, z = (run.states[name][:count] for name in contacts.system.states)
    gap, slip, size, fast = contacts.records(t, y, z, switching.params, switching.h, accelerated)
    through = np.argwhere(gap < -PENETRATES * size)
    if through.size:
        k, which = through[0]
        name = contacts.names[which]
        sentence = f"contact '{name}' penetrates by {-gap[k, which]:.2g} at t = {t[k]:g}"
        if system.modes[which] is not Mode.OPEN and which not in system.normals:
            hint = "it shares a load, and gaps part where they bend, as corners exactly on corners"
            sentence = hinted(sentence, f"{hint} do: begin beside that")
        return IntegrationError(sentence, t=float(t[k]), quantity=name)
    loads = contacts.loads(t, y, switching.params)
    lifted = np.argwhere(loads < 0)
    if lifted.size:
        k, which = lifted[0]
        what = f"the load of contact '{contacts.names[which]}' is negative, {loads[k, which]:.3g}"
        return IntegrationError(f"{what}, at t = {t[k]:g}", t=float(t[k]))
    if pull := _pull(run, system, switching, count):
        at, name, force = pull
        sentence = f"contact '{name}' pulls with {force:.2g} at t = {at:g}, and may only press"
        return IntegrationError(hinted(sentence, "try a smaller h"), t=at, quantity=name)
    signs = np.array([mode.sign for mode in system.modes])
    back = np.argwhere(slip * signs[contacts.owner] < -BACKWARDS * fast)
    if back.size:
        k, row = back[0]
        name = contacts.names[contacts.owner[row]]
        against = f"contact '{name}' slips against its own friction"
        sentence = hinted(f"{against} at t = {t[k]:g}", "try a smaller h")
        return IntegrationError(sentence, t=float(t[k]), quantity=name)
    return None


def _pull(
    run: Solution, system: ModeSystem, switching: Switching, count: int
) -> tuple[float, str, float] | None:
    """Return when a contact pulls most, its name and its force, where that is no roundoff of it."""
    # contacts that share a load have a margin instead
    if system.is_shared or not run.states["lam"].size:
        return None
    gone = system.ended(run, float(run.t[count - 1]), ("leave", "tear"))
    for which, place in system.normals.items():
        # where a contact gives way, a force that jumps may be that behind the jump
        lam = run.states["lam"][: count - (which in gone), place]
        force = float(lam.max(initial=0.0))
        if not force:
            continue
        k = int(lam.argmax())
        t = run.t[k]
        y, z = (run.states[name][k] for name in switching.contacts.system.states)
        at = switching.at(float(t), y, z)
        if force * at.A[which, which] * switching.h > PULLS * at.sizes[which]:
            return float(t), switching.contacts.names[which], force
    return None
