"""Measurements of a motion: states at equal times, some of them missing, with their deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville._arguments import interval, number
from liouville.analysis.point import Array
from liouville.errors import hinted
from liouville.systems import Mechanics

#: Times may be so far from equal distances, in units of these.
EVEN = 1e-9


def _numbers(what: str, value: Any) -> np.ndarray:
    """Return real numbers as an array of floats; None and what is masked are NaN."""
    try:
        array = np.ma.asanyarray(value) if np.ma.isMaskedArray(value) else np.asarray(value)
        if array.dtype.kind in "iufO":
            return np.ma.filled(array.astype(float), np.nan)
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{what} is made of real numbers")


class Measurements:
    """States that were measured, and the steps of a run that meets their times.

    Attributes
    ----------
    t0 : float
        Time of the start.
    span : tuple of two floats
        From there to the last measurement.
    steps, every : int
        Steps of the run, and from one time to the next.
    first : int
        The record of the run that the first measurement is of.
    values : ndarray, shape (k, 2 n)
        Both states side by side, NaN where nothing was measured.
    weights : ndarray, shape (k, 2 n)
        Standard deviations; 1 where none were given.
    is_there : ndarray of bool, shape (k, 2 n)
        What was measured.
    is_absolute : bool
        Whether standard deviations were given.
    """

    def __init__(
        self, system: Mechanics, data: Any, h: float, sigma: Any, t0: float | None
    ) -> None:
        self._take_times(data, number("h is a number", h), t0)
        self._take_data(system, data, sigma)

    def _take_times(self, data: Any, h: float, t0: Any) -> None:
        if not isinstance(data, Mapping) or "t" not in data:
            raise TypeError(hinted("data has no 't'", 'write data={"t": times, "q": values}'))
        times = _numbers("data 't'", data["t"])
        if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all():
            raise ValueError(f"data 't' are two times or more in a row, not {times!r}")
        distance = (times[-1] - times[0]) / (times.size - 1)
        self.t0 = float(times[0]) if t0 is None else number("t0 is a number", t0)
        before = (times[0] - self.t0) / distance if distance else np.nan
        places = (times - self.t0) / distance if distance else np.full(times.size, np.nan)
        if not distance > 0 or np.abs(places - np.round(places)).max() > EVEN * times.size:
            sentence = "data 't' rise by equal distances, from t0 on"
            raise ValueError(hinted(sentence, "fill times between with rows of NaN"))
        if not h > 0:
            raise ValueError(f"h is positive, not {h:g}")
        self.first = round(float(before))
        if self.first < 0:
            raise ValueError(f"t0 = {self.t0:g} is after the first measurement")
        self.every = max(1, int(np.ceil(distance / h * (1 - EVEN))))
        self.steps = self.every * (self.first + times.size - 1)
        self.span = interval((self.t0, float(times[-1])))
        self._count = times.size

    def _take_data(self, system: Mechanics, data: Mapping[str, Any], sigma: Any) -> None:
        n = len(system.coordinates)
        self.values = np.full((self._count, 2 * n), np.nan)
        self.weights = np.ones((self._count, 2 * n))
        self.is_absolute = sigma is not None
        for name in data:
            if name == "t":
                continue
            if name in system.states:
                first = n * system.states.index(name)
                place: Any = slice(first, first + n)
            elif name in system.coordinates:
                place = system.coordinates.index(name)
            else:
                hint = f"there are {', '.join((*system.states, *system.coordinates))}"
                raise ValueError(hinted(f"data has {name!r}, which is no state", hint))
            values = _numbers(f"data {name!r}", data[name])
            if values.shape != self.values[:, place].shape:
                wanted = self.values[:, place].shape
                raise ValueError(f"data {name!r} has shape {values.shape}, wanted {wanted}")
            self.values[:, place] = values
            own = sigma.get(name) if isinstance(sigma, Mapping) else sigma
            if own is None and self.is_absolute:
                raise ValueError(f"sigma has no value for {name!r}")
            if own is None:
                continue
            weights = _numbers("sigma", own)
            if weights.shape not in ((), values.shape[1:], values.shape):
                sentence = f"sigma of {name!r} has shape {weights.shape}"
                raise ValueError(f"{sentence}, wanted a number or {values.shape}")
            self.weights[:, place] = weights
        self.is_there = np.isfinite(self.values)
        if np.isinf(self.values).any() or not self.is_there.any():
            raise ValueError("data are finite numbers, and NaN where nothing was measured")
        sizes = self.weights[self.is_there]
        if not (sizes > 0).all() or not np.isfinite(sizes).all():
            raise ValueError("sigma is positive and finite")

    def of(self, states: Mapping[str, Array]) -> Array:
        """Return both states of a run side by side, at the times of the measurements."""
        return np.concatenate([*states.values()], axis=-1)[self.first :]
