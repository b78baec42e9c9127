"""The way of each kind of system, with a method it takes, to a run of the core and back.

A route checks what was asked, starts the run, and knows what its records mean.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import MOST_STEPS, Steps, check_memory, count, steps_of
from liouville.errors import describe, hinted
from liouville.methods import (
    HHT,
    METHODS,
    ArnoldBruls,
    Composition,
    GeneralizedAlpha,
    Method,
    Spark,
    VolumeSplitting,
)
from liouville.planner import Plan, planned
from liouville.splitting import Affine, Split, crossed, described, variables_of
from liouville.systems import Mechanical, Mechanics, PolynomialField, System

#: Half of the digits of an affine flow are left after so many of its own times.
MOST_TURNS = 1e8

KEEP_LESS = "keep fewer with every=, or none with states=False"


@dataclass(frozen=True)
class Asked:
    """What a caller asks of a run, unchecked; see :func:`liouville.integrate`."""

    t: Any
    h: Any
    steps: Any
    control: Mapping[str, Any]
    every: Any
    observe: Mapping[str, Callable[..., Any]] | None
    params: Mapping[str, ArrayLike] | None
    states: Any
    start: Mapping[str, Any]
    is_ensemble: bool = False
    threads: Any = None


class Route(Protocol):
    """A system and a method on their way through the core.

    Attributes
    ----------
    system : System
        What is integrated.
    method : str
        The method, as its repr.
    constraints : tuple of str
        Names of the constraints, empty where there are none.
    params : mapping
        Parameters of the run.
    pace : Steps
        The steps it makes, of which one in `every` is kept.
    columns : dict of str to int
        What a record consists of, with widths.
    members : tuple of int
        ``(P,)`` for an ensemble of P members, else ``()``.
    """

    method: str
    constraints: tuple[str, ...]
    params: Mapping[str, Any]
    pace: Steps
    every: int
    columns: dict[str, int]
    members: tuple[int, ...]

    @property
    def system(self) -> System:
        """What is integrated."""

    @property
    def row(self) -> int:
        """Bytes of a record."""

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run."""

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Say where the energy went, where that is known."""

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""


def route(system: System, method: Method | Plan, asked: Asked) -> Route:
    """Find the route of a system by a method.

    Raises
    ------
    TypeError
        One of them is no such thing, or the method does not step such a system.
    """
    if not isinstance(system, Mechanics | PolynomialField):
        raise TypeError(
            "system is a Lagrangian, Hamiltonian, Mechanical, Structure or PolynomialField, not "
            f"{system!r}"
        )
    if not isinstance(asked.states, bool):
        raise TypeError(f"states is True or False, not {asked.states!r}")
    threads_of(asked.threads)
    if isinstance(system, PolynomialField):
        if isinstance(method, VolumeSplitting | Plan):
            return FieldRoute(system, method, asked)
        raise _no_route(method, "field", "polynomial fields")
    if asked.is_ensemble:
        raise TypeError(f"ensembles are of a PolynomialField so far, not of {system!r}")
    if isinstance(method, Spark | HHT | GeneralizedAlpha | ArnoldBruls | Composition):
        return MechanicalRoute(system, method, asked)
    raise _no_route(method, "mechanical", "mechanical systems")


def _no_route(method: Any, form: str, systems: str) -> TypeError:
    known = [cls.__name__ for cls in METHODS.values() if (cls.form == "field") == (form == "field")]
    known += ["Plan"] if form == "field" else ["Composition"]
    return TypeError(f"{method!r} does not step {systems}; methods that do: {', '.join(known)}")


def kept(pace: Steps, every: Any) -> int:
    """Return how many steps are made for each one that is kept."""
    return min(count("every", every), pace.count if pace.control is None else MOST_STEPS)


class MechanicalRoute:
    """A mechanical system on its way, see :class:`Route`."""

    members: tuple[int, ...] = ()

    def __init__(self, system: Mechanics, method: Method, asked: Asked) -> None:
        self._system = system
        self.method = repr(method)
        self.constraints = system.constraints
        self._method = method
        self._is_general = method.form == "general"
        equal = type(method).__name__ if self._is_general else ""
        self._base = method.base if isinstance(method, Composition) else method
        self.pace = steps_of(
            asked.t, asked.h, asked.steps, asked.control, system.coordinates, equal
        )
        self.every = kept(self.pace, asked.every)
        self._values = system.values(asked.params)
        self.params: Mapping[str, Any] = {**system.params, **dict(asked.params or {})}
        self._begin = system.start(asked.start, () if self._is_general else ("a",))
        goes_on = len(self._begin) == 3 and getattr(method, "reaction", "") == "position"
        # such a method leaves the hidden constraint by itself, and goes on from there
        y, z = self._begin[:2]
        system.check(self.pace.t0, y, z, self._values, hidden=not goes_on)
        self._states = asked.states
        self._observer, self._widths = system.observer(asked.observe, asked.states)
        self.columns = self._columns()
        self._check_sizes()

    @property
    def system(self) -> Mechanics:
        """What is integrated."""
        return self._system

    @property
    def row(self) -> int:
        """Bytes of a record."""
        return 8 * (1 + sum(self.columns.values()))

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""
        pace = self.pace
        problem = self.system.problem if self._is_general else self.system.second_order
        return _core.mechanical_run(
            problem, self._method, self._observer, self._values, self._begin,
            (pace.t0, pace.t1, pace.count, self.every), pace.control, self._states,
        )  # fmt: skip

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run that this method has."""
        found: dict[str, Any] = {"steps": run.done, **run.stats}
        foreign = ("factorizations", "rejected") if self._is_general else ("newton_steps",)
        stats = {name: value for name, value in found.items() if name not in foreign}
        if run.done and self._is_general:
            stats["solver"] = _solver(stats)
        return stats

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Say where the energy went, if the system tells forces with a potential from others."""
        if "work" not in parts or isinstance(self.system, Mechanical):
            return {}
        energy, work = (parts[name][:, 0] for name in ("invariant energy", "work"))
        return {"work": work, "dissipated": energy[:1] + work - energy}

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""
        if trouble.get("quantity") == "observable":
            trouble |= observable(trouble["index"], self._widths)
        sentence, hint, quantity = describe(trouble, self.system.coordinates, self.constraints)
        node_schur = getattr(self._base, "solver", "") == "node-schur"
        if trouble["kind"] == "not converged" and node_schur:
            hint += ", or solver='auto', which takes stiff forces too"
        return sentence, hint, quantity

    def _columns(self) -> dict[str, int]:
        system, states = self.system, self._states
        n, m = len(system.coordinates), len(self.constraints)
        own = dict(zip((*system.states, "lam"), (n, n, m), strict=True)) if states else {}
        if not self._is_general:
            own |= {"acceleration": n, "a": n} if states else {}
            own["work"] = 1
        return {**own, **self._widths}

    def _check_sizes(self) -> None:
        records = -(-self.pace.count // self.every) + 1
        check_memory(f"keeping {records} states", records * self.row, KEEP_LESS)
        method = self._base
        if isinstance(method, Spark):
            n, m, s = len(self.system.coordinates), len(self.constraints), method.stages
            dense = s * m * (n + s * m) if method.solver == "node-schur" else 2 * (s * (n + m)) ** 2
            hint = "HHT and its relatives take large sparse systems"
            check_memory(f"{method!r} on {n} coordinates, dense,", 8 * dense, hint)


def _solver(stats: Mapping[str, int]) -> str:
    if stats["newton_steps"] == 0:
        return "node-schur"
    return "newton" if stats["newton_steps"] >= stats["steps"] else "node-schur and newton"


def observable(index: int, widths: Mapping[str, int]) -> dict[str, Any]:
    """Say which part of a record an index falls into, and where in that part."""
    models = {"p": "momentum", "v": "velocity", "hidden": "hidden constraint"}
    for part, width in widths.items():
        if index < width:
            return {"quantity": models.get(part, part), "index": index}
        index -= width
    return {}


class FieldRoute:
    """A polynomial field on its way, or an ensemble of its states; see :class:`Route`."""

    constraints: tuple[str, ...] = ()

    def __init__(
        self, system: PolynomialField, method: VolumeSplitting | Plan, asked: Asked
    ) -> None:
        self._system = system = system.with_params(asked.params)
        self.params: Mapping[str, Any] = system.params
        _check_equal({**asked.control, **asked.start})
        self.pace = steps_of(
            asked.t, asked.h, asked.steps, asked.control, system.coordinates, "VolumeSplitting"
        )
        self.every = kept(self.pace, asked.every)
        x = system.start(asked.start, asked.is_ensemble)
        self.members: tuple[int, ...] = x.shape[:-1]
        self.threads = threads_of(asked.threads)
        self._states = asked.states
        self._observer, self._widths = system.observer(asked.observe, asked.states)
        self.columns: dict[str, int] = {"x": x.shape[-1]} if asked.states else {}
        self.columns |= self._widths
        records = -(-self.pace.count // self.every) + 1
        check_memory(f"keeping {records} states", records * self.row, KEEP_LESS)
        self.x = system.extended(np.atleast_2d(x), self.pace.t0)
        h = (self.pace.t1 - self.pace.t0) / self.pace.count
        if isinstance(method, Plan):
            self.plan, self.split = method, method.split(system.terms, system.variables)
        else:
            self.plan, self.split = planned(system.terms, method, h, self.x, names=system.variables)
        self.method = repr(self.plan.method)
        _check_affine(self.split, h)

    @property
    def system(self) -> PolynomialField:
        """What is integrated."""
        return self._system

    @property
    def row(self) -> int:
        """Bytes of a record."""
        return 8 * (1 + int(np.prod(self.members)) * sum(self.columns.values()))

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""
        pace, parts, method = self.pace, self.split, self.plan.method
        return _core.split_run(
            crossed(parts), method.composition, self._observer, self.system.values(None),
            parts.inward(self.x), (len(self.system.coordinates), parts.outward),
            (pace.t0, pace.t1, pace.count, self.every), (method.compensated, self._states),
            self.threads, bool(self.members),
        )  # fmt: skip

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run: steps, flows of pieces, and how many pieces there are."""
        pace, steps = self.pace, run.done
        if self.members:  # those that all members have made
            steps = round((run.t - pace.t0) / (pace.t1 - pace.t0) * pace.count)
        return {
            "steps": steps,
            "flows": run.stats["evaluations"],
            "pieces": len(self.split.pieces),
        }

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return nothing: a field has no energy of its own."""
        del parts
        return {}

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""
        if trouble.get("quantity") == "observable":
            trouble |= observable(trouble["index"], self._widths)
        names = self.system.variables
        if trouble["kind"] == "singular piece":
            piece = self.split.pieces[trouble["piece"]]
            trouble["quantity"] = described(piece, variables_of(self.split, names))
        outward = self.split.outward
        if trouble["kind"] == "overflow" and outward is not None:
            # the coordinate that has most of what is not finite
            trouble["index"] = int(np.abs(outward[:, trouble["index"]]).argmax())
        sentence, hint, quantity = describe(trouble, names, ())
        if self.members and "member" in trouble:
            sentence = f"member {trouble['member']}: {sentence}"
        return sentence, hint, quantity


def _check_equal(options: Mapping[str, Any]) -> None:
    """Refuse steps that would depend on the state."""
    given = [name for name in ("rtol", "atol", "h_min") if options.get(name) is not None]
    if given:
        hint = "give h or steps: with a step size that depends on the state, volume is not kept"
        raise TypeError(hinted(f"VolumeSplitting takes equal steps and no {given[0]}", hint))


def _check_affine(parts: Split, h: float) -> None:
    """Refuse a step after which the flow of an affine piece has no digits left."""
    for piece in parts.pieces:
        if isinstance(piece, Affine):
            length = float(np.abs(piece.matrix.astype(float)).sum(axis=1).max()) * abs(h)
            if length > MOST_TURNS:
                raise ValueError(
                    hinted(
                        f"a step of {h:g} is {length:.1e} times as long as the affine part of the "
                        "field takes to change: few digits of its flow would be left",
                        "give a smaller h",
                    )
                )


def threads_of(value: Any) -> int:
    """Return a number of threads, by default as many as there are processors."""
    if value is None:
        return os.cpu_count() or 1
    return int(count("threads", value))
