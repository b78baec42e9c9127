"""The choice of a splitting: first by the structure of the field, then by a pilot run."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import comb
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import count, number
from liouville.errors import hinted
from liouville.methods import VolumeSplitting
from liouville.methods.composition import SCHEMES
from liouville.splitting import Piece, Split, crossed, split
from liouville.systems import PolynomialField
from liouville.terms import Terms

#: The composition where none is asked for.
COMPOSITION = "BM4"

#: What candidates are compared with, in steps that are this much shorter.
REFERENCE, FINER = "SS8s21", 4

#: States of a pilot, and its steps.
STATES, STEPS = 32, 4

#: A field with fewer than this part of all terms of its degree is sparse.
SPARSE = 0.3

#: Fields of more variables are split by their structure alone.
MOST_PILOTED = 2000

#: Affine parts of more variables are not exponentiated.
MOST_EXACT = 200

#: Errors below this say nothing.
ROUNDOFF = 1e-15

#: What an exponential or a logarithm costs, in multiplications.
FUNCTION = 20


@dataclass(frozen=True)
class Trial:
    """A candidate in the pilot run.

    Attributes
    ----------
    method : VolumeSplitting
        What was tried.
    pieces : int
        How many pieces it has.
    cost : float
        Operations of a step.
    error : float
        Root mean square error of the pilot, infinite where it failed.
    """

    method: VolumeSplitting
    pieces: int
    cost: float
    error: float

    @property
    def score(self) -> float:
        """Cost at equal error: cost times error to the power 1/order."""
        return self.cost * max(self.error, ROUNDOFF) ** (1.0 / (self.method.order or 1))


@dataclass(frozen=True)
class Plan:
    """A splitting with nothing left to choose, and why; :func:`liouville.integrate` takes it as a method.

    Attributes
    ----------
    method : VolumeSplitting
        The method, without ``"auto"``.
    order : tuple of int
        The order in which its pieces follow one another.
    turn : tuple of int
        Which direction of shears each variable takes; empty where that has no choice.
    n, terms : int
        Number of variables and terms of the field that was planned for.
    h : float
        The step planned for.
    seed : int
        Of the random search.
    cost : float
        Operations of a step, multiplications and additions.
    pieces, reasons : tuple of str
        What there is, in words, and why.
    trials : tuple of Trial
        The candidates of the pilot run, the best one first.
    """

    form: ClassVar[str] = "field"
    method: VolumeSplitting
    order: tuple[int, ...]
    turn: tuple[int, ...]
    n: int
    terms: int
    h: float
    seed: int
    cost: float
    pieces: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    trials: tuple[Trial, ...] = field(default=(), repr=False)

    def split(self, terms: Terms) -> Split:
        """Split a field as planned.

        Raises
        ------
        ValueError
            The plan was made for another field.
        """
        if (terms.n, len(terms)) != (self.n, self.terms):
            raise ValueError(
                hinted(
                    f"the plan is for a field of {self.n} variables and {self.terms} terms, not "
                    f"{terms.n} and {len(terms)}",
                    "make one for this field with lv.plan(...)",
                )
            )
        return _ordered(_split(terms, self.method, self.turn), self.order)

    def __str__(self) -> str:
        """Explain the plan: which pieces, why, and what a step costs."""
        m = self.method
        lines = [
            f"{m.composition} of {len(self.order)} pieces: {_words(m)}",
            f"  {self.n} variables, {self.terms} terms, h = {self.h:g}; "
            f"a step takes about {self.cost:.3g} operations",
            "why",
            *(f"  {reason}" for reason in self.reasons),
            "pieces, in the order of the first half of a step",
            *(f"  {text}" for text in self.pieces),
        ]
        if self.trials:
            lines.append("pilot: operations a step, error, cost at equal error")
            best = self.trials[0].score
            for trial in self.trials:
                error = f"{trial.error:.1e}" if np.isfinite(trial.error) else "failed"
                lines.append(
                    f"  {_words(trial.method):34} {trial.cost:8.3g} {error:>8} "
                    f"{trial.score / best:6.2f}"
                )
        return "\n".join(lines)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan to a JSON file, for :meth:`load`."""
        Path(path).write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Plan:
        """Read a plan that :meth:`save` wrote.

        Raises
        ------
        ValueError
            The file is no plan.
        """
        try:
            given = json.loads(Path(path).read_text(encoding="utf-8"))
            trials = tuple(
                Trial(**{**trial, "method": VolumeSplitting(**trial["method"])})
                for trial in given.pop("trials")
            )
            method = VolumeSplitting(**given.pop("method"))
            lists = {k: tuple(x) if isinstance(x, list) else x for k, x in given.items()}
            return cls(method=method, trials=trials, **lists)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"{str(path)!r} is no plan: {error}") from error


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

    :func:`liouville.integrate` does the same for a method with ``"auto"`` in it. A plan of one's own
    can be looked at, saved, and used for many runs.

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
    structure alone.

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
        raise TypeError(f"method is a VolumeSplitting, not {method!r}")
    step, time = number("h is a number", h), number("t is a number", t)
    if not np.isfinite(step) or step == 0:
        raise ValueError(f"h is finite and not zero, not {step}")
    if not np.isfinite(time):
        raise ValueError(f"t is finite, not {time}")
    system = system.with_params(params)
    states = np.atleast_2d(system.start({"x": x}, np.ndim(x) == 2))
    found, _ = planned(
        system.terms, method or VolumeSplitting(), step, system.extended(states, time), seed,
        count("trials", trials),
    )  # fmt: skip
    return found


