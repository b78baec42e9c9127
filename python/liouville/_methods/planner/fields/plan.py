"""Plans of polynomial fields: how a field is split, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods import VolumeSplitting
from liouville._methods.planner.plan import AGAIN, Plan, check_fields, decoded, read_method
from liouville._methods.splitting import Split, split
from liouville._systems.fields.terms import Terms

#: The name of the methods of the trials.
NAME = "volume-splitting"

#: Errors below this are roundoff.
ROUNDOFF = 1e-15


@dataclass(frozen=True)
class Trial:
    """A candidate in the trial run.

    Attributes
    ----------
    method : VolumeSplitting
        What was tried.
    pieces : int
        How many pieces it has.
    cost : float
        Operations of a step.
    error : float
        Root mean square error of the run, infinite where it failed.
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
class FieldPlan(Plan):
    """A splitting of a polynomial field with nothing left to choose, and why; see :class:`Plan`.

    Attributes
    ----------
    method : VolumeSplitting
        The method, without ``"auto"``.
    order : tuple of int
        The order in which its pieces follow one another in the second half of a step; the first
        half has them the other way round.
    directions : tuple of int
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
        The first pieces in words, and why.
    trials : tuple of Trial
        The candidates of the trial run, the best one first.
    has_planes : bool
        Whether the pieces are planes.
    has_turns : bool
        Whether the pieces are those of charged particles.
    counted : str
        What is counted as terms: "coefficients" of a gridded field, "operations" of a potential.
    """

    form: ClassVar[str] = "field"
    method: VolumeSplitting
    reasons: tuple[str, ...]
    order: tuple[int, ...]
    directions: tuple[int, ...]
    n: int
    terms: int
    h: float
    seed: int
    cost: float
    pieces: tuple[str, ...] = ()
    trials: tuple[Trial, ...] = field(default=(), repr=False)
    has_planes: bool = False
    has_turns: bool = False
    counted: str = "terms"

    def split(self, terms: Terms, names: Sequence[str] | None = None) -> Split:
        """Split a field as planned; `names` are those of its variables, for messages.

        Raises
        ------
        ValueError
            The plan was made for another field.
        """
        if self.has_planes or self.has_turns or (terms.n, len(terms)) != (self.n, self.terms):
            raise ValueError(
                hinted(
                    f"the plan must be for a field of {self.n} variables and {self.terms} terms, "
                    f"not {terms.n} and {len(terms)}",
                    AGAIN,
                )
            )
        parts = parted(terms, self.method, self.directions, names)
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
        return f"<FieldPlan of {len(self.order)} pieces: {self.method!r}>"

    def _lines(self) -> list[str]:
        m = self.method
        words = "planes by symplectic Euler" if self.has_planes else _words(m)
        words = "drifts and kicks" if self.has_turns else words
        counted = self.counted if self.terms != 1 else self.counted.replace("s", "", 1)
        lines = [
            f"{m.composition} of {len(self.order)} pieces: {words}",
            f"  {self.n} variables, {self.terms} {counted}, h = {self.h:g}; "
            f"a step takes about {self.cost:.3g} operations",
            *self._why,
            "pieces, in the order of the second half of a step",
            *(f"  {text}" for text in self.pieces),
        ]
        if len(self.order) > len(self.pieces):
            lines.append(f"  and {len(self.order) - len(self.pieces)} more")
        if self.trials:
            lines.append("trial run: operations a step, error, cost at equal error")
            best = self.trials[0].score
            for trial in self.trials:
                line = f"  {_words(trial.method):34} {trial.cost:8.3g} "
                if np.isfinite(trial.error):
                    lines.append(f"{line} {trial.error:7.1e} {trial.score / best:6.2f}")
                else:
                    lines.append(f"{line}  failed")
        return lines

    @classmethod
    def _read(cls, given: dict[str, Any]) -> Self:
        trials = tuple(
            Trial(_splitting(read_method({"name": NAME, **each.pop("method")})), **each)
            for each in given.pop("trials")
        )
        method = _splitting(given.pop("method"))
        plan = cls(method=method, trials=trials, **decoded(given))
        if plan.method.is_open and not (plan.has_planes and plan.method.order):
            raise ValueError("its method leaves something to choose")
        for each in (plan, *trials):
            check_fields(each)
        counts = (("order", len(plan.order)), ("directions", plan.n if plan.directions else 0))
        for name, count in counts:
            found = getattr(plan, name)
            if len(found) != count or sorted(found) != list(range(count)):
                raise ValueError(f"{name} is no permutation")
        return plan


def _splitting(method: Any) -> VolumeSplitting:
    if not isinstance(method, VolumeSplitting):
        raise TypeError(f"its method is {method!r}")
    return method


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
    directions: Sequence[int] = (),
    names: Sequence[str] | None = None,
) -> Split:
    """Split a field by a method without ``"auto"``."""
    return split(
        terms, method.diagonal, method.off_diagonal, turn=directions or None,
        runge_kutta=method.runge_kutta, linear=method.linear, names=names,
    )  # fmt: skip


def ordered(parts: Split, order: Sequence[int]) -> Split:
    """Put the pieces in another order."""
    return replace(parts, pieces=tuple(parts.pieces[k] for k in order))
