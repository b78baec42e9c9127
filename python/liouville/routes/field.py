"""The way of a polynomial field, or of an ensemble of its states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville import _core
from liouville._arguments import steps_of
from liouville.errors import describe, hinted
from liouville.methods import VolumeSplitting
from liouville.planner import Plan, planned
from liouville.points import Points
from liouville.routes.route import Asked, check_records, kept, observable, threads_of
from liouville.splitting import Affine, Split, crossed, described, variables_of
from liouville.systems import PolynomialField

#: Half of the digits of an affine flow are left after so many of its own times.
MOST_TURNS = 1e8


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
        check_records(asked, records, self.row)
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
    def choice(self) -> Plan:
        """The method, with nothing left to choose."""
        return self.plan

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

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the columns of all records as they are."""
        return parts

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return nothing: a field has no energy of its own."""
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
    own = ("rtol", "atol", "h_min", "control", "monitor")
    given = [name for name in own if options.get(name) is not None]
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
