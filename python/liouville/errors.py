"""Errors for people: what was wrong, where, by the user's own names, and what to try."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from liouville.section import Section
    from liouville.solution import Solution


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


def hinted(message: str, hint: str) -> str:
    """Put the hint on a line of its own."""
    return f"{message}\nhint: {hint}"


def quoted(names: Sequence[str]) -> str:
    """Write names for a message: 'a', 'b' and 'c'."""
    words = [f"'{name}'" for name in names]
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else words[0]


def describe(
    trouble: dict[str, Any], coordinates: Sequence[str], constraints: Sequence[str]
) -> tuple[str, str, str]:
    """Say what a trouble of the core means in the user's names: sentence, hint and quantity."""
    kind = trouble["kind"]
    if kind == "not finite":
        return _not_finite(trouble, coordinates, constraints)
    if kind == "singular mass":
        name = coordinates[trouble["index"]]
        return (
            f"the mass matrix is singular: coordinate '{name}' has no inertia of its own",
            f"give '{name}' a mass, or a constraint that removes it together with its coordinate",
            name,
        )
    if kind == "redundant":
        names = [constraints[k] for k in trouble["constraints"]]
        if len(names) == 1:
            return (
                f"the gradient of constraint {quoted(names)} vanishes",
                "write the constraint so that it does not where the constraint holds",
                names[0],
            )
        return (
            f"constraints {quoted(names)} are redundant: their gradients are dependent",
            "remove one of them, or stay away from the singular position",
            names[0],
        )
    if kind == "singular":
        return (
            "the equations for velocities and multipliers are singular",
            "try a smaller h, keep away from singular positions, and let the velocity depend on z",
            "stages",
        )
    if kind == "step too small" and not math.isfinite(trouble["error"]):
        return (
            f"a step of {trouble['h']:.1e} would be needed, less than h_min",
            "look for a singularity there, where forces grow without bound or steps have no "
            "solution; else a smaller h_min may help",
            "step",
        )
    if kind == "monitor":
        return _monitor(trouble)
    if kind == "step too small":
        return (
            f"the error asks for a step of {trouble['h']:.1e}, less than h_min",
            "look for a force that jumps or grows without bound there; else a larger rtol, atol or "
            "a smaller h_min may help",
            "step",
        )
    if kind == "singular piece":
        return (
            f"the flow of a piece reaches infinity within the step: {trouble['quantity']}",
            "a trajectory may go to infinity there; if it should not, try a smaller h, or pieces "
            "without that danger: diagonal='shears', or 'regular' for degree 2",
            trouble["quantity"],
        )
    if kind == "overflow":
        name = coordinates[trouble["index"]]
        return (
            f"'{name}' is not finite after it",
            "a trajectory goes to infinity there; if it should not, try a smaller h",
            name,
        )
    if kind == "raised":
        error = trouble["cause"]
        return (
            f"a function of the model raised {type(error).__name__}: {error}",
            "its own traceback stands above",
            "model",
        )
    if kind == "no memory":
        return (
            "what is kept would soon not fit in memory",
            "keep fewer with every=, or none with states=False; a larger rtol takes fewer steps",
            "memory",
        )
    return (
        f"the iteration did not converge (last correction {trouble['size']:.0e})",
        "try a smaller h",
        "stages",
    )


def _monitor(trouble: dict[str, Any]) -> tuple[str, str, str]:
    value, rate = trouble["value"], trouble["rate"]
    what = (
        f"the monitor is {value:.6g}"
        if not value > 0 or value == math.inf
        else (f"the rate of the monitor is {rate:.6g}")
    )
    return (
        f"{what} at t = {trouble['t']:.6g}",
        "a monitor is the size of a step, up to a factor: positive and smooth",
        "monitor",
    )


def _not_finite(
    trouble: dict[str, Any], coordinates: Sequence[str], constraints: Sequence[str]
) -> tuple[str, str, str]:
    what, index = trouble["quantity"], trouble["index"]
    if what in ("constraint", "hidden constraint", "nonholonomic constraint"):
        quantity = constraints[index]
        name = f"{what} '{quantity}'"
    elif what in ("velocity", "momentum", "force", "reaction", "field"):
        quantity = coordinates[index]
        name = f"{what} of coordinate '{quantity}'"
    elif what == "derivative":
        quantity, name = what, "a derivative of the model"
    elif what == "power":
        quantity, name = what, "the power of the forces"
    else:
        kind, _, quantity = what.partition(" ")  # "observed NAME" or "invariant NAME"
        name = f"{kind} '{quantity}'"
    sentence = f"{name} is not finite at t = {trouble['t']:.6g}"
    hint = "look for a division by zero, a root or a logarithm of the model there"
    return sentence, hint, quantity
