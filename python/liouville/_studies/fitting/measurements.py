"""Measurements of a motion: quantities at given times, some of them missing, with deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np

from liouville._basics.arguments import interval, number
from liouville._basics.errors import hinted, misshapen, quoted
from liouville._systems import Field, Mechanics, SemiExplicit

#: The systems that are fitted.
System: TypeAlias = Mechanics | SemiExplicit | Field

#: The square of a smaller number has no exact reciprocal.
LEAST = 1e-150

#: Times may be so far from equal distances, in units of these.
EVEN = 1e-9

#: A tolerance is compared with this part of it, and the tangents of a start are those of a step
#: that is one part in so many of the time.
FINER, FEW = 1e-2, 1000


def _numbers(what: str, value: Any) -> np.ndarray:
    """Return real numbers as an array of floats; None, NA and what is masked are NaN."""
    given = f"of type {value.dtype}" if hasattr(value, "dtype") else repr(value)
    try:
        array = np.ma.asanyarray(value) if np.ma.isMaskedArray(value) else np.asarray(value)
        if array.dtype.kind == "O":
            is_masked, array = np.ma.getmaskarray(array), np.array(array, dtype=object)
            array[is_masked] = None
            array = np.vectorize(_or_missing, otypes=[object])(array)
        texts = [x for x in array.ravel().tolist() if isinstance(x, str | bytes)]
        if texts:
            given = f"text such as {texts[0]!r}"
        elif array.dtype.kind in "iufO":
            return np.ma.filled(array.astype(float), np.nan)
    except (TypeError, ValueError):
        pass
    sentence = f"{what} must be real numbers, not {given}"
    if given.startswith("text"):
        sentence = hinted(sentence, "pandas.to_numeric makes numbers of a column of a table")
    if getattr(getattr(value, "dtype", None), "kind", None) in ("m", "M"):
        sentence = hinted(sentence, 'give seconds: (t - t[0]) / np.timedelta64(1, "s")')
    raise TypeError(sentence)


def _or_missing(x: Any) -> Any:
    """Return an entry of an array of objects, NaN where it is None or pandas' NA."""
    return np.nan if x is None or type(x).__name__ == "NAType" else x


def _by_name(data: Any) -> Any:
    """Return the columns of a DataFrame, or the variables of a Dataset, by name, times as "t".

    The times may be a column, the index, or a coordinate, that is called t or time.
    """
    if hasattr(data, "data_vars"):
        found = {str(name): np.asarray(values) for name, values in data.data_vars.items()}
        times = {str(name): np.asarray(values) for name, values in data.coords.items()}
    elif hasattr(data, "columns") and not isinstance(data, Mapping):
        found = {str(name): np.asarray(data[name]) for name in data.columns}
        index = getattr(data, "index", None)
        times = {str(getattr(index, "name", None)): np.asarray(index)}
        if "t" not in found and "time" in found:
            found["t"] = found.pop("time")
    else:
        return data
    for name in ("t", "time"):
        if "t" not in found and name in times:
            found["t"] = times[name]
    return found


def _are_whole(places: np.ndarray) -> bool:
    """Return whether numbers are whole but for roundoff."""
    return bool(np.abs(places - np.round(places)).max() <= EVEN * max(len(places), places.max()))


