"""Errors for people: what was wrong, where, by the user's own names, and what to try."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from liouville._solution.solution import Solution
    from liouville._studies.optimal import OptimalControl
    from liouville._studies.section import Section


#: A message has so many names.
MOST_QUOTED = 8

#: A list of names without quotes has so many.
MOST_SHOWN = 20

#: How much a name has in common with one that it may be meant for, as difflib counts.
NEAR = 0.5
#: The same of an attribute, of which there are many.
ALIKE = 0.7


class IntegrationError(RuntimeError):
    """A step of a run failed; what was computed before it is kept.

    Attributes
    ----------
    t : float
        Time at the start of the failed step.
    step : int
        Number of the failed step, from 0.
    quantity : str
        What failed, by the user's name: a coordinate, a constraint, or a function of the model.
    member : int or None
        Which member of an ensemble failed.
    solution : Solution or None
        Everything up to the last good step.
    section : Section or None
        Where a section was asked for, the crossings found before.
    """

    def __init__(
        self,
        message: str,
        *,
        t: float = float("nan"),
        step: int = 0,
        quantity: str = "",
        member: int | None = None,
        solution: Solution | None = None,
        section: Section | None = None,
    ) -> None:
        super().__init__(message)
        self.t = t
        self.step = step
        self.quantity = quantity
        self.member = member
        self.solution = solution
        self.section = section


class OptimizationError(RuntimeError):
    """IPOPT found no solution of an optimal control problem.

    Attributes
    ----------
    status : str
        What IPOPT returned, such as ``"Infeasible_Problem_Detected"``.
    iterations : int
        How many it took.
    result : OptimalControl or None
        The last iterate, which may be the guess of another attempt.
    """

    def __init__(
        self,
        message: str,
        *,
        status: str = "",
        iterations: int = 0,
        result: OptimalControl | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.iterations = iterations
        self.result = result


def hinted(message: str, hint: str) -> str:
    """Put the hint on a line of its own."""
    return f"{message}\nhint: {hint}"


def misshapen(name: str, shape: Sequence[int], wanted: object, hint: str = "") -> ValueError:
    """Return the error for an array of a wrong shape: x must have shape (2,), not (3,)."""
    sentence = f"{name} must have shape {wanted}, not {tuple(shape)}"
    return ValueError(hinted(sentence, hint) if hint else sentence)


def quoted(names: Sequence[str]) -> str:
    """Write names for a message: 'a', 'b' and 'c', of many the first and how many more."""
    words = [f"'{name}'" for name in names]
    if len(words) > MOST_QUOTED:
        words = [*words[: MOST_QUOTED - 1], f"{len(words) - MOST_QUOTED + 1} more"]
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else words[0]


def shown(names: Sequence[str]) -> str:
    """Join names, the first and the last where they are many."""
    return ", ".join((*names[:3], "...", names[-1]) if len(names) > MOST_SHOWN else names)


def meant(name: str, names: Collection[str]) -> str:
    """Return a hint on a name that is none: the nearest one, or all where none is near."""
    near = get_close_matches(name, names, n=1, cutoff=NEAR)
    return f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names)}"


def no_attribute(of: str, name: str, known: Collection[str]) -> AttributeError:
    """Return the error for an attribute that there is not, with the name that was meant."""
    near = get_close_matches(name, known, n=1, cutoff=ALIKE)
    sentence = f"{of} has no attribute {name!r}"
    if near:
        sentence = hinted(sentence, f"did you mean {near[0]!r}?")
    elif len(known) <= MOST_SHOWN:
        sentence = hinted(sentence, f"it has {', '.join(known)}")
    # without obj=, by which Python would make the same suggestion once more
    return AttributeError(sentence, name=name)


def public(owner: object) -> list[str]:
    """Return the public attributes of an object."""
    return [x for x in dir(owner) if not x.startswith("_")]


class Suggesting:
    """A base of results: an attribute that there is not is answered by the nearest one there is."""

    if not TYPE_CHECKING:  # whatever has a type is there

        def __getattr__(self, name: str) -> Any:
            """Refuse a name that is none."""
            if name.startswith("_") or hasattr(type(self), name):
                return object.__getattribute__(self, name)  # raises the error of its own
            raise no_attribute(f"{type(self).__name__!r} object", name, public(self))


def check_name(name: str, names: Collection[str], kind: str, of: str = "solution") -> None:
    """Refuse a name that a solution, or what else it is of, has not."""
    if name not in names:
        known = ", ".join(names) or "none"
        raise ValueError(hinted(f"the {of} has no {kind} {name!r}", f"it has {known}"))
