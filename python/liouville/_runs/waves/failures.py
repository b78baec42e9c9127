"""Failures of steps of wave functions, in the user's words."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville._basics.faults import Description, describe
from liouville._systems import Schrodinger

#: So many times within a step that failed are looked at.
LOOKS = 65


def described(
    error: dict[str, Any], system: Schrodinger, bounds: tuple[float, float], h: float
) -> Description:
    """Describe an error of a step of size h: sentence, hint and quantity.

    `bounds` are those of the energies that the run relies on.
    """
    if error["kind"] == "unresolved":
        return (
            f"the grid no longer resolves psi: {error['share']:.1e} of |psi|^2 is in the upper "
            "third of the wave numbers",
            "psi collapses, or has structures finer than the grid, or steps are in resonance with "
            "waves of it: take more points, or a smaller h",
            "psi",
        )
    size = error.get("norm", error.get("theta", 0.0))
    is_finite = error["kind"] not in ("norm", "spectrum") or np.isfinite(size)
    if not is_finite and (found := _singular(error, system, h)):
        return found
    if not is_finite and error["kind"] == "norm" and system.nonlinearity is not None:
        return (
            "the nonlinearity is not finite at a density that psi has there",
            "look for a division by zero, a root or a logarithm in it",
            "nonlinearity",
        )
    if not is_finite and error["kind"] == "norm" and system.is_driven:
        return (
            f"the norm is {size:g} where it was {error['norm_at_start']:.6g}: H(t) may have "
            "values beyond its bounds",
            "look for a jump, or a division by zero, in a function of time",
            "norm",
        )
    if error["kind"] == "norm" and system.absorber is not None:
        return (
            f"the norm is {size:.6g}, beyond {error['norm_at_start']:.6g} at the start",
            "flows back in time make psi grow in the absorber: give a smaller h, or take S2",
            "norm",
        )
    if error["kind"] == "norm":
        norm, before = _told_apart(error["norm"], error["norm_at_start"])
        low, high = _told_apart(*bounds)
        return (
            f"the norm is {norm} where it was {before}",
            f"H may have eigenvalues outside the bounds [{low}, {high}] of H/hbar, or its "
            "products are not those of a symmetric matrix: give bounds='gershgorin', or wider "
            "ones",
            "norm",
        )
    if error["kind"] == "step too small":
        return (
            f"the tolerance asks for one step of about {error['h']:.1e} after another",
            "look for a pole, or for oscillations without end, in a function of time or in V, or "
            "give a larger tol",
            "step",
        )
    if error["kind"] == "spectrum" and not np.isfinite(error["theta"]):
        hint = "look for a jump, or a division by zero, in a function of time"
        return ("H(t) is not finite or not smooth there", hint, "spectrum")
    if error["kind"] == "spectrum":
        return (
            f"the spectrum of H(t) is too wide there: a step spans {error['theta']:.4g}, and "
            f"the method takes {error['most']:.4g}",
            "give a smaller h",
            "spectrum",
        )
    return describe(error, (), ())


def _singular(error: dict[str, Any], system: Schrodinger, h: float) -> Description | None:
    """Return which function of time is not finite within the step that failed, and where."""
    if not system.is_driven or "start" not in error:
        return None
    for t in error["start"] + h * np.linspace(0.0, 1.0, LOOKS):
        try:
            system.check_time(float(t))
        except ValueError as found:
            sentence, _, hint = str(found).partition("\nhint: ")
            return sentence, hint, sentence.split(" is ")[0]
    return None


def _told_apart(a: float, b: float) -> tuple[str, str]:
    """Return two numbers with six digits, or as many as show that they differ."""
    for digits in range(6, 18):
        texts = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if texts[0] != texts[1] or a == b:
            break
    return texts
