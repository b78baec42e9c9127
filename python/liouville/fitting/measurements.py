"""Measurements of a motion: states at given times, some of them missing, with their deviations."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np

from liouville._arguments import interval, number
from liouville.errors import hinted
from liouville.systems import Mechanics, SemiExplicit

#: The quantities that are fitted.
System: TypeAlias = Mechanics | SemiExplicit

#: The square of a smaller number has no exact reciprocal.
LEAST = 1e-150

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


def _of_frame(frame: Any) -> dict[str, Any]:
    """Return the columns of a DataFrame by name; its index has the times where no column does."""
    found = {name: np.asarray(frame[name]) for name in frame.columns}
    index = getattr(frame, "index", None)
    if "t" not in found and getattr(index, "name", None) == "t":
        found["t"] = np.asarray(index)
    return found


def _are_whole(places: np.ndarray) -> bool:
    """Return whether numbers are whole but for roundoff."""
    return bool(np.abs(places - np.round(places)).max() <= EVEN * max(len(places), places.max()))


class Measurements:
    """States that were measured, and the steps of a run that meets their times.

    Attributes
    ----------
    t0 : float
        Time of the start.
    run : dict
        Interval, steps and kept times of a run that meets them, as arguments of ``integrate``.
    first_step : dict
        Interval and number of steps of its first step, likewise.
    first : int
        The record of the run that the first measurement is of.
    values : ndarray, shape (k, w)
        Both states side by side, NaN where nothing was measured.
    weights : ndarray, shape (k, w)
        Standard deviations times the unit, so that measurements in units of them are one at most;
        where none were given, the root mean square of all that was measured.
    unit : float
        How many deviations the largest measurement is, where they were given.
    is_there : ndarray of bool, shape (k, w)
        What was measured.
    is_absolute : bool
        Whether standard deviations were given.
    """

    def __init__(self, system: System, data: Any, h: float, sigma: Any, t0: float | None) -> None:
        if not isinstance(data, Mapping) and hasattr(data, "columns"):
            data = _of_frame(data)
        self._take_times(data, number("h must be a number", h), t0)
        self._take_data(system, data, sigma)

    def _take_times(self, data: Any, h: float, t0: Any) -> None:
        if not isinstance(data, Mapping) or "t" not in data:
            raise TypeError(hinted("data has no 't'", 'write data={"t": times, "q": values}'))
        times = _numbers("data 't'", data["t"])
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError(f"data 't' must be finite times in a row, not {times!r}")
        if not (np.diff(times) > 0).all():
            k = int(np.argmin(np.diff(times) > 0))
            sentence = f"data 't' rise: {times[k]:g} is followed by {times[k + 1]:g}"
            raise ValueError(hinted(sentence, "sort measurements by time, and join those of one"))
        if not h > 0:
            raise ValueError(f"h must be positive, not {h:g}")
        self.t0 = float(times[0]) if t0 is None else number("t0 must be a number", t0)
        if self.t0 > times[0]:
            raise ValueError(f"t0 = {self.t0:g} is after the first measurement")
        if self.t0 == times[-1]:
            sentence = f"the only measurement is at the start, t0 = {self.t0:g}"
            raise ValueError(hinted(sentence, "give t0=, the time of a start before it"))
        self._count = times.size
        span = interval((self.t0, float(times[-1])))
        self.run: dict[str, Any] = {"t": span}
        first = self.t0 if times.size == 1 else float(times[0])
        distance = (float(times[-1]) - first) / max(times.size - 1, 1)
        places = np.round((times - self.t0) / distance)
        if _are_whole((times - self.t0) / distance):
            self.first = int(places[0])
            every = max(1, int(np.ceil(distance / h * (1 - EVEN))))
            steps = every * int(places[-1])
            self.run |= {"every": every, "steps": steps}
        else:
            self.first = 0
            steps = max(1, int(np.ceil((span[1] - span[0]) / h * (1 - EVEN))))
            self.run |= {"steps": steps, "t_eval": times}
        step = (span[0], span[0] + (span[1] - span[0]) / steps)
        self.first_step: dict[str, Any] = {"t": step, "steps": 1}

    def _take_data(self, system: System, data: Mapping[str, Any], sigma: Any) -> None:
        names = [system.places[state] for state in system.states]
        ends = [*accumulate(map(len, names), initial=0)]
        parts = {x: slice(*ends[k : k + 2]) for k, x in enumerate(system.states)}
        # of mechanics coordinates alone: both states have their names
        own = names[:1] if names[0] == names[1] else names
        components = [name for each in own for name in each]
        self.values = np.full((self._count, ends[-1]), np.nan)
        self.weights = np.ones((self._count, ends[-1]))
        given = np.zeros(ends[-1], dtype=bool)
        self.is_absolute, self.unit = sigma is not None, 1.0
        for name in data:
            if name == "t":
                continue
            if name not in parts and name not in components:
                hint = f"there are {', '.join((*system.states, *components))}"
                raise ValueError(hinted(f"data has {name!r}, which is no state", hint))
            place: Any = parts[name] if name in parts else components.index(name)
            values = _numbers(f"data {name!r}", data[name])
            wanted = self.values[:, place].shape
            if values.shape == (self._count,) and wanted == (self._count, 1):
                values = values[:, None]
            if values.shape != wanted:
                sentence = f"data {name!r} has shape {values.shape}, wanted {wanted}"
                hint = f"one column alone is given by its name: data={{{components[0]!r}: ...}}"
                raise ValueError(hinted(sentence, hint) if values.ndim == 1 else sentence)
            if given[place].any():
                sentence = f"data {name!r} gives again what other data of the same state give"
                raise ValueError(hinted(sentence, "give the state, or its coordinates"))
            given[place] = True
            self.values[:, place] = values
            deviation = sigma.get(name) if isinstance(sigma, Mapping) else sigma
            if deviation is None and self.is_absolute:
                raise ValueError(f"sigma has no value for {name!r}")
            if deviation is None:
                continue
            weights = _numbers("sigma", deviation)
            if weights.shape == (self._count,) and wanted == (self._count, 1):
                weights = weights[:, None]
            if weights.shape not in ((), values.shape[1:], values.shape):
                sentence = f"sigma of {name!r} has shape {weights.shape}"
                raise ValueError(f"{sentence}, wanted a number or {values.shape}")
            self.weights[:, place] = weights
        for name in sigma if isinstance(sigma, Mapping) else ():
            if name not in data or name == "t":
                raise ValueError(f"sigma has {name!r}, of which there are no data")
        self.is_there = np.isfinite(self.values)
        if np.isinf(self.values).any():
            raise ValueError("data are finite numbers, and NaN where nothing was measured")
        if not self.is_there.any():
            raise ValueError("data have no measurement: nothing, or NaN alone, is with their times")
        if not self.is_absolute:
            largest = np.abs(self.values[self.is_there]).max() or 1.0
            mean = np.mean((self.values[self.is_there] / largest) ** 2)
            self.weights *= largest * np.sqrt(mean) or 1.0
        sizes = self.weights[self.is_there]
        if not (sizes > 0).all() or not np.isfinite(sizes).all():
            raise ValueError("sigma is positive and finite")
        if self.is_absolute:
            self.unit = self._deviations(sizes)
            self.weights *= self.unit

    def _deviations(self, sizes: np.ndarray) -> float:
        """Return how many deviations of these sizes the largest measurement is."""
        values = np.abs(self.values[self.is_there])
        with np.errstate(over="ignore", under="ignore"):
            found = values / sizes
        place = int(np.argmax(found))
        if LEAST < (most := float(found[place]) or 1.0) < 1 / LEAST:
            return most
        sentence = f"sigma is {sizes[place]:g} of a measurement of {values[place]:g}"
        sentence += ": the square of their ratio is no number"
        raise ValueError(hinted(sentence, "give the deviation in the unit of the data"))
