"""A plan: how a field is split, with nothing left to choose, and why."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from liouville.errors import hinted
from liouville.methods import VolumeSplitting
from liouville.splitting import Split, split
from liouville.terms import Terms

#: What to try where a plan does not fit.
AGAIN = "make one for this field with lv.plan(...)"

#: Errors below this say nothing.
ROUNDOFF = 1e-15


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
        return float(self.cost * max(self.error, ROUNDOFF) ** (1.0 / (self.method.order or 1)))


@dataclass(frozen=True, repr=False)
class Plan:
    """A splitting with nothing left to choose, and why.

    :func:`liouville.integrate` takes it as a method.

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

    def split(self, terms: Terms, names: Sequence[str] | None = None) -> Split:
        """Split a field as planned; `names` are those of its variables, for messages.

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
                    AGAIN,
                )
            )
        parts = parted(terms, self.method, self.turn, names)
        if sorted(self.order) != list(range(len(parts.pieces))):
            raise ValueError(
                hinted(
                    f"the plan is for a field of {len(self.order)} pieces, and this one has "
                    f"{len(parts.pieces)}",
                    AGAIN,
                )
            )
        return ordered(parts, self.order)

    def __repr__(self) -> str:
        """Name the method and how many pieces there are."""
        return f"<Plan of {len(self.order)} pieces: {self.method!r}>"

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
        if len(self.order) > len(self.pieces):
            lines.append(f"  and {len(self.order) - len(self.pieces)} more")
        if self.trials:
            lines.append("pilot: operations a step, error, cost at equal error")
            best = self.trials[0].score
            for trial in self.trials:
                line = f"  {_words(trial.method):34} {trial.cost:8.3g} "
                if np.isfinite(trial.error):
                    lines.append(f"{line} {trial.error:7.1e} {trial.score / best:6.2f}")
                else:
                    lines.append(f"{line}  failed")
        return "\n".join(lines)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan to a JSON file, for :meth:`load`."""
        Path(path).write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Plan:
        """Read a plan that :meth:`save` wrote.

        Raises
        ------
        FileNotFoundError
            There is no such file.
        ValueError
            The file is no plan.
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"there is no plan file {str(path)!r}")
        try:
            return cls._read(json.loads(Path(path).read_bytes()))
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            why = f"{error} is missing" if isinstance(error, KeyError) else error
            message = f"{str(path)!r} is no plan that liouville saved: {why}"
            raise ValueError(hinted(message, "lv.plan(...).save(path) writes one")) from error

    @classmethod
    def _read(cls, given: Any) -> Plan:
        if not isinstance(given, dict):
            raise TypeError(f"it holds a {type(given).__name__}")
        trials, method = given.pop("trials"), VolumeSplitting(**given.pop("method"))
        tried = tuple(Trial(VolumeSplitting(**each.pop("method")), **each) for each in trials)
        rest: dict[str, Any] = {k: tuple(x) if isinstance(x, list) else x for k, x in given.items()}
        plan = cls(method=method, trials=tried, **rest)
        if plan.method.is_open:
            raise ValueError("its method leaves something to choose")
        kinds = {"n": int, "terms": int, "seed": int, "h": float, "cost": float}
        for name, kind in kinds.items():
            if not isinstance(getattr(plan, name), kind):
                raise TypeError(f"{name} is no {kind.__name__}")
        for name, count in (("order", len(plan.order)), ("turn", plan.n if plan.turn else 0)):
            if sorted(getattr(plan, name)) != list(range(count)):
                raise ValueError(f"{name} is no permutation")
        return plan


def _words(method: VolumeSplitting) -> str:
    exact = ["affine part exactly"] if method.linear == "exact" else []
    diagonal = "n + d shears" if method.diagonal == "n+d" else method.diagonal
    off = [] if method.diagonal == "n+d" else [method.off_diagonal]
    if method.off_diagonal == "triangular":
        off = [f"triangular ({method.runge_kutta})"]
    return ", ".join([*exact, diagonal, *off])


def parted(
    terms: Terms,
    method: VolumeSplitting,
    turn: Sequence[int] = (),
    names: Sequence[str] | None = None,
) -> Split:
    """Split a field by a method without ``"auto"``."""
    return split(
        terms, method.diagonal, method.off_diagonal, turn=turn or None,
        runge_kutta=method.runge_kutta, linear=method.linear, names=names,
    )  # fmt: skip


def ordered(parts: Split, order: Sequence[int]) -> Split:
    """Put the pieces in another order."""
    return replace(parts, pieces=tuple(parts.pieces[k] for k in order))
