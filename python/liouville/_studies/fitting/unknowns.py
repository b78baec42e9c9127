"""Unknowns of a fit: parameters with their bounds, and states of the start."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from liouville._basics.errors import hinted, quoted
from liouville._studies.fitting.freedoms import movable
from liouville._studies.fitting.measurements import System
from liouville._systems.tracing import trace as _trace
from liouville.analysis.point import Array


@dataclass(frozen=True)
class Unknowns:
    """Parameters and states that are fitted.

    Attributes
    ----------
    params : dict
        All parameters, those that are fitted with the values to begin with.
    fitted, free : tuple of str
        The names of the parameters that are fitted, and of the states of the start.
    bounds : ndarray, shape (K, 2)
        Least and largest values of the elements of these parameters.
    priors : tuple of (int, float, float)
        The place of an element, its value that is known besides, and the deviation of that.
    """

    params: dict[str, Any]
    fitted: tuple[str, ...]
    free: tuple[str, ...]
    bounds: Array
    priors: tuple[tuple[int, float, float], ...] = ()

    @classmethod
    def of(
        cls, system: System, params: Any, free: Any, bounds: Any, priors: Any = None
    ) -> Unknowns:
        """Read what is given; TypeError or ValueError where it is not of the system."""
        given: dict[str, Any] = dict(params) if isinstance(params, Mapping) else {}
        if not isinstance(params, Iterable):
            hint = "give names, values to begin with by name, or free= alone"
            raise TypeError(hinted(f"params must be a sequence of names, not {params!r}", hint))
        names = [params] if isinstance(params, str) else list(params)
        system.values(given)  # refuses names and shapes
        values: dict[str, Any] = dict(system.params)
        for name in names:
            if name not in values:
                hint = f"there are {quoted(list(values))}" if values else "it has none"
                raise ValueError(hinted(f"the system has no parameter {name!r}", hint))
            if names.count(name) > 1:
                raise ValueError(f"params names {name!r} twice")
        values |= given
        if not isinstance(free, Sequence):
            hint = f"write free={movable(system)!r}"
            raise TypeError(hinted(f"free must be a sequence of states, not {free!r}", hint))
        states = (free,) if isinstance(free, str) else tuple(free)
        for name in states:
            if name not in movable(system):
                raise ValueError(f"free must be {' or '.join(movable(system))}, not {name!r}")
        limits = _trace.mapping("bounds", bounds)
        for name in limits:
            if name not in names:
                raise ValueError(f"bounds has {name!r}, which is not fitted")
        if not names and not states:
            raise ValueError("nothing is to be fitted: give params= or free=")
        sides = [_bounded(name, values[name], limits.get(name, (None, None))) for name in names]
        found = cls(values, tuple(names), states, np.concatenate([np.empty((0, 2)), *sides]))
        return replace(found, priors=tuple(found._priors(_trace.mapping("priors", priors))))

    def _priors(self, given: Mapping[str, Any]) -> Iterator[tuple[int, float, float]]:
        for name, pair in given.items():
            if name not in self.fitted:
                raise ValueError(f"priors has {name!r}, which is not fitted")
            shape = np.shape(self.params[name])
            try:
                mean, deviation = (np.broadcast_to(np.asarray(x, float), shape) for x in pair)
            except (TypeError, ValueError):
                sentence = f"the prior of '{name}' must be a value and its deviation, not {pair!r}"
                raise ValueError(
                    hinted(sentence, f'write priors={{"{name}": (1.0, 0.1)}}')
                ) from None
            if not (np.isfinite(mean).all() and (deviation > 0).all()):
                sentence = f"the prior of '{name}' must have a positive deviation, not {deviation}"
                raise ValueError(sentence)
            first = sum(np.size(self.params[x]) for x in self.fitted[: self.fitted.index(name)])
            for k in range(np.size(self.params[name])):
                yield first + k, float(np.ravel(mean)[k]), float(np.ravel(deviation)[k])

    def without(self, name: str, value: float) -> Unknowns:
        """Return the same with a number held at a value, and no longer fitted."""
        place = self.names.index(f"params.{name}")
        moved = [(k - (k > place), x, size) for k, x, size in self.priors if k != place]
        return replace(
            self, params={**self.params, name: value}, bounds=np.delete(self.bounds, place, axis=0),
            fitted=tuple(x for x in self.fitted if x != name), priors=tuple(moved),
        )  # fmt: skip

    def known(self, name: str, value: float) -> float:
        """Return the square that a prior of a number adds at a value, in its deviations."""
        place = self.names.index(f"params.{name}")
        return sum(((value - x) / size) ** 2 for k, x, size in self.priors if k == place)

    def off(self, theta: Array) -> Array:
        """Return values less those of the priors, in units of their deviations."""
        return np.array([(theta[k] - mean) / deviation for k, mean, deviation in self.priors])

    @property
    def slopes_of_priors(self) -> Array:
        """The derivatives of that, shape (P, K)."""
        found = np.zeros((len(self.priors), len(self.bounds)))
        for row, (k, _, deviation) in enumerate(self.priors):
            found[row, k] = 1 / deviation
        return found

    @property
    def names(self) -> list[str]:
        """The names of all elements of the parameters that are fitted."""
        return [
            f"params.{name}" + f"[{k}]" * np.ndim(self.params[name])
            for name in self.fitted
            for k in range(np.size(self.params[name]))
        ]

    def theta(self, params: Mapping[str, Any]) -> Array:
        """Return the values of those that are fitted, one after another."""
        values = [np.ravel(params[name]) for name in self.fitted]
        found: Array = np.concatenate([np.empty(0), *values]).astype(float)
        return found

    def directions(self, width: int, count: int) -> Array:
        """Return the change of all parameters, `width` of them, in each of `count` directions.

        The first directions are the elements that are fitted; others leave parameters as they are.
        """
        found = np.zeros((count, width))
        places, first = [], 0
        for name, value in self.params.items():
            own = range(first, first + np.size(value))
            first = own.stop
            places += [(name, place) for place in own]
        chosen = [place for name in self.fitted for own, place in places if own == name]
        found[np.arange(len(chosen)), chosen] = 1.0
        return found

    def taken(self, params: Mapping[str, Any], theta: Array) -> dict[str, Any]:
        """Return all parameters, with these values of those that are fitted."""
        sizes = [np.size(self.params[name]) for name in self.fitted]
        parts = np.split(theta, np.cumsum(sizes)[:-1])
        new = {
            name: float(part[0]) if np.ndim(self.params[name]) == 0 else part
            for name, part in zip(self.fitted, parts, strict=False)
        }
        return {**params, **new}


def _bounded(name: str, given: Any, limits: Any) -> Array:
    """Return the bounds of a parameter's elements, which its value is within."""
    value = np.asarray(given)
    low, high = _trace.pair(f"'{name}'", limits, value.shape)
    if not (low < high).all():
        raise ValueError(f"the bounds of '{name}' leave nothing: {limits!r}")
    if not ((low <= value) & (value <= high)).all():
        sentence = f"'{name}' begins at {value}, which is not between {low} and {high}"
        raise ValueError(hinted(sentence, "give params= as a mapping with first values"))
    found: Array = np.stack([low, high], axis=-1).reshape(-1, 2)
    return found