def planned(
    terms: Terms, method: VolumeSplitting, h: float, x: np.ndarray, seed: int = 0, trials: int = 50
) -> tuple[Plan, Split]:
    """Choose whatever a method leaves open, for a field at states x of shape (P, n) and a step h.

    Returns the plan and the field split by it.
    """
    if "auto" not in (method.diagonal, method.off_diagonal, method.composition, method.linear):
        parts = _split(terms, method, ())
        reasons = ["everything is as asked for"]
        return _plan(terms, method, parts, _costly_outside(parts), (), h, seed, reasons, [])
    scheme = COMPOSITION if method.composition == "auto" else method.composition
    rng = np.random.default_rng(seed)
    states = x[rng.permutation(len(x))[:STATES]]
    linear, linear_reasons = _linear(terms, method, h, states)
    open_method = replace(method, composition=scheme, linear=linear)
    candidates, reasons = _candidates(terms, open_method)
    reasons = [*linear_reasons, *reasons]
    splits = [_split(terms, candidate, ()) for candidate in candidates]
    if terms.n > MOST_PILOTED or len(candidates) == 1 and len(splits[0].pieces) == 1:
        order = _costly_outside(splits[0])
        return _plan(terms, candidates[0], splits[0], order, (), h, seed, reasons, [])
    pilot = _Pilot(terms, splits, states, h)
    found = [
        (pilot.trial(candidate, parts), candidate, parts)
        for candidate, parts in zip(candidates, splits, strict=True)
    ]
    found.sort(key=lambda each: each[0].score)
    trial, candidate, parts = found[0]
    if not np.isfinite(trial.error):
        reasons = [*reasons, "no candidate came through the pilot run: h is too large"]
    order, turn, best = _search(terms, pilot, candidate, parts, rng, trials)
    reasons = [
        *reasons,
        f"{len(found)} candidates on {len(states)} states, then {trials} orders of the best: "
        f"cost at equal error {best.score / trial.score:.2f} of the first order's",
    ]
    plan = _plan(
        terms, candidate, parts, order, turn, h, seed, reasons, [each[0] for each in found]
    )
    return plan


def _plan(
    terms: Terms,
    method: VolumeSplitting,
    parts: Split,
    order: tuple[int, ...],
    turn: tuple[int, ...],
    h: float,
    seed: int,
    reasons: Sequence[str],
    trials: Sequence[Trial],
) -> tuple[Plan, Split]:
    parts = _ordered(_split(terms, method, turn) if turn else parts, order)
    plan = Plan(
        method=method, order=order, turn=turn, n=terms.n, terms=len(terms), h=h, seed=seed,
        cost=_cost(parts, method.composition), pieces=tuple(map(str, parts.pieces[:20])),
        reasons=tuple(reasons), trials=tuple(trials),
    )  # fmt: skip
    return plan, parts


def _words(method: VolumeSplitting) -> str:
    exact = ["affine part exactly"] if method.linear == "exact" else []
    diagonal = "n + d shears" if method.diagonal == "n+d" else method.diagonal
    off = [] if method.diagonal == "n+d" else [method.off_diagonal]
    if method.off_diagonal == "triangular":
        off = [f"triangular ({method.runge_kutta})"]
    return ", ".join([*exact, diagonal, *off])


