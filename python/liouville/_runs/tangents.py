"""The directions in which a run is differentiated, from the user's names to arrays and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from liouville._basics.errors import hinted, misshapen
from liouville._methods import (
    HHT,
    ArnoldBruls,
    Composition,
    GeneralizedAlpha,
    LobattoPair,
    Spark,
)
from liouville._methods.control import Steps
from liouville._runs.runner import Request
from liouville._solution.points import Points
from liouville._solution.tangents import Moves, Tangent
from liouville._systems import Field, Mechanics, Schrodinger, SemiExplicit
from liouville._systems.derivatives import semi_explicit as _semi_explicit_sensitivity
from liouville._systems.derivatives import sensitivity as _sensitivity
from liouville._systems.derivatives.multipliers import SharedMultipliers
from liouville._systems.derivatives.sensitivity import Cotangents
from liouville._systems.events import AFTER

#: Systems on constraints, which are stepped with their tangents.
Constrained = Mechanics | SemiExplicit

#: The prefix of directions that are parameters.
PARAMS = "params."

#: Ends of a run, whose derivatives are those of its equal steps.
ENDS = ("t0", "t1")

#: Where a direction begins among all that may change, and its shape.
Place = tuple[int, tuple[int, ...]]

#: The alpha family.
ALPHA = HHT | GeneralizedAlpha | ArnoldBruls


def check_covered(system: Any, method: Any, request: Request) -> None:
    """Refuse runs without tangents; the sentence names those that have them.

    Raises
    ------
    TypeError, ValueError
        The system, its method or an option of the run is not covered.
    """
    base = method.base if isinstance(method, Composition) else method
    if request.is_stored:
        what = "gradients" if request.has_pullback else "tangents"
        hint = "derivatives are kept in memory: leave store= out, and keep fewer states"
        raise TypeError(hinted(f"{what} go without store=", hint))
    if not request.states:
        raise ValueError("tangents are those of states: leave out states=False")
    if isinstance(system, Schrodinger):
        return  # its method is seen when it is planned
    if not isinstance(system, Mechanics):
        return  # and that of others when they are run
    if not isinstance(base, Spark | LobattoPair | ALPHA):
        from liouville._runs.choice import no_runner  # whose module imports this one

        raise no_runner(method, "mechanical", "mechanical systems")
    is_controlled = (request.rtol, request.control) != (None, None)
    if isinstance(base, ALPHA) and system.switch_tapes and is_controlled:
        # the accelerations carried over a switch are those of one side of it
        sentence = f"tangents by {type(method).__name__} go without steps that end at switches"
        raise TypeError(hinted(sentence, "take Spark, or give steps or h where no force jumps"))
    if getattr(base, "newton_tol", None) is not None:
        sentence = "newton_tol leaves an error in the stages, and as large a one in their tangents"
        raise ValueError(hinted(sentence, "leave newton_tol out"))


class Directions:
    """Directions by name, and all of them as rows.

    Attributes
    ----------
    rows : ndarray, shape (count, width)
        What each direction changes of all that may change.
    count : int
        How many rows there are.
    """

    #: Whether directions may be complex.
    has_complex = False
    #: What they change besides states, where functions of states may be differentiated.
    moves: Moves | None = None

    def __init__(
        self,
        tangents: Any,
        places: Mapping[str, Place],
        labels: Mapping[str, tuple[str, ...]],
        hint: str,
    ) -> None:
        if not isinstance(tangents, Mapping) or not tangents:
            raise TypeError(
                hinted(f"tangents must be a mapping of directions, not {tangents!r}", hint)
            )
        self._shapes: dict[str, tuple[int, ...]] = {}
        width = max(first + int(np.prod(shape)) for first, shape in places.values())
        kind = complex if self.has_complex else float
        rows = [np.empty((0, width), dtype=kind)]
        for name, value in tangents.items():
            if name not in places:
                raise ValueError(_unknown(name, places))
            first, shape = places[name]
            is_complex = self.has_complex and name == "psi"
            own = _direction(name, value, shape, labels.get(name, ()), is_complex)
            self._shapes[name] = own.shape[: own.ndim - len(shape)]
            row = np.zeros((int(np.prod(self._shapes[name])), width), dtype=kind)
            size = int(np.prod(shape))
            row[:, first : first + size] = own.reshape(-1, size)
            rows.append(row)
        self.rows = np.concatenate(rows)
        self.count = len(self.rows)

    def named(self, rows: np.ndarray, cuts: Mapping[str, slice]) -> dict[str, Tangent]:
        """Name the columns of tangents in records, cut into states."""
        each = rows.reshape(*rows.shape[:-1], self.count, rows.shape[-1] // self.count)
        found, first = {}, 0
        for name, shape in self._shapes.items():
            last = first + int(np.prod(shape))
            own = each[..., first:last, :] if shape else each[..., first, :]
            states = {state: own[..., cut] for state, cut in cuts.items()}
            moves = None if self.moves is None else self.moves.cut(first, last)
            found[name] = Tangent(states, moves=moves)
            first = last
        return found


class ConstrainedDirections(Directions):
    """Directions of a mechanical or of a semi-explicit system.

    Attributes
    ----------
    y, z : ndarray, shape (count, n)
        Changes of positions and of their partner, not yet moved onto the constraints; of z there
        are none where it follows from y.
    tau : ndarray, shape (count, 1 + P)
        Changes of the start time and of the P parameters.
    stretch : ndarray, shape (count,)
        By which part of themselves the steps become longer.
    """

    def __init__(
        self, system: Constrained, tangents: Any, steps: Steps, *, has_times: bool = False
    ) -> None:
        hint = f'write tangents={{"{system.states[0]}": direction}} or {{"params.name": 1.0}}'
        labels = dict.fromkeys(system.states, system.coordinates)
        places = places_of(system)
        super().__init__(tangents, places, labels, hint)
        for name in tangents:
            _check_held(name, steps)
        n, first = len(system.coordinates), places["t0"][0]
        self.y, self.z, self.tau, end = np.split(self.rows, (n, first, -1), axis=1)
        self.stretch = (end[:, 0] - self.tau[:, 0]) / (steps.t1 - steps.t0)
        self.moves = Moves(
            self.tau[:, 1:], self.tau[:, 0], self.stretch, steps.t0,
            has_times or steps.control is not None,
        )  # fmt: skip

    def starts(
        self, system: Constrained, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the changes of y and z at the start, of a run or of each of P members.

        They are moved onto the constraints as `consistent` of the system moves a start.
        """
        if y.ndim == 1:
            return self._start(system, t, y, z, params)
        rows = np.broadcast_to(params, (len(y), params.shape[-1]))
        rows = np.ascontiguousarray(rows)
        each = [self._start(system, t, *at) for at in zip(y, z, rows, strict=True)]
        dy, dz = (np.array(parts) for parts in zip(*each, strict=True))
        return dy, dz

    def _start(
        self, system: Constrained, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        if isinstance(system, Mechanics):
            return _sensitivity.moved_start(system, t, y, z, params, (self.y, self.z, self.tau))
        moves = self.y, self.tau
        return _semi_explicit_sensitivity.moved_start(system, t, y, params, moves), self.z

    def shared(
        self,
        stepped: Mechanics,
        motion: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        params: np.ndarray,
        rows: np.ndarray,
        moved: np.ndarray,
    ) -> np.ndarray:
        """Return records with tangents of all multipliers, from those of a step's.

        `motion` is t, y, z and all multipliers of the records, `moved` the changes of their times.
        """
        times, *states = motion
        n, m = states[0].shape[-1], states[2].shape[-1]
        each = rows.reshape(*rows.shape[:-1], self.count, -1)
        found = np.empty((*each.shape[:-1], 2 * n + m))
        found[..., : 2 * n] = each[..., : 2 * n]
        for place in np.ndindex(each.shape[:-2]):
            at, own = float(times[place[0]]), each[place]
            y, z, lam = (x[place] for x in states)
            if np.isnan(y).any():  # the run of the member is over
                found[place] = np.nan
                continue
            values = params[place[1]] if params.ndim > 1 else params
            along = np.hstack([moved[place[0]][:, None], own[:, : 2 * n], self.tau[:, 1:]])
            multipliers = SharedMultipliers(stepped, (at, y, z), lam, values)
            found[place][:, 2 * n :] = multipliers.pushed(along, own[:, 2 * n :])
        return found.reshape(*rows.shape[:-1], -1)

    def read(
        self,
        states: tuple[str, str],
        rows: np.ndarray,
        sizes: tuple[int, int, int | None],
        events: Mapping[str, tuple[np.ndarray, np.ndarray | None]],
    ) -> dict[str, Tangent]:
        """Name the columns of tangents in records, of both states and of multipliers.

        Of these the size is None where there are none, and where they are not told there are no
        columns.

        Of each event there are rows of time, states and multipliers, before a reset and after it,
        and of an ensemble which members they are of.
        """
        (n, _, m), own = sizes, sizes[0] + sizes[1]
        whole = None if m is None else own + m
        cuts = {states[0]: slice(n), states[1]: slice(n, own)}
        if whole is not None and rows.shape[-1] == self.count * whole:
            cuts["lam"] = slice(own, None)
        found = self.named(rows, cuts)
        for event, (sides, members) in events.items():
            width = sides.shape[-1] // self.count
            wide = {"t": slice(1), states[0]: slice(1, 1 + n), states[1]: slice(1 + n, 1 + own)}
            if whole is not None and width == 1 + whole:
                wide["lam"] = slice(1 + own, None)
            ends = [self.named(sides[:, k], wide) for k in range(sides.shape[1])]
            for name, tangent in found.items():
                found_at = {f"{x}{end}": y for end, at in zip(("", AFTER), ends, strict=False)
                            for x, y in at[name].states.items()}  # fmt: skip
                t = found_at.pop("t")[..., 0]
                found_at.pop(f"t{AFTER}", None)
                found_at |= {} if members is None else {"member": members}
                tangent.events[event] = Points(t, found_at)
        return found


def _check_held(name: str, steps: Steps) -> None:
    """Refuse the end of a run whose steps do not follow it."""
    if name in ENDS and steps.control is not None:
        sentence = f"there is no derivative by '{name}' where steps are controlled"
        raise ValueError(hinted(sentence, "controlled steps are held: give steps or h"))


def check_wrt(system: Constrained, wrt: Any, steps: Steps) -> tuple[str, ...]:
    """Return names of what gradients are by, each seen to be one."""
    names = check_names(wrt, places_of(system), system.states[0])
    for name in names:
        _check_held(name, steps)
    return names


def check_names(wrt: Any, places: Mapping[str, Place], first: str) -> tuple[str, ...]:
    """Return names of what gradients are by, each of which has a place."""
    if isinstance(wrt, str) or not isinstance(wrt, Sequence) or not wrt:
        hint = f'write wrt=["{first}", "params.name"]'
        raise TypeError(hinted(f"wrt must be a sequence of names, not {wrt!r}", hint))
    for name in wrt:
        if not isinstance(name, str) or name not in places:
            raise ValueError(_unknown(name, places))
    return tuple(wrt)


def shapes_of(system: Constrained, names: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Return the shape of what each name is a direction of."""
    places = places_of(system)
    return {name: places[name][1] for name in names}


def gradients_of(
    system: Constrained,
    steps: Steps,
    found: Cotangents,
    stretch: float | np.ndarray,
    wrt: tuple[str, ...],
) -> dict[str, Any]:
    """Return gradients by name, from cotangents of the start and of the stretch of the steps.

    Those of several members have a row for each.
    """
    end = np.divide(stretch, steps.t1 - steps.t0)
    rows = np.concatenate([*found, end[..., None]], axis=-1)
    places, gradients = places_of(system), {}
    rows[..., places["t0"][0]] -= end
    for name in wrt:
        first, shape = places[name]
        own = rows[..., first : first + int(np.prod(shape))].reshape((*rows.shape[:-1], *shape))
        gradients[name] = own if own.ndim else float(own)
    return gradients


def places_of(system: Constrained | Field) -> dict[str, Place]:
    """Return where each direction begins among all that may change, and its shape."""
    n = len(system.coordinates)
    # of a semi-explicit system z follows from y
    names = system.states[:1] if isinstance(system, SemiExplicit) else system.states
    found: dict[str, Place] = {name: (k * n, (n,)) for k, name in enumerate(names)}
    found["t0"] = (len(names) * n, ())
    place = len(names) * n + 1
    for name, value in system.params.items():
        found[PARAMS + name] = (place, np.shape(value))
        place += np.size(value)
    return found | {"t1": (place, ())}


def _unknown(name: Any, places: Mapping[str, Any]) -> str:
    known = ", ".join(places)
    hint = f"there are {known}"
    if name in ("h", "steps") and "t1" in places:
        hint = "steps are counted in whole numbers: the derivative by their end is that by 't1'"
    elif name == "z" and "y" in places:
        hint = f"z follows from y by the hidden constraint: {hint}"
    elif isinstance(name, str) and PARAMS + name in places:
        hint = f"a parameter's direction is called '{PARAMS}{name}'"
    return hinted(f"there is no direction {name!r}", hint)


def _direction(
    name: str,
    value: Any,
    shape: tuple[int, ...],
    labels: tuple[str, ...],
    is_complex: bool = False,
) -> np.ndarray:
    """Return a direction, or several one after another, as an array of floats."""
    if isinstance(value, Mapping) and labels:
        for label in value:
            if label not in labels:
                sentence = f"tangents of '{name}' has a value for {label!r}, which is no coordinate"
                raise ValueError(sentence)
        value = [value.get(label, 0.0) for label in labels]
    try:
        array = np.asarray(None if np.ma.is_masked(value) else value)  # what is masked is no number
    except ValueError:  # rows of different lengths
        array = np.array(None)
    if array.dtype.kind not in ("iufc" if is_complex else "iuf"):
        kind = "" if is_complex else "real "
        raise TypeError(f"tangents of '{name}' must be an array of {kind}numbers, not {value!r}")
    if array.ndim == 0 and shape == (1,):
        array = array.reshape(1)
    inner = array.ndim - len(shape)
    if array.shape == (0, *shape):
        sentence = f"tangents of '{name}' must be one direction or more, not an empty array"
        raise ValueError(hinted(sentence, f"leave '{name}' out, or give one of shape {shape}"))
    if inner not in (0, 1) or array.shape[inner:] != shape or 0 in array.shape:
        stacked = "d, " + ", ".join(map(str, shape)) if shape else "d,"
        wanted = f"{shape} for one direction or ({stacked}) for d of them"
        raise misshapen(f"tangents of '{name}'", array.shape, wanted)
    if not np.isfinite(array).all():
        raise ValueError(f"tangents of '{name}' must be finite")
    return array.astype(complex if is_complex else float)
