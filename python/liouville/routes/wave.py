"""The way of a Schrödinger equation, of one wave function or an ensemble of them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from liouville import _core
from liouville._arguments import Steps, steps_of, times_of
from liouville.errors import describe, hinted
from liouville.methods import Magnus, Stepped, WaveMethod
from liouville.points import Points
from liouville.propagation import Propagation, method_of, planned, stepped
from liouville.routes.route import Asked, check_records, kept, observable, threads_of
from liouville.systems import Schrodinger


class WaveRoute:
    """A Schrödinger equation on its way, see :class:`Route`."""

    constraints: tuple[str, ...] = ()

    def __init__(self, system: Schrodinger, method: WaveMethod | Propagation, asked: Asked) -> None:
        self._system = system = system.with_params(asked.params)
        self.params: Mapping[str, Any] = system.params
        times = times_of(asked.t)
        self.psi = system.inward(_start(asked.start), asked.is_ensemble)
        self.members: tuple[int, ...] = self.psi.shape[:-1]
        self.threads = threads_of(asked.threads)
        self._states = asked.states
        self._method = method
        self.plan = self._planned(method, times, asked)
        self.method = self.plan.method
        self.pace = Steps(self.plan.t0, self.plan.stops[-1][0], self.plan.steps)
        self.every = -(-self.plan.steps // len(self.plan.stops))
        self._observed = system.observables(asked.observe)
        self.columns = {"psi": 2 * system.size} if asked.states else {}
        energy = "observed energy" if system.is_driven else "invariant energy"
        self.columns |= {"invariant norm": 1, energy: 1, "observed autocorrelation": 2}
        self.columns |= {f"observed {name}": width for name, width, _ in self._observed}
        records = len(self.plan.stops) + 1
        check_records(asked, records, self.row)

    @property
    def system(self) -> Schrodinger:
        """What is integrated."""
        return self._system

    @property
    def choice(self) -> WaveMethod | Propagation:
        """The method, with nothing left to choose; one of given steps has nothing anyway."""
        return self._method if isinstance(self._method, Stepped) else self.plan

    @property
    def row(self) -> int:
        """Bytes of a record."""
        return 8 * (1 + int(np.prod(self.members)) * sum(self.columns.values()))

    def _planned(
        self, method: WaveMethod | Propagation, times: tuple[float, ...], asked: Asked
    ) -> Propagation:
        if isinstance(method, Propagation):
            if asked.tol is not None:
                raise TypeError("a Propagation has its tol: give it without tol=")
            _check_open("Propagation", asked)
            method.check(times, self._system)
            return method
        if isinstance(method, Stepped) and asked.tol is not None and not isinstance(method, Magnus):
            raise TypeError(f"{type(method).__name__} takes h or steps, and no tol")
        chosen = method_of(method, asked.tol)
        if isinstance(chosen, Stepped):
            return stepped(self._system, chosen, times[0], _stops(times, chosen, asked))
        _check_open(type(chosen).__name__, asked)
        is_real = not np.any(self.psi.imag)
        return planned(self._system, chosen, times, is_real)

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""
        plan = self.plan
        observables = [("symmetric", self.system.hamiltonian), ("start",)]
        observables += [each for _, _, each in self._observed]
        return _core.schrodinger_run(
            self.system.hamiltonian, plan.core, np.atleast_2d(self.psi), (plan.t0, plan.stops),
            observables, self._states, self.threads, bool(self.members),
        )  # fmt: skip

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run: steps, products for each state, the bound of its error."""
        members = int(np.prod(self.members))
        stats = {"steps": run.done, "products": run.stats["evaluations"] / 2 / members}
        return stats if self.plan.bound is None else {**stats, "bound": self.plan.bound}

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Make complex what is complex, and give states and energies as the user has them."""
        paired = {"psi", "observed autocorrelation"}
        paired |= {f"observed {name}" for name, width, _ in self._observed if width == 2}
        found = {
            name: np.ascontiguousarray(part).view(complex) if name in paired else part
            for name, part in parts.items()
        }
        if "psi" in found:
            found["psi"] = self.system.outward(found["psi"])
        for name in {"observed energy", "invariant energy"} & set(found):
            found[name] = self.system.hbar * found[name]
        return found

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return nothing: no energy goes anywhere."""
        del parts
        return {}

    @property
    def dense_order(self) -> int:
        """Say that there is no dense output of such a run."""
        return 0

    def seen(self, run: _core.Run) -> tuple[dict[str, Points], str]:
        """Say that such a run looks for no events."""
        return {}, ""

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""
        if trouble["kind"] == "norm":
            sentence = (
                f"the norm is {trouble['norm']:.6g} where it was {trouble['norm_at_start']:.6g}"
            )
            low, high = self.plan.bounds
            hint = (
                f"H may have eigenvalues outside the bounds [{low:g}, {high:g}] of H/hbar, or its "
                "products are not those of a symmetric matrix: leave out bounds=, or widen them"
            )
            found = sentence, hint, "norm"
        elif trouble["kind"] == "spectrum":
            sentence = (
                f"the spectrum of H(t) is too wide there: a step spans {trouble['theta']:.4g}, and "
                f"the method takes {trouble['most']:.4g}"
            )
            found = sentence, "give a smaller h", "spectrum"
        else:
            if trouble.get("quantity") == "observable":
                trouble |= observable(trouble["index"], self.columns)
            found = describe(trouble, (), ())
        if self.members and "member" in trouble:
            found = (f"member {trouble['member']}: {found[0]}", *found[1:])
        return found


def _start(start: Mapping[str, Any]) -> Any:
    if set(start) != {"psi"}:
        given = ", ".join(sorted(start)) or "nothing"
        raise TypeError(f"a Schrodinger equation starts with psi=, not with {given}")
    return start["psi"]


def _stops(times: tuple[float, ...], method: Stepped, asked: Asked) -> list[tuple[float, int]]:
    """Return the times of the states that are kept, with the steps to each."""
    name = type(method).__name__
    if len(times) > 2:
        if asked.h is None or asked.steps is not None or asked.every != 1:
            raise TypeError(
                f"{name} takes h= with a sequence of times, and neither steps nor every"
            )
        ends = [steps_of(pair, asked.h, None, asked.control, (), name) for pair in pairwise(times)]
        return [(each.t1, each.count) for each in ends]
    pace = steps_of(times, asked.h, asked.steps, asked.control, (), name)
    every = kept(pace, asked.every)
    size = (pace.t1 - pace.t0) / pace.count
    whole = [(pace.t0 + k * size, every) for k in range(every, pace.count, every)]
    return [*whole, (pace.t1, pace.count - every * len(whole))]


def _check_open(name: str, asked: Asked) -> None:
    """Refuse steps for a method that chooses its own."""
    given = {"h": asked.h, "steps": asked.steps, **asked.control}
    bad = [key for key, value in given.items() if value is not None]
    if bad:
        hint = "give tol=, and the times of all states you want: t=np.linspace(t0, t1, 101)"
        raise TypeError(hinted(f"{name} chooses its steps by tol and takes no {bad[0]}", hint))
    if asked.every != 1:
        hint = "give the times of all states you want: t=np.linspace(t0, t1, 101)"
        raise TypeError(
            hinted(f"{name} keeps the states at the times of t= and takes no every", hint)
        )