def _split(terms: Terms, method: VolumeSplitting, turn: Sequence[int]) -> Split:
    return split(
        terms, method.diagonal, method.off_diagonal, turn=turn or None,
        runge_kutta=method.runge_kutta, linear=method.linear,
    )  # fmt: skip


def _ordered(parts: Split, order: Sequence[int]) -> Split:
    return replace(parts, pieces=tuple(parts.pieces[k] for k in order))


# Structure


def _linear(
    terms: Terms, method: VolumeSplitting, h: float, states: np.ndarray
) -> tuple[str, list[str]]:
    """Take the affine part exactly if it is fast, and larger than the rest."""
    if method.linear != "auto":
        return method.linear, []
    affine = terms.selected(terms.degrees <= 1)
    if terms.n > MOST_EXACT or terms.waves or not len(affine):
        return "split", []
    if len(affine) == len(terms):
        return "exact", ["the field is affine: one exact flow is all of it"]
    matrix = np.zeros((terms.n, terms.n))
    is_linear = affine.degrees == 1
    matrix[affine.component[is_linear], affine.variables[is_linear, -1]] = (
        affine.to_float().coefficient[is_linear]
    )
    rate = float(np.linalg.norm(matrix, 2)) * abs(h)
    parts = [np.linalg.norm(part.to_float().evaluate(states)) for part in (affine, terms - affine)]
    if rate > 0.5 and parts[0] > parts[1]:
        return "exact", [f"the affine part is fast, |A| h = {rate:.2g}: it is integrated exactly"]
    return "split", []


def _candidates(terms: Terms, method: VolumeSplitting) -> tuple[list[VolumeSplitting], list[str]]:
    """List what is worth trying, the safest first, and say why."""
    diagonals, offs, reasons = _by_structure(terms, method)
    pairs = [
        (diagonal, "natural" if diagonal == "n+d" else off)
        for diagonal in diagonals
        for off in offs
    ]
    if method.diagonal == "auto" and method.off_diagonal == "auto" and len(diagonals) > 1:
        # shears fill in what triangular pieces are for
        pairs = [pair for pair in pairs if pair[1] == "natural" or pair[0] == "exponentials"]
    distinct = list(dict.fromkeys(pairs))
    return [replace(method, diagonal=d, off_diagonal=o) for d, o in distinct], reasons


def _by_structure(terms: Terms, method: VolumeSplitting) -> tuple[list[str], list[str], list[str]]:
    diagonal, reasons = terms.diagonal(), []
    offs = ["natural"] if terms.waves else ["natural", "triangular"]
    if method.off_diagonal != "auto":
        offs = [method.off_diagonal]
    if method.diagonal != "auto":
        return [method.diagonal], offs, ["the diagonal part is as asked for"]
    if not len(diagonal):
        reasons = ["no component contains its own variable: no diagonal part, no fill-in"]
        return ["exponentials"], offs, reasons
    why = _keeps_structure(terms)
    if why or terms.degree == 1 or terms.waves:
        reasons = [why or "the diagonal part is linear"]
        return ["exponentials"], (["natural"] if method.off_diagonal == "auto" else offs), reasons
    diagonals = ["exponentials", "shears"]
    diagonals += ["regular"] if terms.degree == 2 and terms.n >= 3 else []
    diagonals += ["n+d"] if method.off_diagonal == "auto" else []
    return (
        diagonals,
        offs,
        ["the field is dense, without invariant planes or reversing reflections"],
    )


def _keeps_structure(terms: Terms) -> str:
    """Say what of the field only exponentials and natural shears keep, if there is anything."""
    n, d = terms.n, terms.degree
    dense = n * comb(n + d, d)
    if len(terms) < SPARSE * dense:
        return f"the field is sparse: {len(terms)} terms of {dense}"
    planes = np.setdiff1d(np.arange(n), terms.off_diagonal().component)
    if planes.size:
        return f"the plane x_{planes[0]} = 0 is invariant, and stays so"
    if _has_reversing_reflection(terms):
        return "a reflection of some variables reverses the flow, and keeps doing so"
    return ""


