"""Runs of a mechanical system."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville import _core
from liouville._job import Job
from liouville.control import CONTROLS, LEAST_TOLERANCE, Reversible, Takes
from liouville.errors import Description, describe, hinted, quoted
from liouville.methods import Composition, LobattoPair, Method
from liouville.points import Points
from liouville.runners.energy import change_of_energy
from liouville.runners.runner import Request, Runner, kept
from liouville.runners.watch import Watch
from liouville.systems import Mechanical, Mechanics
from liouville.systems._redundant import redundant, sizes, without
from liouville.systems.traced import INVARIANT

#: A constraint left out may miss this much of the size of what it is made of.
IMPLIED = 1e-8

#: Errors of a step that has no solution, or none that is found.
UNSOLVED = ("not converged", "singular", "step too large")


class MechanicalRunner(Runner):
    """Runs a mechanical system; see :class:`Runner`."""

    system: Mechanics
    choice: Method
    _left_out: tuple[int, ...]

    def __init__(self, system: Mechanics, method: Method, request: Request) -> None:
        self.system, self.choice, self.method = system, method, repr(method)
        self.constraints = system.constraints
        self._stepped, self._left_out = system, ()
        self._is_general = method.form == "general"
        self._base = method.base if isinstance(method, Composition) else method
        self.steps = request.steps_of(system, self._takes())
        self._control = None if self.steps.control is None else self.steps.control[0]
        self._monitor = None
        if isinstance(request.control, Reversible) and request.control.monitor is not None:
            self._monitor = system.monitor(request.control.monitor)
        self._problem = self._form()
        self._is_rattle = isinstance(self._problem, _core.Separable)
        self.every = kept(self.steps, request.every)
        self._order = int(getattr(method, "order", 0))
        span = (self.steps.t0, self.steps.t1)
        self._watch = Watch(request.events, request.t_eval, span, self.every)
        self._watched = self._watch.crossed(system, self._order)
        self._take(request)
        self._leave_out()
        self.params = {**system.params, **dict(request.params or {})}
        self._states = request.states
        self._observer, self.widths = system.observer(request.observe, request.states)
        self.columns = self._columns()
        self._check_sizes(request)

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        return _core.run(self._problem, self.choice, self._job())

    def _leave_out(self) -> None:
        """Take the system without constraints that the others imply, if there are any."""
        y, z = (x.reshape(-1, x.shape[-1])[0] for x in self._begin[:2])
        point = self.steps.t0, y, z, self._values
        self._left_out = redundant(self.system, *point)
        if self._left_out:
            self._stepped = without(self.system, self._left_out)
            self._sizes = sizes(self.system, *point)[[*self._left_out]]
            self._problem = self._form()

    def _job(self) -> Job:
        """Return the run as the core begins it."""
        steps, control = self.steps, None
        if steps.control is not None:
            monitor = (self._monitor,) if self._control == "reversible" else ()
            control = (*steps.control[1:], *monitor)
        return Job(
            start=self._begin, span=(steps.t0, steps.t1, steps.count, self.every),
            observer=self._observer, params=self._values, states=self._states,
            control=control, watch=self._watched,
        )  # fmt: skip

    @property
    def dense_order(self) -> int:
        """The order of the method, where the states of all steps are kept, else 0."""
        is_whole = self.every == 1 and self._watch.times is None and self._states
        return self._order if is_whole else 0

    @property
    def initial(self) -> dict[str, float]:
        """The invariants at the start, where no record is kept of it."""
        times, t0 = self._watch.times, self.steps.t0
        if times is None or times[0] == t0:
            return {}
        args = [np.array([[t0]]), *(x[None] for x in self._begin[:2])]
        cuts = np.cumsum([*self.widths.values()])[:-1]
        parts = np.split(self._observer.map(self._values, args)[0], cuts)
        found = dict(zip(self.widths, parts, strict=True))
        return {name: float(found[INVARIANT + name][0]) for name in self.system.invariants}

    def events(self, run: _core.Run) -> tuple[dict[str, Points], str]:
        """Return the events met, by name, and a sentence on the one that ended the run."""
        return self._watch.events_of(run, self.system, self._values)

    def _take(self, request: Request) -> None:
        """Take parameters and start values, and see that they fit together."""
        self._values = self.system.values(request.params)
        self._begin = self.system.start(request.start, self._also)
        y, z = self._begin[:2]
        self.system.check(self.steps.t0, y, z, self._values, hidden=self._is_hidden_kept)

    def _takes(self) -> Takes:
        """Return the controls of the steps that the method takes."""
        name = type(self.choice).__name__
        if not self._is_general:
            return Takes(name, ("error",))
        estimates = not isinstance(self.choice, Composition)
        takes = {"error": estimates, "reversible": getattr(self.choice, "is_symmetric", True)}
        controls = tuple(kind for kind in CONTROLS if takes[kind])
        return Takes(name, controls, LEAST_TOLERANCE / 100)

    @property
    def _also(self) -> tuple[str, ...]:
        return () if self._is_general else ("a",)

    @property
    def _is_hidden_kept(self) -> bool:
        """Whether the start satisfies the hidden constraints.

        A method that goes on with its own accelerations may have left them by itself.
        """
        goes_on = len(self._begin) == 3 and getattr(self.choice, "reaction", "") == "position"
        return not goes_on

    def _form(self) -> _core.Mechanical | _core.SecondOrder | _core.Separable:
        """Return the system in the form that the method steps fastest."""
        if not self._is_general:
            return self._stepped.second_order
        self._check_solver()
        takes_fast_path = self._base == LobattoPair(2) and self._control != "error"
        fast = self._stepped.separable if takes_fast_path else None
        return self._stepped.problem if fast is None else fast

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

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return where the energy went, if forces with a potential are known from others."""
        if "work" not in parts or isinstance(self.system, Mechanical):
            return {}
        energy, work = (parts[name][..., 0] for name in ("invariant energy", "work"))
        start = self.initial.get("energy", energy[:1])
        return {"work": work, "dissipated": start + work - energy}

    def remark(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> str:
        """Say where the energy of a conservative system has changed by more than its own size."""
        if not self.system.is_conservative:
            return ""
        return change_of_energy(t, parts, rises=not self._is_general)

    def contradiction(self, rows: np.ndarray) -> tuple[int, dict[str, Any]] | None:
        """Return where constraints that were left out do not hold, with the first of them."""
        if not self._left_out or not rows.size:
            return None
        starts = dict(zip(self.columns, np.cumsum([0, *self.columns.values()]), strict=False))
        m = self.columns["constraint"]
        more = starts.get("nonholonomic", 0) - m
        places = [k + (starts["constraint"] if k < m else more) for k in self._left_out]
        missed = np.abs(rows[..., places]) / self._sizes
        bad = np.argwhere(missed > IMPLIED)
        if not bad.size:
            return None
        good, *_, which = bad[0].tolist()
        return good, {"kind": "contradiction", "index": self._left_out[which], "part": "constraint"}

    def look(self, error: dict[str, Any], t: np.ndarray, rows: np.ndarray) -> None:
        """Name the constraints that are nearly dependent where a step has failed."""
        if error["kind"] in UNSOLVED and self._states and rows.ndim == 2 and len(rows):
            y, params = rows[-2:, : len(self.system.coordinates)], self.system.values(self.params)
            # where the last step began, and where it went
            for at, point in ((t[-1], y[-1]), (2 * t[-1] - t[-2:][0], 2 * y[-1] - y[0])):
                if names := self._stepped.nearly_dependent(at, point, params):
                    error["dependent"] = names
                    break

    def _described(self, error: dict[str, Any]) -> Description:
        if error.get("quantity") == "event":
            error["quantity"] = f"event {[*self._watch.events][error['index']]}"
        recorded = error.get("part") is not None
        constraints = self.constraints if recorded else self._stepped.constraints
        sentence, hint, quantity = describe(error, self.system.coordinates, constraints)
        node_schur = getattr(self._base, "solver", "") == "node-schur"
        if error["kind"] == "not converged" and node_schur:
            hint += ", or solver='auto', which takes stiff forces too"
        return sentence, hint, quantity

    def _columns(self) -> dict[str, int]:
        system, states = self.system, self._states
        n, m = len(system.coordinates), len(self.constraints)
        own = dict(zip((*system.states, "lam"), (n, n, m), strict=True)) if states else {}
        if not self._is_general:
            own |= {"acceleration": n, "a": n} if states else {}
            own["work"] = 1
        return {**own, **self.widths}

    def _check_solver(self) -> None:
        if self.system.nonholonomic and getattr(self._base, "solver", "") == "node-schur":
            raise ValueError(
                hinted(
                    "node Schur finds multipliers of holonomic constraints, and the system has "
                    f"nonholonomic ones: {quoted(self.system.nonholonomic)}",
                    "take solver='auto', which solves for everything together",
                )
            )

    def _check_sizes(self, request: Request) -> None:
        times = self._watch.times
        self._check_records(
            request, self.steps.records(self.every) if times is None else times.size
        )


def _solver(stats: Mapping[str, int]) -> str:
    if stats["newton_steps"] == 0:
        return "node-schur"
    return "newton" if stats["newton_steps"] >= stats["steps"] else "node-schur and newton"