class Measurements:
    """Quantities that were measured, and the steps of a run that meets their times.

    A run `keeps_more` than its equal steps where it keeps states at changes of contacts.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Times of the measurements.
    t0 : float
        Time of the start.
    run : dict
        Interval, steps and kept times of a run that meets them, as arguments of ``integrate``.
    finer : dict
        The same with half the step, or a hundredth of the tolerance.
    first_step : dict
        Interval and number of steps of its first step, likewise.
    first : int
        The record of the run that the first measurement is of.
    values : ndarray, shape (k, w)
        All quantities side by side, NaN where nothing was measured.
    weights : ndarray, shape (k, w)
        Standard deviations, ones where none were given, in the unit that all trials share.
    is_there : ndarray of bool, shape (k, w)
        What was measured.
    """

    def __init__(
        self, places: Mapping[str, tuple[str, ...]], data: Any, sigma: Any, t0: float | None,
        steps: Mapping[str, float], *, keeps_more: bool = False,
    ) -> None:  # fmt: skip
        self._keeps_more = keeps_more
        data = _by_name(data)
        self._take_times(data, steps, t0)
        self._take_data(places, data, sigma)

    def _take_times(self, data: Any, given: Mapping[str, float], t0: Any) -> None:
        if not isinstance(data, Mapping) or "t" not in data:
            own = [*map(str, data)] if isinstance(data, Mapping) else []
            sentence = f"data has no 't', but {quoted(own)}" if own else "data has no 't'"
            raise TypeError(hinted(sentence, 'write data={"t": times, "q": values}'))
        times = _numbers("data 't'", data["t"])
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            if times.ndim == 1 and times.size:
                k = int(np.argmin(np.isfinite(times)))
                raise ValueError(f"data 't' must be finite, and its entry {k} is {times[k]}")
            raise ValueError(f"data 't' must be times in a row, not of shape {times.shape}")
        if not (np.diff(times) > 0).all():
            k = int(np.argmin(np.diff(times) > 0))
            sentence = f"data 't' must rise, and {times[k]:g} is followed by {times[k + 1]:g}"
            raise ValueError(hinted(sentence, "sort measurements by time, and join those of one"))
        self.t = times
        self.t0 = float(times[0]) if t0 is None else number("t0 must be a number", t0)
        if self.t0 > times[0]:
            raise ValueError(f"t0 = {self.t0:g} is after the first measurement")
        if self.t0 == times[-1]:
            sentence = f"the only measurement is at the start, t0 = {self.t0:g}"
            raise ValueError(hinted(sentence, "give t0=, the time of a start before it"))
        self.first = 0
        begin, end = interval((self.t0, float(times[-1])))
        self.run: dict[str, Any] = {"t": (begin, end), "t_eval": times}
        if "rtol" in given:
            self.run |= given
            self.finer = self.run | {"rtol": FINER * given["rtol"]}
            self._step_first(begin, end, 1 / FEW)
            return
        distance = (end - (self.t0 if times.size == 1 else float(times[0]))) / max(
            times.size - 1, 1
        )
        places = (times - self.t0) / distance
        if _are_whole(places) and not self._keeps_more:
            del self.run["t_eval"]
            self.first = round(float(places[0]))
            every = max(1, int(np.ceil(distance / given["h"] * (1 - EVEN))))
            steps = every * round(float(places[-1]))
            self.run |= {"every": every, "steps": steps}
            self.finer = self.run | {"every": 2 * every, "steps": 2 * steps}
        else:
            steps = max(1, int(np.ceil((end - begin) / given["h"] * (1 - EVEN))))
            self.run |= {"steps": steps}
            self.finer = self.run | {"steps": 2 * steps}
        self._step_first(begin, end, 1 / steps)

    def _step_first(self, begin: float, end: float, part: float) -> None:
        self.first_step: dict[str, Any] = {"t": (begin, begin + part * (end - begin)), "steps": 1}

    def _take_data(
        self, places: Mapping[str, tuple[str, ...]], data: Mapping[str, Any], sigma: Any
    ) -> None:
        ends, count = [*accumulate(map(len, places.values()), initial=0)], self.t.size
        parts: dict[str, Any] = {x: slice(*ends[k : k + 2]) for k, x in enumerate(places)}
        components: dict[str, int] = {}
        each = [(state, x) for state, own in places.items() for x in own]
        for k, (state, name) in enumerate(each):
            components.setdefault(name, k)  # of mechanics those of positions, which come first
            components[f"{state}[{name}]"] = k
        self.values = np.full((count, ends[-1]), np.nan)
        self.weights = np.ones((count, ends[-1]))
        given = np.zeros(ends[-1], dtype=bool)
        for name in data:
            if name == "t":
                continue
            if name not in parts and name not in components:
                states = [state for state, own in places.items() if own]
                known = dict.fromkeys((*states, *(x for x in components if "[" not in x)))
                hint = f"there are {', '.join(known)}: take these of your table"
                raise ValueError(hinted(f"data has {name!r}, which is no state", hint))
            values = _numbers(f"data {name!r}", data[name])
            is_column = name in components and (name not in parts or values.ndim == 1)
            place: Any = components[name] if is_column else parts[name]  # x of a field may be both
            wanted = self.values[:, place].shape
            if values.shape == (count,) and wanted == (count, 1):
                values = values[:, None]
            if values.shape != wanted:
                column = next(iter(components))
                hint = f"one column alone is given by its name: data={{{column!r}: ...}}"
                raise misshapen(
                    f"data {name!r}", values.shape, wanted, hint if values.ndim == 1 else ""
                )
            if given[place].any():
                sentence = f"data {name!r} gives again what other data of the same state give"
                raise ValueError(hinted(sentence, "give the state, or its coordinates"))
            given[place] = True
            self.values[:, place] = values
            if sigma is not None:
                self.weights[:, place] = _deviations_of(name, sigma, values.shape)
        for name in sigma if isinstance(sigma, Mapping) else ():
            if name not in data or name == "t":
                raise ValueError(f"sigma has {name!r}, of which there are no data")
        self._check()

    def _check(self) -> None:
        """Find what was measured, and refuse what is infinite, missing, or has no deviation."""
        self.is_there = np.isfinite(self.values)
        if np.isinf(self.values).any():
            raise ValueError("data must be finite, or NaN where nothing was measured, not infinite")
        if not self.is_there.any():
            raise ValueError("data have no measurement: nothing, or NaN alone, is with their times")
        sizes = self.weights[self.is_there]
        if not (sizes > 0).all() or not np.isfinite(sizes).all():
            bad = sizes[~((sizes > 0) & np.isfinite(sizes))][0]
            sentence = f"sigma must be positive and finite, not {bad:g}"
            raise ValueError(hinted(sentence, "NaN in the data is what was not measured"))


