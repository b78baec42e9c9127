"""Derivatives of runs of a Schrödinger equation, piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._arguments import check_memory
from liouville.errors import hinted
from liouville.planner import WavePlan
from liouville.planner.waves.propagators import (
    Driven,
    Exponentials,
    Series,
    SeriesExponentials,
    Shears,
)
from liouville.runners.tangents import PARAMS, Directions, Place, check_names
from liouville.systems import Schrodinger
from liouville.tangents import Tangent

Array = NDArray[Any]

#: The highest degree in time of changes of H within a window, which the core has nodes for, and
#: that of a spline between two samples.
DEGREE, CUBIC = 14, 3

#: Propagators whose runs leave what derivatives need.
LEFT = (Series, Driven, SeriesExponentials, Exponentials)

#: What a polynomial may leave out of a derivative of H, relative to the largest there is.
LEFT_OUT = 1e-11

#: Terms of a window beyond its length in units of 1/beta, about.
TERMS = 40

#: Arrays that a potential at the nodes of a window is in, at a time.
COPIES = 3

#: Most intervals on which derivatives of a drive are polynomials.
INTERVALS = 4096

#: The methods whose runs leave pieces.
COVERED = (
    "methods that have: 'auto', Chebyshev, Magnus with h or steps, and for a real H "
    "SchrodingerSplitting, GrayManolopoulos, and StabilitySplitting with processed=False"
)


class WaveDirections(Directions):
    """Directions of a run of a Schrödinger equation: columns of psi, parameters and samples."""

    has_complex = True

    def __init__(self, system: Schrodinger, tangents: Any) -> None:
        hint = 'write tangents={"psi": direction} or {"params.name": 1.0}'
        super().__init__(tangents, places_of(system), {}, hint)
        self.names = tuple(tangents)

    def read(self, rows: Array) -> dict[str, Tangent]:
        """Name tangents of psi of all directions at kept times."""
        return self.named(rows, {"psi": slice(None)})


def places_of(system: Schrodinger) -> dict[str, Place]:
    """Return where each direction begins among all that may change, and its shape."""
    drive = system.sensitivity
    found: dict[str, Place] = {"psi": (0, (system.size,))}
    for name, (cut, shape) in drive.params.items():
        found[PARAMS + name] = (system.size + cut.start, shape)
    place = system.size + sum(int(np.prod(shape)) for _, shape in drive.params.values())
    for name in drive.samples:
        size = drive.times(name).size
        found[name] = (place, (size,))
        place += size
    return found


def check_plan(plan: WavePlan) -> None:
    """Refuse a plan whose run leaves nothing that a derivative could follow."""
    is_split = isinstance(plan.core, Shears) and not plan.is_complex
    if not is_split and not isinstance(plan.core, LEFT):
        raise TypeError(hinted(f"{plan.scheme} has no tangents and no pullback", COVERED))


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


def check_wrt(system: Schrodinger, wrt: Any) -> tuple[str, ...]:
    """Return names of what derivatives are by, each seen to be one."""
    if system.moving_product is not None:
        hint = "give H(t) as a matrix and drives, pairs of a function and a matrix"
        raise TypeError(hinted("there is no derivative of an H(t) known by its products", hint))
    names = check_names(wrt, places_of(system), "psi")
    for name in names:
        if name.startswith(PARAMS) and not (
            of_drive(system, [name]) or of_potential(system, [name])
        ):
            sentence = f"neither a drive nor the potential depends on '{name}'"
            raise ValueError(f"{sentence}: a derivative by it is zero")
    return names


def of_drive(system: Schrodinger, names: Sequence[str]) -> list[str]:
    """Return those of these names that a drive depends on."""
    drive = system.sensitivity
    return [
        name
        for name in names
        if name in drive.samples
        or (name.startswith(PARAMS) and drive.depends_on(name.removeprefix(PARAMS)))
    ]


def of_potential(system: Schrodinger, names: Sequence[str]) -> list[str]:
    """Return those of these names that the potential of a grid depends on."""
    potential = system.potential_sensitivity
    params = [name for name in names if name.startswith(PARAMS)]
    if potential is None:
        return []
    return [name for name in params if potential.depends_on(name.removeprefix(PARAMS))]


def _slopes_of(system: Schrodinger, names: Sequence[str]) -> dict[str, Callable[[Array], Array]]:
    """Return what depends on parameters, with its derivatives by these at times, a row for each."""
    drive, potential = system.sensitivity, system.potential_sensitivity

    def places(own: Sequence[str]) -> list[int]:
        cuts = [drive.params[x.removeprefix(PARAMS)][0] for x in own if x.startswith(PARAMS)]
        return [k for cut in cuts for k in range(cut.start, cut.stop)]

    found: dict[str, Callable[[Array], Array]] = {}
    if of := places(of_drive(system, names)):
        found["drive"] = lambda t: drive.slopes(t)[:, of].reshape(t.size, -1)
    if own := places(of_potential(system, names)):
        assert potential is not None, "what depends on parameters"
        found["potential"] = lambda t: potential.slopes(t, own)
    return found


def with_breaks(plan: WavePlan, system: Schrodinger, names: Sequence[str]) -> WavePlan:
    """Return a plan of the same series whose windows resolve derivatives by all these names."""
    by = [name for name in names if name != "psi"]
    if not isinstance(plan.core, Driven) or not by:
        return plan
    drive, (t0, t1) = system.sensitivity, (plan.t0, plan.stops[-1][0])
    breaks = {t for name in by if name in drive.samples for t in drive.times(name).tolist()}
    for what, slopes in _slopes_of(system, by).items():
        breaks |= set(_resolved(what, slopes, t0, t1))
    inside = sorted(t for t in breaks if min(t0, t1) < t < max(t0, t1))
    core = replace(plan.core, breaks=tuple(inside if t1 > t0 else inside[::-1]))
    powers, bessel, products, theta = _core.driven_cost(system.hamiltonian, core, t0, t1)
    return replace(
        plan,
        core=replace(core, windows=powers + bessel),
        scheme=f"series in time ({powers + bessel} windows)",
        theta=theta,
        products=float(products),
        bound=None if bessel else getattr(plan.method, "tol", None),
    )


def _resolved(what: str, slopes: Callable[[Array], Array], t0: float, t1: float) -> list[float]:
    """Return times between which derivatives by parameters are polynomials of time."""
    todo, found, largest = [(t0, t1)], [], 0.0
    while todo:
        a, b = todo.pop()
        nodes = a + (b - a) * _nodes()
        rows = slopes(nodes)
        if not np.isfinite(rows).all():
            sentence = f"derivatives of the {what} by its parameters are not finite near t = {a:g}"
            raise ValueError(hinted(sentence, "look for a root or a division by zero there"))
        sizes = _sizes(rows)
        largest = max(largest, float(np.abs(rows).max(initial=0.0)))
        if sizes[DEGREE + 1 :].sum() <= LEFT_OUT * largest:
            found.append(a)
        else:
            middle = 0.5 * (a + b)
            todo += [(middle, b), (a, middle)]
        if len(found) + len(todo) > INTERVALS:
            sentence = f"the derivative of the {what} by its parameters is not smooth in time"
            hint = "take Magnus with steps between its jumps, or samples= at times="
            raise ValueError(hinted(sentence, hint))
    return found


def _nodes() -> Array:
    """Return Chebyshev's nodes in the order of the core, as parts of a window."""
    return 0.5 * (1 + np.cos(np.pi * np.arange(DEGREE + 7) / (DEGREE + 6)))


