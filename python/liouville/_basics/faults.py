"""Errors of the core in the user's names: what was wrong, where, and what to try."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from liouville._basics.errors import quoted

#: What helps where equations jump near the state from which a step cannot be made.
JUMP = (
    "friction that sticks is that of an lv.Contact; else write a smooth function, such as "
    "ca.tanh(x / e) for ca.sign(x), or end steps there by switches= of the system with rtol="
)

#: Sentence, hint and quantity of an error of the core.
Description = tuple[str, str, str]


def describe(
    error: dict[str, Any], coordinates: Sequence[str], constraints: Sequence[str]
) -> Description:
    """Describe an error of the core in the user's names: sentence, hint and quantity."""
    sentence, hint, quantity = _described(error, coordinates, constraints)
    if name := error.get("jump"):
        return f"{sentence}; the equations jump with '{name}' near there", JUMP, quantity
    if names := error.get("dependent"):
        what = (
            f"the gradient of constraint {quoted(names)} nearly vanishes"
            if len(names) == 1
            else f"constraints {quoted(names)} are nearly dependent"
        )
        if error["kind"] != "step too large":
            hint = "keep away from that singular position, or pass it with another, also larger, h"
        return f"{sentence}; {what} there", hint, quantity
    return sentence, hint, quantity


def _described(
    error: dict[str, Any], coordinates: Sequence[str], constraints: Sequence[str]
) -> Description:
    match error["kind"]:
        case "not finite":
            return _not_finite(error, coordinates, constraints)
        case "singular mass":
            return _singular_mass(coordinates[error["index"]])
        case "overflow":
            return _overflow(coordinates[error["index"]])
        case "outside":
            return _outside(coordinates[error["index"]])
        case "reset":
            return _reset(error, constraints)
        case "no derivative":
            return _no_derivative(error)
        case "redundant":
            return _redundant([constraints[k] for k in error["constraints"]])
        case "contradiction":
            return _contradiction(constraints[error["index"]])
        case "step too large":
            return _step_too_large(coordinates[error["index"]], error)
        case "step too small":
            return _step_too_small(error)
        case "creeps":
            return f"steps have shrunk to {error['h']:.1e} and get nowhere", JUMP, "step"
        case "monitor":
            return _monitor(error)
        case "singular piece":
            return _singular_piece(error["quantity"])
        case "singular function":
            return _singular_function(error["quantity"], error["t"])
        case "raised":
            return _raised(error["cause"])
        case "singular":
            return _SINGULAR
        case "no multipliers":
            return _NO_MULTIPLIERS
        case "no memory":
            return _NO_MEMORY
        case _:
            return _not_converged(error["size"])


_SINGULAR = (
    "the equations for velocities and multipliers are singular",
    "keep away from singular positions, and let the velocity depend on z",
    "stages",
)
_NO_MULTIPLIERS = (
    "no multipliers were found whose reactions, which are not linear in them, hold the constraints",
    "let each reaction change with its multiplier at every value, at 0 too, and far enough for the "
    "forces",
    "stages",
)
_NO_MEMORY = (
    "what is kept would soon not fit in memory",
    "keep fewer with every=, or none with states=False; a larger rtol takes fewer steps",
    "memory",
)


def _singular_mass(name: str) -> Description:
    return (
        f"the mass matrix is singular: coordinate '{name}' has no inertia of its own",
        f"give '{name}' a mass, or leave it out and write what it does by the other coordinates",
        name,
    )


def _overflow(name: str) -> Description:
    return (
        f"'{name}' is not finite after it",
        "a trajectory goes to infinity there; if it should not, try a smaller h",
        name,
    )


def _outside(name: str) -> Description:
    return (
        f"'{name}' has left the grid",
        "end the run before, or begin further inside; walls= has ends that nothing flows through",
        name,
    )


def _reset(error: dict[str, Any], constraints: Sequence[str]) -> Description:
    event, t = error["event"], error["t"]
    if "index" not in error:
        return (
            f"the impact of event '{event}' at t = {t:.6g} finds nothing that gives way: the "
            "constraints hold the motion along its gradient",
            "look at whether what is hit can move, and for an event whose gradient vanishes there",
            event,
        )
    name = constraints[error["index"]]
    return (
        f"the reset of event '{event}' at t = {t:.6g} cannot be made consistent: "
        f"{error['quantity']} '{name}' stays at {error['value']:.1e}",
        "return states near to the constraints, onto which they are moved by the least change",
        name,
    )


