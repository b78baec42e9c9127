"""The choice of a splitting: first by the structure of the field, then by a pilot run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from liouville._arguments import count, number
from liouville.methods import VolumeSplitting
from liouville.planner.pilot import STATES, Pilot, costly_outside, operations_of, search
from liouville.planner.plan import Plan, Trial, ordered, parted
from liouville.planner.structure import affine_part, candidates_of
from liouville.splitting import Split, described, variables_of
from liouville.splitting.trigonometric import numbered
from liouville.systems import PolynomialField
from liouville.terms import Terms

#: The composition where none is asked for.
COMPOSITION = "BM4"

#: Fields of more variables are split by their structure alone, ...
MOST_PILOTED = 2000
#: ... and those of more terms are tried in fewer orders.
MOST_TERMS, FEW = 2000, 10

#: A plan says what so many of its pieces are.
SHOWN = 20


def plan(
    system: PolynomialField,
    method: VolumeSplitting | None = None,
    *,
    h: float,
    x: ArrayLike,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    trials: int = 50,
) -> Plan:
    """Choose how to split a field: by its structure, then by a pilot run on the user's own states.

    :func:`liouville.integrate` does the same for a method with ``"auto"`` in it. A plan of one's
    own can be looked at, saved, and used for many runs.

    Parameters
    ----------
    system : PolynomialField
        What is to be integrated.
    method : VolumeSplitting, optional
        What is fixed already; nothing by default.
    h : float
        The step it is to be good for.
    x : array_like, shape (n,) or (P, n)
        Typical states; up to 32 of them are tried.
    t : float, default 0
        Time of these states.
    params : mapping, optional
        Parameters that differ from the system's defaults.
    seed : int, default 0
        Of the random search. The same seed gives the same plan.
    trials : int, default 50
        How many orders of the pieces are tried.

    Returns
    -------
    Plan
        ``print`` it for the reasons.

    Raises
    ------
    TypeError, ValueError
        An argument is of the wrong kind or out of range.

    Notes
    -----
    Candidates are compared by cost times error to the power 1/order, the cost at equal error, over
    four steps of h and eight of h/2. Fields of more than 2000 variables are split by their
    structure alone. Of a single state x, those it passes through are tried.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import euler_top
    >>> plan = lv.plan(euler_top.system, h=0.1, x=[1.0, 0.5, 0.2])
    >>> plan.method.composition
    'BM4'
    """
    if not isinstance(system, PolynomialField):
        raise TypeError(f"a plan is for a PolynomialField, not {system!r}")
    if not isinstance(method, VolumeSplitting | None):
        raise TypeError(f"{method!r} does not split fields: method is a VolumeSplitting")
    step, time = number("h is a number", h), number("t is a number", t)
    if not (np.isfinite(step) and step > 0):
        raise ValueError(f"h is positive and finite, not {step}")
    if not np.isfinite(time):
        raise ValueError(f"t is finite, not {time}")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed is an integer from 0 on, not {seed!r}")
    system = system.with_params(params)
    states = np.atleast_2d(system.start({"x": x}, np.ndim(x) == 2))
    found, _ = planned(
        system.terms, method or VolumeSplitting(), step, system.extended(states, time), seed,
        count("trials", trials), system.variables,
    )  # fmt: skip
    return found


@np.errstate(over="ignore", invalid="ignore")  # a pilot run may go to infinity
def planned(
    terms: Terms,
    method: VolumeSplitting,
    h: float,
    x: np.ndarray,
    seed: int = 0,
    trials: int = 50,
    names: Sequence[str] | None = None,
) -> tuple[Plan, Split]:
    """Choose whatever a method leaves open, for a field at states x of shape (P, n) and a step h.

    Returns the plan and the field split by it. Messages name the variables as in `names`.
    """
    names = names or numbered(terms.n)
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
    reasons = [*linear_reasons, *reasons]
    splits = [parted(terms, candidate, names=names) for candidate in candidates]
    if terms.n > MOST_PILOTED or (len(candidates) == 1 and len(splits[0].pieces) == 1):
        order = costly_outside(splits[0])
        return _plan(terms, names, candidates[0], splits[0], order, (), h, seed, reasons, [])
    pilot = Pilot(terms, splits, states, h)
    found = [
        (pilot.trial(candidate, parts), candidate, parts)
        for candidate, parts in zip(candidates, splits, strict=True)
    ]
    found.sort(key=lambda each: each[0].score)
    trial, candidate, parts = found[0]
    tried = [each[0] for each in found]
    if not np.isfinite(trial.error):
        reasons = [*reasons, "no candidate came through the pilot run: h may be too large"]
        order = costly_outside(parts)
        return _plan(terms, names, candidate, parts, order, (), h, seed, reasons, tried)
    trials = trials if len(terms) <= MOST_TERMS else min(trials, FEW)
    order, turn, best = search(terms, pilot, candidate, parts, rng, trials)
    reasons = [
        *reasons,
        f"{_counted(len(found), 'candidate')} on {_counted(len(pilot.x), 'state')}, then {trials} "
        f"orders of the best: cost at equal error {best.score / trial.score:.2f} of the first's",
    ]
    return _plan(terms, names, candidate, parts, order, turn, h, seed, reasons, tried)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _plan(
    terms: Terms,
    names: Sequence[str],
    method: VolumeSplitting,
    parts: Split,
    order: tuple[int, ...],
    turn: tuple[int, ...],
    h: float,
    seed: int,
    reasons: Sequence[str],
    trials: Sequence[Trial],
) -> tuple[Plan, Split]:
    parts = ordered(parted(terms, method, turn) if turn else parts, order)
    words = tuple(described(piece, variables_of(parts, names)) for piece in parts.pieces[:SHOWN])
    plan = Plan(
        method=method, order=order, turn=turn, n=terms.n, terms=len(terms), h=h, seed=seed,
        cost=operations_of(parts, method.composition), pieces=words,
        reasons=tuple(reasons), trials=tuple(trials),
    )  # fmt: skip
    return plan, parts
