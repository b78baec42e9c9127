"""Plans of charged particles: drifts and kicks, whose order is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods import VolumeSplitting
from liouville._methods.composition import SCHEMES, SYMMETRIC
from liouville._methods.planner.fields.plan import FieldPlan
from liouville._methods.planner.fields.trial_run import operations_of
from liouville._methods.planner.plan import AGAIN
from liouville._methods.splitting import Natural, Piece, Split, Turn, described
from liouville._systems.fields.particles import ChargedParticles

#: The composition where none is asked for, by the kind of turn.
USUAL = {"exact": "BM4", "boris": "S2"}

#: Orbits are none with fewer steps a gyration.
FEWEST = 4

#: What a plan counts.
COUNTED = "components of B and E"


def plan_particles(
    system: ChargedParticles, method: VolumeSplitting | FieldPlan, h: float, rows: np.ndarray
) -> tuple[FieldPlan, Split]:
    """Return the plan of particles for steps h from states, and the field split by it.

    Raises
    ------
    TypeError
        The method has words that are for polynomial fields.
    ValueError
        Boris's turn goes with another composition, or a plan was made for another field.
    """
    n = len(system.coordinates) + system.is_driven  # those held for derivatives are no matter
    if isinstance(method, FieldPlan):
        if not method.has_turns or (method.n, method.terms) != (n, system.forces.size):
            sentence = (
                f"the plan must be for charged particles with {n} variables and "
                f"{system.forces.size} {COUNTED}, not {method!r}"
            )
            raise ValueError(hinted(sentence, AGAIN))
        return method, split_of(system, method.method.turn)
    _check_method(method)
    name = USUAL[method.turn] if method.composition == "auto" else method.composition
    if method.turn == "boris" and name not in SYMMETRIC:
        sentence = f"Boris's turn must be composed by a scheme of symmetric steps, not {name}"
        hint = f"take one of {', '.join(SYMMETRIC)}, or turn='exact'"
        raise ValueError(hinted(sentence, hint))
    parts = split_of(system, method.turn)
    found = replace(
        method, composition=name, diagonal="exponentials", off_diagonal="natural", linear="split"
    )
    names = system.variables
    plan = FieldPlan(
        method=found, order=tuple(range(len(parts.pieces))), directions=(), n=n,
        terms=system.forces.size, h=abs(h), seed=0, cost=operations_of(parts, name),
        pieces=tuple(described(piece, names) for piece in parts.pieces),
        reasons=tuple(_reasons(parts, name, h, rows)), has_turns=True, counted=COUNTED,
    )  # fmt: skip
    return plan, parts


def split_of(system: ChargedParticles, turn: str = "exact") -> Split:
    """Return the pieces of particles, the first of which is in the middle of a symmetric step.

    That is the kick; of relativistic particles the push, as their turn is best outside. The turn
    of Boris's method is in the middle, where its halves are made as one.
    """
    forces, values, held = system.forces, system.values(None), system.held
    rates, drift = forces.rates(values, held), Natural(forces.drift(values, held))
    is_push = rates.component >= 3
    push = rates.selected(is_push)  # e, the rates of variables 3 to 5
    shears: list[Piece] = [Natural(push)] if len(push) else []
    if is_push.all():
        return Split(rates.n, (*shears, drift))
    v, is_boris = np.arange(3, 6), turn == "boris"
    if not (system.is_relativistic or is_boris):
        return Split(rates.n, (Turn(v, rates), drift))
    alone = Turn(v, rates.selected(~is_push), is_boris)
    if is_boris:
        return Split(rates.n, (alone, *shears, drift))
    return Split(rates.n, (*shears, drift, alone))


def _reasons(parts: Split, name: str, h: float, rows: np.ndarray) -> list[str]:
    """Say how many steps a gyration takes, where the states are."""
    if turn_of(parts) is None:
        return ["there is no magnetic field: a drift and a push"]
    largest = frequencies(parts, rows).max()
    if not 0 < largest < np.inf:
        return ["nothing turns at these states"]
    steps, wanted = 2 * np.pi / (largest * abs(h)), 20 if SCHEMES[name]["order"] == 2 else FEWEST
    few = f": fewer than the {wanted} that {name} wants" if steps < wanted else ""
    return [f"{steps:.3g} steps a gyration, at the state where it is shortest{few}"]


def turn_of(parts: Split) -> Turn | None:
    """Return the piece in which velocities turn, None where there is no magnetic field."""
    return next((piece for piece in parts.pieces if isinstance(piece, Turn)), None)


def frequencies(parts: Split, rows: np.ndarray) -> np.ndarray:
    """Return the angles by which velocities turn in unit time, at states of all variables."""
    turn = turn_of(parts)
    if turn is None:
        return np.zeros(len(rows))
    axis = turn.rates.selected(turn.rates.component < 3)
    return np.asarray(np.sqrt((axis.evaluate(rows) ** 2).sum(axis=-1)))


def _check_method(method: VolumeSplitting) -> None:
    usual = VolumeSplitting()
    for name in ("diagonal", "off_diagonal", "linear", "runge_kutta"):
        if getattr(method, name) != getattr(usual, name):
            sentence = f"{name}= is for polynomial fields: charged particles drift and turn"
            hint = "VolumeSplitting(composition='BM4', turn='exact') has all there is"
            raise TypeError(hinted(sentence, hint))
