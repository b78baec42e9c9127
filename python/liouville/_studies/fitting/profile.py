"""Intervals of parameters by profile likelihood: all others are fitted again at each value."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.arguments import number
from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._basics.scipy import scipy

if TYPE_CHECKING:
    from liouville._studies.fitting.result import Fit

#: Widths of an interval, in standard deviations, beyond which a parameter is open on a side.
WIDEST = 64.0

#: An end is found to this part of the standard deviation.
CLOSE = 1e-3


@dataclass(frozen=True)
class Held:
    """A fit with a parameter held: its sum of squares, and where it was found.

    Attributes
    ----------
    chi2 : float
        The sum of squares, in units of the deviations.
    params : dict
        The parameters.
    starts : list of dict
        The start of each trial.
    """

    chi2: float
    params: dict[str, Any]
    starts: list[dict[str, Any]]


@dataclass(frozen=True)
class Profile:
    """How a fit is made again with a parameter held.

    Attributes
    ----------
    hold : callable
        A fit from parameters and starts, with a parameter of a name held at a value.
    bounds : dict of str to tuple of two floats
        Least and largest values by the names of what was fitted.
    """

    hold: Callable[[Mapping[str, Any], Sequence[Any], str, float], Held]
    bounds: Mapping[str, tuple[float, float]]


def interval(found: Fit, profile: Profile, name: str, level: float) -> tuple[float, float]:
    """Return the values at which the sum of squares rises by what the level allows.

    Raises
    ------
    ValueError
        The parameter is none that was fitted, or the level is not between 0 and 1.
    """
    known = [x for x in found.names if x.startswith("params.") and "[" not in x]
    if name not in known:
        hint = f"there are {quoted(known)}" if known else "there is none"
        if name in found.names and name.startswith("params."):
            sentence = f"{name!r} is in an array, and intervals are of parameters that are numbers"
            raise ValueError(hinted(sentence, "declare it as a parameter of its own"))
        raise ValueError(hinted(f"{name!r} is no number that was fitted as a parameter", hint))
    if not 0 < number("level must be a number", level) < 1:
        raise ValueError(f"level must be between 0 and 1, not {level!r}")
    quantile = scipy("stats", "an interval of a fit")
    if found.sigma is None:
        most = float(quantile.chi2.ppf(level, 1))
    elif not found.chi2:
        raise ValueError(hinted("the fit is exact: it has no interval", "give sigma="))
    else:
        most = float(quantile.f.ppf(level, 1, found.dof))
    key, best = name.removeprefix("params."), found.chi2
    value, error = found.params[key], found.errors[name]
    scale = 1.0 if found.sigma is None else found.dof / found.chi2
    ends = []
    for side, bound in zip((-1.0, 1.0), profile.bounds[name], strict=True):
        near = Held(best, found.params, [trial.start for trial in found.trials])

        def above(widths: float, side: float = side) -> float:
            nonlocal near
            near = profile.hold(near.params, near.starts, key, value + side * widths * error)
            return (near.chi2 - best) * scale - most

        width = _root(above, np.sqrt(most), abs(bound - value) / error)
        ends.append(bound if abs(bound - value) <= width * error else value + side * width * error)
    return ends[0], ends[1]


def _root(above: Callable[[float], float], first: float, last: float) -> float:
    """Return the width at which a rising function is zero, infinity where it is not by `last`."""
    low, high = 0.0, min(float(first), last)
    try:
        while above(high) < 0:
            low, high = high, min(2 * high, last)
            if low == high or high > WIDEST * first:
                return np.inf
    except IntegrationError:
        return np.inf  # no motion is there
    found = scipy("optimize", "an interval of a fit").brentq(above, low, high, xtol=CLOSE)
    return float(found)
