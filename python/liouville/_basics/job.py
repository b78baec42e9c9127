"""The job of a run: its start, steps, records and events, beside system and method."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from liouville import _core

Array = np.ndarray

#: A reset as it crosses the border: its tape, whether it is an impact, and the tape of the rate of
#: its event, where that is a function of time and coordinates alone.
Reset = tuple[_core.Tape, bool, _core.Tape | None]

#: A derivative along a direction, and its transpose.
Pair = tuple[_core.Tape, _core.Tape]

#: The derivatives of an event: its gradient, and those of its reset, of what moves coordinates to
#: the constraints after it, and of the impulses then.
Slopes = tuple[_core.Tape, Pair | None, Pair | None, Pair | None]

#: The derivatives of a step of the alpha family: by its unknowns, with the pattern of that, by all
#: else, of its end and of the start of a run.
AlphaSlopes = tuple[_core.Tape, Any, _core.Tape, _core.Tape, _core.Tape]

#: The same with their transposes: by unknowns from the end, by all else from both, of the start.
AlphaTransposed = tuple[AlphaSlopes, _core.Tape, _core.Tape, _core.Tape]

#: An event as it crosses the border: its tape, its direction, how many end the run, the size of
#: a minimum that counts as zero, whether it needs multipliers, its reset, whether it is no event
#: but a switch, and its derivatives where they are wanted.
Event = tuple[_core.Tape, int, int, float, bool, Reset | None, bool, Slopes | None]

#: Derivatives of a mechanical or semi-explicit system by time and parameters.
Sensitivity = _core.Sensitivity | _core.SemiExplicitSensitivity

#: Tangents of such a system, as :class:`Job` has them.
Tangents = tuple[Sensitivity, Array, Array, Array, Array, AlphaSlopes | None]


#: What is looked at in each step: a tape of energies and powers with whether the energy can only
#: fall, and one of constraints left out with their numbers and for each member their sizes.
WatchedSteps = tuple[tuple[_core.Tape, bool] | None, tuple[_core.Tape, list[int], Array] | None]

#: A tape of angles and then of their rates, and the period of each.
Turning = tuple[_core.Tape, Array]


@dataclass(kw_only=True, eq=False, slots=True)
class Job:
    """A run of one member, or of an ensemble; the core reads its attributes.

    Attributes
    ----------
    start : tuple of ndarray
        Arrays y, z and perhaps a; x of shape (P, n); or psi of shape (P, n). Those of an ensemble
        have a row for each member.
    span : tuple
        ``(t0, t1, steps, every)``, or of wave functions ``(t0, [(t, steps to t), ...])``.
    observer : Tape, tuple, str or list
        A tape of the quantities recorded; the plane of a section (normal, offset, period,
        direction); ``"determinants"``; or the observables of wave functions.
    params : ndarray
        Parameters, with a row for each member of an ensemble or one for all.
    states : bool
        Whether states are recorded.
    control : tuple, ndarray or None
        ``(rtol, atol, first step or 0, least step)``, or of reversible steps ``(first step, least
        step, tape of the monitor with whether it needs z' or None)``, or the times between the
        steps of another run.
    watch : tuple or None
        Order of the method, times of the records or None, and events.
    tangents : tuple, ndarray of shape (d, n) or None
        Of a field, directions in what is stepped. Of another system its derivatives, changes of y
        and of z at the start, the latter empty where z follows from y, those of time and
        parameters, a row for each direction, and by which part of themselves the steps become
        longer, and derivatives of a step of the alpha family or None. Changes of the members of an
        ensemble come one after another.
    watched : tuple
        What is looked at in each step of a mechanical system, as :data:`WatchedSteps` has it.
    turning : tuple or None
        A tape of angles and their rates that a run continues from step to step, and their periods.
    varied : list of Split
        The split fields of members, where these have parameters of their own.
    seen : tuple
        How many variables of a split field the user has, and the matrix A of x = A y or None.
    threads : int
        Threads of an ensemble or of one large state.
    is_ensemble : bool
        Whether the rows are members of an ensemble.
    is_reversible : bool
        Whether the alpha family meets a tolerance by reversible steps.
    is_differentiated : bool
        Whether the steps are differentiated, so that their equations are solved to roundoff.
    parts : list of tuple
        Instead of a run a part of a step from each row of the start: when it begins, when it ends,
        and how many of the times of `watch` are in it.
    records : list of WaveRecord
        Where runs of wave functions leave what their derivatives need, one for each member.
    """

    start: tuple[Array, ...]
    span: tuple[Any, ...]
    observer: _core.Tape | tuple[Array, float, float | None, int] | str | list[tuple[object, ...]]
    params: Array = field(default_factory=lambda: np.empty(0))
    states: bool = True
    control: tuple[object, ...] | Array | None = None
    watch: tuple[int, Array | None, list[Event]] | None = None
    tangents: Tangents | Array | None = None
    watched: WatchedSteps = (None, None)
    turning: Turning | None = None
    varied: list[_core.Split] = field(default_factory=list)
    seen: tuple[int, Array | None] = (0, None)
    threads: int = 1
    is_ensemble: bool = False
    is_reversible: bool = False
    is_differentiated: bool = False
    parts: list[tuple[float, float, int]] = field(default_factory=list)
    records: list[_core.WaveRecord] = field(default_factory=list)
