"""Derivatives of runs of a Schrödinger equation, piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics.arguments import check_memory
from liouville._basics.errors import hinted
from liouville._methods.planner import WavePlan, plan_wave
from liouville._methods.planner.waves.driven import Planned
from liouville._methods.planner.waves.propagators import (
    Diagonal,
    Driven,
    Exponentials,
    Series,
    SeriesExponentials,
    Shears,
    SplitSteps,
)
from liouville._runs.tangents import ENDS, PARAMS, Directions, Place, check_names
from liouville._runs.waves.windows import (
    DEGREE,
    LEFT_OUT,
    at_times,
    of_drive,
    of_potential,
    series_of,
    slopes_of,
)
from liouville._solution.tangents import Tangent
from liouville._systems import Schrodinger

Array = NDArray[Any]

#: Propagators whose runs leave what derivatives need.
LEFT = (Series, Driven, SeriesExponentials, Exponentials)

#: Windows that changes of H are looked at in at once.
AT_ONCE = 16

#: Terms of a window beyond its length in units of 1/beta, about.
TERMS = 60

#: Arrays that a potential at the nodes of a window is in, at a time.
COPIES = 3

#: Terms of a Taylor series over a short time by which a run is moved.
SHIFT = 4

#: The methods whose runs leave pieces.
COVERED = (
    "methods that have: 'auto' and Chebyshev with up to ten drives, Magnus(...) with h= or steps=, "
    "and for a real H SchrodingerSplitting, GrayManolopoulos, and StabilitySplitting with "
    "processed=False"
)


class WaveDirections(Directions):
    """Directions of a run of a Schrödinger equation: columns of psi, parameters and samples."""

    has_complex = True

    def __init__(self, system: Schrodinger, tangents: Any, times: int) -> None:
        hint = 'write tangents={"psi": direction} or {"params.name": 1.0}'
        super().__init__(tangents, places_of(system, times), {}, hint)
        self.names = tuple(tangents)

    def read(self, rows: Array) -> dict[str, Tangent]:
        """Name tangents of psi of all directions at kept times."""
        return self.named(rows, {"psi": slice(None)})


def places_of(system: Schrodinger, times: int = 0) -> dict[str, Place]:
    """Return where each direction begins among all that may change, and its shape.

    The last are so many times that a run was given, the start, the end, or all.
    """
    drive = system.sensitivity
    found: dict[str, Place] = {"psi": (0, (system.size,))}
    for name, (cut, shape) in drive.params.items():
        found[PARAMS + name] = (system.size + cut.start, shape)
    place = system.size + sum(int(np.prod(shape)) for _, shape in drive.params.values())
    for name in drive.samples:
        size = drive.number(name)
        found[name] = (place, (size,))
        place += size
    if times:
        found |= {"t": (place, (times,)), "t0": (place, ()), "t1": (place + times - 1, ())}
    return found


def moves_of(plan: WavePlan, times: int) -> Array:
    """Return how the times of the states that are kept move by those that a run was given."""
    kept = np.array(plan.times)
    if times == kept.size:
        return np.eye(times)
    part = (kept - kept[0]) / (kept[-1] - kept[0])  # of equal steps
    return np.stack([1 - part, part], axis=1)


def followed(system: Schrodinger, plan: WavePlan) -> WavePlan:
    """Return the plan of a run that is differentiated, whose drive is no part of an H without time.

    What "auto" takes of methods without derivatives is planned anew.
    TypeError where the run leaves nothing that a derivative could follow.
    """
    if system.components > 1:
        sentence = "there are no derivatives of runs of several components"
        raise TypeError(hinted(sentence, "take differences of runs"))
    is_other = isinstance(plan.core, Diagonal | SplitSteps) and isinstance(plan.method, Planned)
    if is_other or (system.is_driven and plan.is_settled):
        assert isinstance(plan.method, Planned)
        plan = plan_wave(system, plan.method, plan.times, is_differentiated=True)
    is_split = isinstance(plan.core, Shears) and not plan.is_complex
    if not is_split and not isinstance(plan.core, LEFT):
        raise TypeError(hinted(f"{plan.scheme} has no tangents and no pullback", COVERED))
    return plan


def check_room(
    plan: WavePlan, size: int, *, is_wanted: bool, potentials: int = 0, runs: int = 1
) -> None:
    """Refuse runs that would leave more than fits in memory, with the terms of a window.

    There are so many changes of a potential, or cotangents of one, at the nodes of a window.
    """
    kept = plan.windows
    if isinstance(plan.core, Shears):
        kept = 2 * len(plan.stops) if potentials else 0
    if isinstance(plan.core, Exponentials | SeriesExponentials):
        ends = 2 if isinstance(plan.core, Exponentials) else 1
        kept = ends * plan.core.scheme[1] * plan.steps
    kept *= runs
    terms = plan.theta + TERMS if is_wanted else 0
    terms += COPIES * (DEGREE + 7) * potentials / 2  # of real numbers
    what = f"differentiating a run of {size} components, which keeps {kept} of its states,"
    check_memory(what, 16.0 * size * (kept + terms), "take fewer steps, or a shorter run")


def check_wrt(system: Schrodinger, wrt: Any, times: int = 0) -> tuple[str, ...]:
    """Return names of what derivatives are by, each seen to be one."""
    if system.moving_product is not None:
        hint = "give H(t) as a matrix and drives, pairs of a function and a matrix"
        raise TypeError(hinted("there is no derivative of an H(t) known by its products", hint))
    return check_names(wrt, places_of(system, times), "psi")


def records(
    system: Schrodinger,
    plan: WavePlan,
    names: Sequence[str],
    count: int,
    *,
    is_closed: bool = False,
) -> list[_core.WaveRecord]:
    """Return where so many runs leave what derivatives by these names need, and how they are made.

    H changes within each window by polynomials, in as many terms, as these derivatives need. Closed
    records are for runs that take the same terms and leave nothing.
    """
    each = slopes_of(system, [name for name in names if name != "psi"])
    tol = getattr(plan.method, "tol", 1e-8) if each else None
    found = [_core.WaveRecord(tol, is_closed) for _ in range(count)]
    if isinstance(plan.core, Driven):
        times = [t for t, _ in plan.stops]
        for record in found:
            record.lay_out(system.hamiltonian, plan.core, plan.t0, times)
        _resolve(found, system, each)
    return found


def _resolve(
    records: Sequence[_core.WaveRecord],
    system: Schrodinger,
    each: Mapping[str, Callable[[Array], Array]],
) -> None:
    """Let the windows of these runs, which are the same, have what changes of H need."""
    samples, first = system.sensitivity.samples, records[0]
    nodes = np.array([first.nodes(k) for k in range(len(first))])
    windows, count = nodes.shape
    parts = [slice(k, k + AT_ONCE) for k in range(0, windows, AT_ONCE)]
    known = [system.sensitivity.degree(name) for name in samples.keys() & each.keys()]
    degrees = np.full(windows, max(known, default=0))
    largest = {what: np.full(1, 1e-300) for what in each}
    for part in parts:
        for what, slopes in each.items():
            rows = at_times(what, slopes, nodes[part].ravel())
            largest[what] = np.maximum(largest[what], np.abs(rows).max(axis=(0, 2)))
            if what in samples:  # splines
                continue
            series = series_of(rows.reshape(-1, count, rows[0].size))
            sizes = np.abs(series).max(axis=-1, initial=0.0)
            rest = np.cumsum(sizes[:, ::-1], axis=1)[:, ::-1]
            is_above = rest > LEFT_OUT * np.maximum(rest[:, :1], 1e-300)
            needed = np.where(is_above, np.arange(count), 0).max(axis=1)
            degrees[part] = np.maximum(degrees[part], np.minimum(needed, DEGREE))
    for part in parts:
        columns = [np.zeros((len(nodes[part]), 0, 0))]
        for what, slopes in each.items():
            rows = slopes(nodes[part].ravel()) / largest[what][:, None]
            columns.append(rows.reshape(-1, count, rows[0].size))
        rows = np.ascontiguousarray(np.concatenate(columns[1:] or columns, axis=2))
        for k, own in enumerate(rows, part.start):
            for record in records:
                record.raise_degree(k, int(degrees[k]))
                record.lengthen(k, own)


class WaveDerivative:
    """The records of a run, and the operators that take derivatives through it.

    All states and cotangents are rows of the core's components; see :class:`Frame`.
    """

    def __init__(
        self,
        system: Schrodinger,
        plan: WavePlan,
        psi: Array,
        run: tuple[_core.WaveRecord, int],
        names: Sequence[str],
        times: int,
    ) -> None:
        record, threads = run
        self._system, self._psi = system, psi
        self._times, self._moves = np.array(plan.times), moves_of(plan, times)
        self._drive, self._potential = system.sensitivity, system.potential_sensitivity
        self._core = _core.WaveDerivative(system.hamiltonian, system.groups, record, threads)
        self._kept = [0, *np.cumsum([steps for _, steps in plan.stops]).tolist()]
        if isinstance(plan.core, Shears):  # one piece to each state kept
            self._kept = [*range(len(plan.times))]
            for t, (end, steps) in zip(plan.times, plan.stops, strict=False):
                h = (end - t) / steps
                self._core.add_shears(plan.core.coefficients, plan.core.shift, t, h, steps)
            if of_potential(system, names):
                self._core.keep_ends(psi[None])
        self._pieces = [self._core.piece(k) for k in range(len(self._core))]
        self._steps = np.cumsum([0, *(steps for steps, _ in self._pieces)]).tolist()

    @property
    def nodes(self) -> Array:
        """The times at which H was taken."""
        return np.concatenate([np.empty(0), *(nodes for _, nodes in self._pieces)])

    def followed(self, rows: Array, psi: Array) -> Array:
        """Return tangents of the states kept, shape (k, directions, N), of directions as rows."""
        system, n = self._system, self._system.size
        states = system.frame.inward(rows[:, :n])
        changes = np.ascontiguousarray(rows[:, n:].real)
        ends = changes[:, changes.shape[1] - self._moves.shape[1] :]
        if ends.any():
            states = states - np.outer(ends[:, 0], self._rates(self._psi[None], [0]))
        kept = [states]
        for k, (_, nodes) in enumerate(self._pieces):
            moved = self._changes(nodes, changes), self._potential_changes(nodes, changes)
            states, outputs = self._core.follow(k, states, *moved)
            kept += self._keep(k, outputs.reshape(-1, len(rows), n))
        found = np.array(kept)
        if ends.any():
            rates = self._rates(system.frame.inward(psi), range(len(psi)))
            found += (self._moves @ ends.T)[..., None] * rates[:, None]
        return system.outward(found)

    def _rates(self, states: Array, kept: Sequence[int]) -> Array:
        """Return derivatives by time of states of the core, at the times of these kept ones."""
        times = self._times[list(kept)].tolist()
        each = zip(times, states, strict=True)
        return np.concatenate([states[:0], *(self._system.rate(t, x[None]) for t, x in each)])

    def _shifted(self, state: Array, t: float, end: float) -> Array:
        """Return a state of the core at a time as it is at another one nearby."""
        found, term = state, state
        for degree in range(1, SHIFT + 1):
            rate = self._system.rate(0.5 * (t + end), term[None])[0]
            term = (end - t) / degree * rate
            found = found + term
        return found

    def repeated(self, direction: Array, size: float) -> Array:
        """Return the states kept by a run with all choices held, moved by so much of a row."""
        system, drive, n = self._system, self._drive, self._system.size
        moved = size * direction
        ends = moved[moved.size - self._moves.shape[1] :].real
        state = self._psi + system.frame.inward(moved[:n])
        if ends.any():
            state = self._shifted(state, self._times[0] + ends[0], self._times[0])
        state = state[None]
        kept = [state]
        start = system.parameters.values(None)
        params = start + moved[n : n + start.size].real
        by_samples = np.zeros(moved.size - n)
        by_samples[start.size :] = moved[n + start.size :].real
        for k, (_, nodes) in enumerate(self._pieces):
            change = self._changes(nodes, by_samples[None])[0]
            of_points = np.zeros((0, 0))
            if nodes.size and drive.count:
                change = change if change.size else np.zeros((nodes.size, 1 + drive.count))
                change[:, 1:] += system.drive_values(nodes, params) - system.drive_values(
                    nodes, start
                )
            if (potential := self._potential) is not None and not np.array_equal(params, start):
                of_points = potential.values(nodes, params) - potential.values(nodes, start)
            state, outputs = self._core.repeat(k, state, change, of_points)
            kept += self._keep(k, outputs[:, None])
        found = np.array(kept)[:, 0]
        if ends.any():
            each = zip(found, self._times, self._times + self._moves @ ends, strict=True)
            found = np.array([self._shifted(*own) for own in each])
        return system.outward(found)

    def _keep(self, piece: int, outputs: Array) -> list[Array]:
        first = self._steps[piece] + 1
        return [x for k, x in enumerate(outputs) if first + k in self._kept]

    def _changes(self, nodes: Array, changes: Array) -> Array:
        """Return changes of all weights at nodes, from those of parameters and samples."""
        drive = self._drive
        if not nodes.size or not changes.any():
            return np.zeros((len(changes), 0, 1 + drive.count))
        found = np.zeros((len(changes), nodes.size, 1 + drive.count))
        count = self._system.parameters.values(None).size
        if drive.count and changes[:, :count].any():
            found[..., 1:] += np.einsum("dp,npk->dnk", changes[:, :count], drive.slopes(nodes))
        place = count
        for name, k in drive.samples.items():
            size = drive.number(name)
            own = changes[:, place : place + size]
            if own.any():
                found[..., 1 + k] += drive.of_samples(name, nodes, own)
            place += size
        return found

    def _potential_changes(self, nodes: Array, changes: Array) -> Array:
        """Return changes of the potential at nodes, shape (directions, nodes, rows), or none."""
        count, none = self._system.parameters.values(None).size, np.zeros((len(changes), 0, 0))
        if self._potential is None or not nodes.size or not changes[:, :count].any():
            return none
        return np.array([self._potential.pushed(nodes, own) for own in changes[:, :count]])

    def pulled(self, cotangents: Array, names: Sequence[str], psi: Array) -> dict[str, Array]:
        """Return gradients by these names from cotangents of the states kept, shape (k, N)."""
        system, drive = self._system, self._drive
        inward = system.frame.inward(cotangents)
        has = inward.any(axis=1)
        steps, rows = np.array(self._kept)[has], inward[has]
        at_start = rows[steps == 0].sum(axis=0)
        potential = self._potential if of_potential(system, names) else None
        wanted = bool(of_drive(system, names)), potential is not None
        by_potential = np.zeros(system.parameters.values(None).size)
        times, weights = [np.empty(0)], [np.empty((0, 1 + drive.count))]
        for first, end in self._parts(is_single=potential is not None):
            cut = slice(*np.searchsorted(steps, [self._steps[first] + 1, self._steps[end] + 1]))
            pulled = self._core.pull((first, end), (steps[cut] - 1).tolist(), rows[cut], wanted)
            nodes = np.concatenate([nodes for _, nodes in self._pieces[first:end]])
            of_weights, of_points = (found.reshape(nodes.size, -1) for found in pulled)
            if of_weights.size:
                times.append(nodes)
                weights.append(of_weights)
            if potential is not None:
                by_potential += potential.pulled(nodes, of_points)
        by_start = self._core.cotangent[0] + at_start
        gradients = {"psi": system.outward(by_start)}
        if {"t", *ENDS} & set(names):
            rates = self._rates(system.frame.inward(psi[has]), np.flatnonzero(has).tolist())
            each = np.einsum("kn,kn->k", rows.conj(), rates).real @ self._moves[has]
            each[0] -= np.vdot(by_start, self._rates(self._psi[None], [0])[0]).real
            gradients |= {"t": each, "t0": each[0], "t1": each[-1]}
        t, w = np.concatenate(times), np.concatenate(weights)[:, 1:]
        if any(name.startswith(PARAMS) for name in names):
            by_params = by_potential + (drive.pulled(t, w) if t.size else 0.0)
            for name, (cut, shape) in drive.params.items():
                gradients[PARAMS + name] = by_params[cut].reshape(shape)
        for name, k in drive.samples.items():
            if name in names:
                gradients[name] = drive.to_samples(name, t, w[:, k])
        return {name: gradients[name] for name in names}

    def _parts(self, *, is_single: bool) -> list[tuple[int, int]]:
        """Return pieces from the last back, as ranges: one each, or all at once."""
        count = len(self._pieces)
        return [(k, k + 1) for k in reversed(range(count))] if is_single else [(0, count)]


def direction_row(system: Schrodinger, directions: Mapping[str, Any], times: int) -> Array:
    """Return directions by name as one row of all that may change, so many times too."""
    places = places_of(system, times)
    width = max(first + int(np.prod(shape)) for first, shape in places.values())
    row = np.zeros(width, dtype=complex)
    for name, value in directions.items():
        first, shape = places[name]
        row[first : first + int(np.prod(shape))] += np.ravel(value)  # ends are among all times
    return row