def _no_derivative(error: dict[str, Any]) -> Description:
    event, t = error["event"], error["t"]
    if "limit" in error:
        return (
            f"the hits of '{event}' accumulate at t = {error['limit']:.6g}, and so near to it as "
            f"t = {t:.6g} their times have no derivative",
            "end the run before, at an earlier time or after a number of hits, terminal= of the "
            "event; from there on the motion stays on it, which another model describes",
            event,
        )
    if error["why"] == "jump":
        return (
            f"the function of event '{event}' jumps at t = {t:.6g}, so its time has no derivative",
            "write what passes through zero there, such as q[0] - 1 in place of sign(q[0] - 1)",
            event,
        )
    if error["why"] == "kink":
        return (
            f"the function of event '{event}' bends at t = {t:.6g}, where it is zero: its time has "
            "one derivative by what is before, and another by what is after",
            "write one that is smooth there, and two conditions as two events",
            event,
        )
    return (
        f"the function of event '{event}' has no slope along the motion at t = {t:.6g}, where "
        "its time has no derivative",
        "write one with a slope where it is crossed, such as t - 1 in place of (t - 1)**3; one "
        "that is only touched is met twice or never by motions nearby",
        event,
    )


def _redundant(names: Sequence[str]) -> Description:
    if len(names) == 1:
        return (
            f"the gradient of constraint {quoted(names)} vanishes",
            "write the constraint so that it does not where the constraint holds",
            names[0],
        )
    return (
        f"constraints {quoted(names)} are redundant there alone: their gradients are dependent",
        "stay away from the singular position, or remove one of them",
        names[0],
    )


def _contradiction(name: str) -> Description:
    return (
        f"constraint '{name}' no longer follows from the others, which implied it at the start",
        "the mechanism passes a position where its branches meet: take a smaller h, or begin "
        "another run shortly before",
        name,
    )


#: Corrections that do not fall below this may stall at roundoff, which a smaller step amplifies.
STALLED = 1e-6


#: Smaller corrections are roundoff themselves.
ROUNDOFF = 1e-13


def _not_converged(size: float) -> Description:
    if size < ROUNDOFF:
        return (
            "the iteration comes to no solution: corrections of the motion are roundoff, and the "
            "equations are not solved",
            "try a smaller h, and look for reactions that change little with their multipliers",
            "stages",
        )
    if size < STALLED:
        return (
            f"the iteration stalls at corrections of {size:.0e}, far above roundoff",
            f"the equations are nearly singular there, and a smaller h does not help: try "
            f"newton_tol={10 * size:.0e}, or another h",
            "stages",
        )
    last = f" (last correction {size:.0e})" if math.isfinite(size) else ""
    return f"the iteration did not converge{last}", "try a smaller h", "stages"


def _step_too_large(name: str, error: dict[str, Any]) -> Description:
    solved = error["solved"]
    size = "h" if solved > 0 else "|h|"
    return (
        f"the step is too large for coordinate '{name}': its equations have a solution connected "
        f"with the present state only up to h = {solved:.3g}",
        f"take {size} below {abs(solved):.2g}, and well below it where a stiff force turns; "
        "solutions of larger steps belong to another motion",
        name,
    )


def _step_too_small(error: dict[str, Any]) -> Description:
    if math.isfinite(error["error"]):
        fine = ""
        if "atol" in error:
            fine = (
                f": coordinates near zero are held to atol = rtol / 1000 = {error['atol']:.2g}, "
                "which is near the roundoff of others"
            )
        return (
            f"the error asks for a step of {error['h']:.1e}, less than h_min",
            "look for a force that jumps or grows without bound there; else a larger rtol, atol or "
            f"a smaller h_min may help{fine}",
            "step",
        )
    return (
        f"a step of {error['h']:.1e} would be needed, less than h_min",
        "look for a singularity there, where forces grow without bound or steps have no "
        "solution; else a smaller h_min may help",
        "step",
    )


def _singular_piece(piece: str) -> Description:
    return (
        f"the flow of a piece reaches infinity within the step: {piece}",
        "a trajectory may go to infinity there; if it should not, try a smaller h, or pieces "
        "without that danger: diagonal='shears', or 'regular' for degree 2",
        piece,
    )


def _singular_function(function: str, t: float) -> Description:
    return (
        f"{function} is not finite in the step from t = {t:.6g}",
        "look for a division by zero, a root, a logarithm, or the end of a table of several "
        "variables there; begin elsewhere, or take a "
        "smaller h",
        function,
    )


def _raised(error: BaseException) -> Description:
    return (
        f"a function of the model raised {type(error).__name__}: {error}",
        "its own traceback stands above",
        "model",
    )


def _monitor(error: dict[str, Any]) -> Description:
    value, rate = error["value"], error["rate"]
    what = (
        f"the monitor is {value:.6g}"
        if not value > 0 or value == math.inf
        else (f"the rate of the monitor is {rate:.6g}")
    )
    return (
        f"{what} at t = {error['t']:.6g}",
        "a monitor is the size of a step, up to a factor: positive and smooth",
        "monitor",
    )


def _not_finite(
    error: dict[str, Any], coordinates: Sequence[str], constraints: Sequence[str]
) -> Description:
    what, index = error["quantity"], error["index"]
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
    sentence = f"{name} is not finite at t = {error['t']:.6g}"
    hint = "look for a division by zero, a root or a logarithm of the model there"
    if what == "derivative":
        hint = (
            "a root is smooth as ca.sqrt(ca.dot(v, v) + e**2), with a small e, where "
            "ca.norm_2(v) has no derivative at v = 0; or " + hint
        )
    return sentence, hint, quantity
