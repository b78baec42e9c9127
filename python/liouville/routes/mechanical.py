"""The way of a mechanical system."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville import _core
from liouville._arguments import CONTROLS, LEAST_TOLERANCE, Takes, check_memory, steps_of
from liouville.errors import describe, hinted, quoted
from liouville.methods import Composition, LobattoPair, Method, Spark
from liouville.points import Points
from liouville.routes.route import Asked, check_records, kept, observable
from liouville.routes.watching import Watching
from liouville.systems import Mechanical, Mechanics


class MechanicalRoute:
    """A mechanical system on its way, see :class:`Route`."""

    members: tuple[int, ...] = ()

    def __init__(self, system: Mechanics, method: Method, asked: Asked) -> None:
        self._system = system
        self.method = repr(method)
        self.constraints = system.constraints
        self._method = method
        self._is_general = method.form == "general"
        self._base = method.base if isinstance(method, Composition) else method
        self.pace = steps_of(
            asked.t, asked.h, asked.steps, asked.control, system.coordinates, _takes(method)
        )
        monitor = asked.control.get("monitor")
        self._monitor = None if monitor is None else system.monitor(monitor)
        self._control = None if self.pace.control is None else self.pace.control[0]
        self._problem = self._form()
        self._is_rattle = isinstance(self._problem, _core.Separable)
        self.every = kept(self.pace, asked.every)
        self._order = int(getattr(method, "order", 0))
        span = (self.pace.t0, self.pace.t1)
        self._watching = Watching(asked.events, asked.t_eval, span, self.every)
        self._watch = self._watching.asked(system, self._order)
        self._take(asked)
        self.params: Mapping[str, Any] = {**system.params, **dict(asked.params or {})}
        self._states = asked.states
        self._observer, self._widths = system.observer(asked.observe, asked.states)
        self.columns = self._columns()
        self._check_sizes(asked)

    @property
    def system(self) -> Mechanics:
        """What is integrated."""
        return self._system

    @property
    def choice(self) -> Method:
        """The method."""
        return self._method

    @property
    def row(self) -> int:
        """Bytes of a record."""
        return 8 * (1 + sum(self.columns.values()))

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""
        pace = self.pace
        control = pace.control
        if control is not None and self._control == "reversible":
            control = (*control, self._monitor)
        return _core.mechanical_run(
            self._problem, self._method, self._observer, self._values, self._begin,
            (pace.t0, pace.t1, pace.count, self.every), control, self._watch, self._states,
        )  # fmt: skip

    @property
    def dense_order(self) -> int:
        """The order of the method, where the states of all steps are kept, else 0."""
        is_whole = self.every == 1 and self._watching.times is None and self._states
        return self._order if is_whole else 0

    def seen(self, run: _core.Run) -> tuple[dict[str, Points], str]:
        """Return the events met, by name, and a sentence on the one that ended the run."""
        return self._watching.seen(run, self.system, self._values)

    def _take(self, asked: Asked) -> None:
        """Take parameters and start values, and see that they fit together."""
        self._values = self.system.values(asked.params)
        self._begin = self.system.start(asked.start, self._also)
        y, z = self._begin[:2]
        self.system.check(self.pace.t0, y, z, self._values, hidden=self._is_hidden_kept)

    @property
    def _also(self) -> tuple[str, ...]:
        return () if self._is_general else ("a",)

    @property
    def _is_hidden_kept(self) -> bool:
        """Whether the start satisfies the hidden constraints.

        A method that goes on with its own accelerations may have left them by itself.
        """
        goes_on = len(self._begin) == 3 and getattr(self._method, "reaction", "") == "position"
        return not goes_on

    def _form(self) -> _core.Mechanical | _core.SecondOrder | _core.Separable:
        """Return the system in the form that the method steps fastest."""
        if not self._is_general:
            return self.system.second_order
        self._check_solver()
        takes_fast_path = self._base == LobattoPair(2) and self._control != "error"
        fast = self.system.separable if takes_fast_path else None
        return self.system.problem if fast is None else fast

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run that this method has."""
        found: dict[str, Any] = {"steps": run.done, **run.stats}
        foreign = {"factorizations", "rejected", "newton_steps"}
        if self._is_rattle or not self._is_general:
            foreign.discard("factorizations")
        if not self._is_general or self._control == "error":
            foreign.discard("rejected")
        if self._is_general and not self._is_rattle:
            foreign.discard("newton_steps")
        if not run.done:
            foreign |= {"h_smallest", "h_largest"}
        stats = {name: value for name, value in found.items() if name not in foreign}
        if run.done and self._is_general:
            stats["solver"] = "rattle" if self._is_rattle else _solver(stats)
        return stats

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the columns of all records as they are."""
        return parts

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Say where the energy went, if the system tells forces with a potential from others."""
        if "work" not in parts or isinstance(self.system, Mechanical):
            return {}
        energy, work = (parts[name][..., 0] for name in ("invariant energy", "work"))
        return {"work": work, "dissipated": energy[:1] + work - energy}

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""
        if trouble.get("quantity") == "observable":
            trouble |= observable(trouble["index"], self._widths)
        if trouble.get("quantity") == "event":
            trouble["quantity"] = f"event {[*self._watching.events][trouble['index']]}"
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

    def _check_solver(self) -> None:
        if self.system.nonholonomic and getattr(self._base, "solver", "") == "node-schur":
            raise ValueError(
                hinted(
                    "node Schur finds multipliers of holonomic constraints, and the system has "
                    f"nonholonomic ones: {quoted(self.system.nonholonomic)}",
                    "take solver='auto', which solves for everything together",
                )
            )

    def _check_sizes(self, asked: Asked) -> None:
        times = self._watching.times
        records = -(-self.pace.count // self.every) + 1 if times is None else times.size
        check_records(asked, records, self.row)
        method = self._base
        # stages, multipliers and the end of a step in one dense matrix
        if isinstance(method, Spark | LobattoPair) and self.system.nonholonomic:
            n, s = len(self.system.coordinates), method.stages
            multipliers = (method.intervals + s) * len(self.constraints)
            hint = "HHT and its relatives take large sparse systems"
            what = f"{method!r} on {n} coordinates with nonholonomic constraints, dense,"
            check_memory(what, 16 * (s * n + n + multipliers) ** 2, hint)


def _takes(method: Method) -> Takes:
    """Say which controls of the steps a method takes."""
    name = type(method).__name__
    if method.form != "general":
        return Takes(name, ("error",))
    estimates = not isinstance(method, Composition)
    takes = {"error": estimates, "reversible": getattr(method, "is_symmetric", True)}
    controls = tuple(kind for kind in CONTROLS if takes[kind])
    return Takes(name, controls, LEAST_TOLERANCE / 100)


def _solver(stats: Mapping[str, int]) -> str:
    if stats["newton_steps"] == 0:
        return "node-schur"
    return "newton" if stats["newton_steps"] >= stats["steps"] else "node-schur and newton"