def _deviations_of(name: str, sigma: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return the standard deviations of data of a name and shape, as they are given."""
    given = sigma.get(name) if isinstance(sigma, Mapping) else sigma
    if given is None:
        raise ValueError(f"sigma has no value for {name!r}")
    found = _numbers("sigma", given)
    if found.shape == shape[:1] and shape[1:] == (1,):
        found = found[:, None]
    if found.shape not in ((), shape[1:], shape):
        raise misshapen(f"sigma of {name!r}", found.shape, f"{shape}, or be a number")
    return found


def shared_unit(trials: Sequence[Measurements], is_absolute: bool) -> float:
    """Give all trials weights in one unit, and return how many deviations it is.

    In units of their weights measurements are one at most, so that their squares are numbers. Where
    no deviations were given, the unit is the root mean square of all that was measured.
    """
    values = np.concatenate([np.abs(each.values[each.is_there]) for each in trials])
    sizes = np.concatenate([each.weights[each.is_there] for each in trials])
    if is_absolute:
        unit, times = _deviations(values, sizes), 1.0
    else:
        largest = values.max() or 1.0
        unit, times = 1.0, largest * np.sqrt(np.mean((values / largest) ** 2)) or 1.0
    for each in trials:
        each.weights *= unit * times
    return unit


def _deviations(values: np.ndarray, sizes: np.ndarray) -> float:
    """Return how many deviations of these sizes the largest measurement is."""
    with np.errstate(over="ignore", under="ignore"):
        found = values / sizes
    place = int(np.argmax(found))
    if LEAST < (most := float(found[place]) or 1.0) < 1 / LEAST:
        return most
    sentence = f"sigma is {sizes[place]:g} of a measurement of {values[place]:g}"
    sentence += ": the square of their ratio is no number"
    raise ValueError(hinted(sentence, "give the deviation in the unit of the data"))