def _has_reversing_reflection(terms: Terms) -> bool:
    """Say whether signs s_i = ±1 exist with s_i f_i(s x) = -f_i(x): linear equations modulo 2."""
    n = terms.n
    rows = np.zeros((len(terms), n + 1), dtype=bool)
    at = np.arange(len(terms))
    rows[at, terms.component] ^= True
    for column in terms.variables.T:
        there = column >= 0
        rows[at[there], column[there]] ^= True
    rows[:, n] = True
    for pivot in range(n):
        hits = np.flatnonzero(rows[:, pivot])
        if hits.size:
            row = rows[hits[0]].copy()
            rows[hits] ^= row
    return not rows[:, n].any()


# Cost


def _operations(piece: Piece) -> float:
    """Count the operations of a flow of a piece."""
    return float(piece.operations + FUNCTION * piece.functions)


def _cost(parts: Split, scheme: str) -> float:
    """Count the operations of a step in a long run, where neighbouring exact flows are one."""
    costs = [_operations(piece) for piece in parts.pieces]
    halves = len(SCHEMES[scheme]["flows"])
    if halves == 1:
        return sum(costs)
    ends = [costs[k] for k in (0, -1) if parts.pieces[k].is_exact]
    return halves * (sum(costs) - sum(ends) / 2)


def _costly_outside(parts: Split) -> tuple[int, ...]:
    """Put the two costliest pieces first and last, where they are made half as often."""
    costs = [_operations(piece) for piece in parts.pieces]
    inner = np.argsort(costs, kind="stable").tolist()
    if len(inner) < 3:
        return tuple(range(len(inner)))
    first, last = sorted(inner[-2:])
    return (first, *sorted(inner[:-2]), last)


# Pilot


class _Pilot:
    """Short runs from some states, compared with a much better one."""

    def __init__(self, terms: Terms, splits: Iterable[Split], x: np.ndarray, h: float) -> None:
        self.x, self.h = x, h
        self.reference = None
        for parts in splits:
            self.reference = self.end(parts, REFERENCE, h / FINER, STEPS * FINER)
            if self.reference is not None:
                break

    def end(self, parts: Split, scheme: str, h: float, steps: int) -> np.ndarray | None:
        """Return where the states go, None if a step fails."""
        n = parts.n
        tape = _core.Tape([1, n, 0], 0, np.empty((0, 4), dtype=np.int64), np.empty(0))
        y = parts.inward(self.x)
        run = _core.split_run(
            crossed(parts), scheme, tape, np.empty(0), y, (n, parts.outward),
            (0.0, h * steps, steps, steps), (False, True), 1, True,
        )  # fmt: skip
        if isinstance(run, dict) or run.advance(1e6) != "done":
            return None
        _, rows = run.take()
        return rows[-1]

    def trial(self, method: VolumeSplitting, parts: Split) -> Trial:
        """Try a split field with the step asked for and half of it."""
        scheme = method.composition
        errors = []
        for halves in (1, 2):
            end = self.end(parts, scheme, self.h / halves, STEPS * halves)
            if end is None or self.reference is None:
                errors.append(np.inf)
            else:
                error = np.sqrt(np.mean((end - self.reference) ** 2))
                errors.append(max(error, ROUNDOFF) * halves ** (method.order or 1))
        return Trial(
            method, len(parts.pieces), _cost(parts, scheme), float(np.sqrt(errors[0] * errors[1]))
        )


def _search(
    terms: Terms,
    pilot: _Pilot,
    method: VolumeSplitting,
    parts: Split,
    rng: np.random.Generator,
    trials: int,
) -> tuple[tuple[int, ...], tuple[int, ...], Trial]:
    """Try orders of the pieces and, where shears have directions, who takes which."""
    m = len(parts.pieces)
    turns = method.diagonal in ("shears", "n+d") and len(terms) <= 500
    best_order, best_turn = tuple(range(m)), ()
    best = pilot.trial(method, parts)
    for k in range(trials if m > 1 else 0):
        turn: tuple[int, ...] = ()
        if turns and k % 2:
            turn = tuple(rng.permutation(terms.n).tolist())
        base = _split(terms, method, turn) if turn else parts
        order = _costly_outside(base) if k == 0 else tuple(rng.permutation(m).tolist())
        trial = pilot.trial(method, _ordered(base, order))
        if trial.score < best.score:
            best, best_order, best_turn = trial, order, turn
    return best_order, best_turn, best