def _sizes(rows: Array) -> Array:
    """Return the largest of Chebyshev's coefficients of each degree, of functions at the nodes."""
    last = len(rows) - 1
    k = np.arange(last + 1)
    half = np.where((k == 0) | (k == last), 0.5, 1.0)
    matrix = 2 / last * np.outer(half, half) * np.cos(np.pi * np.outer(k, k) / last)
    found: Array = np.abs(matrix @ rows).max(axis=1, initial=0.0)
    return found


class WaveDerivative:
    """What a run has left, and what moves derivatives through it.

    All states and cotangents are rows of the core's components; see :class:`Frame`.
    """

    def __init__(
        self, system: Schrodinger, plan: WavePlan, psi: Array, run: tuple[_core.WaveRecord, int]
    ) -> None:
        record, threads = run
        self._system, self._psi = system, psi
        self._drive, self._potential = system.sensitivity, system.potential_sensitivity
        self._core = _core.WaveDerivative(system.hamiltonian, system.groups, record, threads)
        self._kept = [0, *np.cumsum([steps for _, steps in plan.stops]).tolist()]
        self._is_split = isinstance(plan.core, Shears)
        if isinstance(plan.core, Shears):  # one piece to each state kept
            self._kept = [*range(len(plan.times))]
            for t, (end, steps) in zip(plan.times, plan.stops, strict=False):
                h = (end - t) / steps
                self._core.add_shears(plan.core.coefficients, plan.core.shift, t, h, steps)
        self._pieces = [self._core.piece(k) for k in range(len(self._core))]
        self._steps = np.cumsum([0, *(steps for steps, _ in self._pieces)]).tolist()
        self._by: tuple[str, ...] = ()

    def resolve(self, names: Sequence[str]) -> None:
        """Let H change within each window by polynomials that derivatives by these names need."""
        drive, by = self._drive, [name for name in names if name != "psi"]
        if self._is_split and of_potential(self._system, by):
            state = self._psi[None]
            for k in range(len(self._pieces)):
                state = self._core.keep_ends(k, state)
        each = _slopes_of(self._system, by)
        least = CUBIC if any(name in drive.samples for name in by) else 0
        for k, (_, nodes) in enumerate(self._pieces):
            if nodes.size != DEGREE + 7:
                continue
            degree = least
            for slopes in each.values():
                sizes = _sizes(slopes(nodes))
                rest = np.cumsum(sizes[::-1])[::-1]
                above = np.flatnonzero(rest > LEFT_OUT * max(rest[0], 1e-300))
                degree = max(degree, min(int(above.max(initial=0)), DEGREE))
            self._core.raise_degree(k, degree)

    def followed(self, rows: Array) -> Array:
        """Return tangents of the states kept, shape (k, directions, N), of directions as rows."""
        n = self._system.size
        states = self._system.frame.inward(rows[:, :n])
        changes = np.ascontiguousarray(rows[:, n:].real)
        kept = [states]
        for k, (_, nodes) in enumerate(self._pieces):
            moved = self._changes(nodes, changes), self._potential_changes(nodes, changes)
            states, outputs = self._core.follow(k, states, *moved)
            kept += self._keep(k, outputs.reshape(-1, len(rows), n))
        return self._system.outward(np.array(kept))

    def repeated(self, direction: Array, size: float) -> Array:
        """Return the states kept by a run with all choices held, moved by so much of a row."""
        system, drive, n = self._system, self._drive, self._system.size
        moved = size * direction
        state = (self._psi + system.frame.inward(moved[:n]))[None]
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
                change[:, 1:] += drive.values(nodes, params) - drive.values(nodes, start)
            if (potential := self._potential) is not None and not np.array_equal(params, start):
                of_points = potential.values(nodes, params) - potential.values(nodes, start)
            state, outputs = self._core.repeat(k, state, change, of_points)
            kept += self._keep(k, outputs[:, None])
        return system.outward(np.array(kept)[:, 0])

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
            size = drive.times(name).size
            own = changes[:, place : place + size]
            if own.any():
                found[..., 1 + k] += own @ drive.basis(name, nodes).T
            place += size
        return found

    def _potential_changes(self, nodes: Array, changes: Array) -> Array:
        """Return changes of the potential at nodes, shape (directions, nodes, rows), or none."""
        count, none = self._system.parameters.values(None).size, np.zeros((len(changes), 0, 0))
        if self._potential is None or not nodes.size or not changes[:, :count].any():
            return none
        return np.array([self._potential.pushed(nodes, own) for own in changes[:, :count]])

    def pulled(self, cotangents: Array, names: Sequence[str]) -> dict[str, Array]:
        """Return gradients by these names from cotangents of the states kept, shape (k, N)."""
        system, drive = self._system, self._drive
        rows = dict(zip(self._kept, system.frame.inward(cotangents), strict=True))
        state = np.zeros((1, system.size), dtype=complex)
        potential = self._potential if of_potential(system, names) else None
        wanted = bool(of_drive(system, names)), potential is not None
        by_potential = np.zeros(system.parameters.values(None).size)
        times, weights = [np.empty(0)], [np.empty((0, 1 + drive.count))]
        for k in reversed(range(len(self._pieces))):
            steps, nodes = self._pieces[k]
            first = self._steps[k] + 1
            of_steps = np.zeros((steps, system.size), dtype=complex)
            for j in range(steps):
                of_steps[j] = rows.get(first + j, 0.0)
            state, of_weights, of_points = self._core.pull(k, state, of_steps, wanted)
            if of_weights.size:
                times.append(nodes)
                weights.append(of_weights.reshape(nodes.size, -1))
            if potential is not None:
                by_potential += potential.pulled(nodes, of_points.reshape(nodes.size, -1))
        gradients = {"psi": system.outward(state[0] + rows[0])}
        t, w = np.concatenate(times), np.concatenate(weights)[:, 1:]
        if any(name.startswith(PARAMS) for name in names):
            by_params = by_potential + (drive.pulled(t, w) if t.size else 0.0)
            for name, (cut, shape) in drive.params.items():
                gradients[PARAMS + name] = by_params[cut].reshape(shape)
        for name, k in drive.samples.items():
            if name in names:
                gradients[name] = w[:, k] @ drive.basis(name, t)
        return {name: gradients[name] for name in names}


def direction_row(system: Schrodinger, directions: Mapping[str, Any]) -> Array:
    """Return directions by name as one row of all that may change."""
    places = places_of(system)
    width = max(first + int(np.prod(shape)) for first, shape in places.values())
    row = np.zeros(width, dtype=complex)
    for name, value in directions.items():
        first, shape = places[name]
        row[first : first + int(np.prod(shape))] = np.ravel(value)
    return row
