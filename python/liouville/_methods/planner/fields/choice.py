"""The choice of a splitting: first by the structure of the field, then by trial runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from liouville._basics.arguments import amount
from liouville._basics.errors import hinted
from liouville._methods import VolumeSplitting
from liouville._methods.planner.fields.plan import FieldPlan, Trial, ordered, parted
from liouville._methods.planner.fields.structure import affine_part, candidates_of
from liouville._methods.planner.fields.trial_run import (
    STATES,
    TrialRun,
    costly_outside,
    operations_of,
    search,
)
from liouville._methods.splitting import Split, described, variables_of
from liouville._methods.splitting.trigonometric import numbered
from liouville._systems.fields.terms import Terms

#: The composition where none is asked for.
COMPOSITION = "BM4"

#: Fields of more variables are split by their structure alone, ...
MOST_TRIED = 2000
#: ... and those of more terms are tried in fewer orders.
MOST_TERMS, FEW = 2000, 10

#: The most pieces that a plan describes.
SHOWN = 20


@np.errstate(over="ignore", invalid="ignore")  # a trial run may go to infinity
def plan_field(
    terms: Terms,
    method: VolumeSplitting,
    h: float,
    x: np.ndarray,
    count: int | None,
    seed: int = 0,
    trials: int = 50,
    names: Sequence[str] | None = None,
) -> tuple[FieldPlan, Split]:
    """Choose whatever a method leaves open, for runs of `count` steps h from x of shape (P, n).

    Without a count x are typical states. Returns the plan and the field split by it. Messages name
    the variables as in `names`.
    """
    names = names or numbered(terms.n)
    if method.turn != "exact":
        hint = "lv.ChargedParticles has turns"
        raise TypeError(hinted("turn= is for charged particles, not for polynomial fields", hint))
    if not method.is_open:
        parts = parted(terms, method, names=names)
        reasons = ["everything is as asked for"]
        return _plan(terms, names, method, parts, costly_outside(parts), (), h, seed, reasons, [])
    scheme = COMPOSITION if method.composition == "auto" else method.composition
    rng = np.random.default_rng(seed)
    states = x[rng.permutation(len(x))[:STATES]]
    linear, linear_reasons = affine_part(terms, method, h, states)
    open_method = replace(method, composition=scheme, linear=linear)
    candidates, reasons = candidates_of(terms, open_method, names)
    is_zero = not len(terms)
    reasons = ["nothing moves"] if is_zero else [*linear_reasons, *reasons]
    splits = [parted(terms, candidate, names=names) for candidate in candidates]
    is_single = len(candidates) == 1 and len(splits[0].pieces) == 1
    if terms.n > MOST_TRIED or is_zero or is_single:
        order = costly_outside(splits[0])
        return _plan(terms, names, candidates[0], splits[0], order, (), h, seed, reasons, [])
    runs = TrialRun(list(zip(candidates, splits, strict=True)), states, h, count)
    found = [
        (runs.trial(candidate, parts), candidate, parts)
        for candidate, parts in zip(candidates, splits, strict=True)
    ]
    found.sort(key=lambda each: each[0].score)
    trial, candidate, parts = found[0]
    tried = [each[0] for each in found]
    if not np.isfinite(trial.error):
        reasons = [*reasons, "no candidate came through the trial run: h may be too large"]
        order = costly_outside(parts)
        return _plan(terms, names, candidate, parts, order, (), h, seed, reasons, tried)
    trials = trials if len(terms) <= MOST_TERMS else min(trials, FEW)
    order, directions, best = search(terms, runs, candidate, parts, rng, trials)
    where = amount(len(runs.x), "state") + (f" by steps of {runs.h:.3g}" if runs.h != h else "")
    reasons = [
        *reasons,
        f"{amount(len(found), 'candidate')} on {where}, then {trials} "
        f"orders of the best: cost at equal error {best.score / trial.score:.2f} of the first's",
    ]
    return _plan(terms, names, candidate, parts, order, directions, h, seed, reasons, tried)


def _plan(
    terms: Terms,
    names: Sequence[str],
    method: VolumeSplitting,
    parts: Split,
    order: tuple[int, ...],
    directions: tuple[int, ...],
    h: float,
    seed: int,
    reasons: Sequence[str],
    trials: Sequence[Trial],
) -> tuple[FieldPlan, Split]:
    parts = ordered(parted(terms, method, directions) if directions else parts, order)
    pieces = tuple(described(piece, variables_of(parts, names)) for piece in parts.pieces[:SHOWN])
    plan = FieldPlan(
        method=method, order=order, directions=directions, n=terms.n, terms=len(terms), h=h,
        seed=seed, cost=operations_of(parts, method.composition), pieces=pieces,
        reasons=tuple(reasons), trials=tuple(trials),
    )  # fmt: skip
    return plan, parts
