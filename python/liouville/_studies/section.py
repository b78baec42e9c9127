"""Poincare sections: where trajectories cross a plane, or are at equal times."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics import html
from liouville._basics.arguments import MOST_STEPS, amount, check_memory, interval
from liouville._basics.errors import IntegrationError, Suggesting, hinted
from liouville._basics.progress import Progress
from liouville._methods import VolumeSplitting
from liouville._runs.choice import runner_of
from liouville._runs.execute import advance, execute, explain, failures_of
from liouville._runs.runner import Request
from liouville._solution.failure import Failure, counted_on, summary_of
from liouville._solution.points import Points
from liouville._solution.solution import Array
from liouville._studies import planes
from liouville._systems import Field
from liouville._systems.events import Event, named

if TYPE_CHECKING:
    import xarray

    from liouville._methods.planner import FieldPlan
    from liouville._runs.fields.field import FieldRunner

#: Times are counted in periods to roundoff.
ROUNDOFF = 1e-9


@dataclass(frozen=True, eq=False)
class Section(Suggesting):
    """The points where trajectories cross a plane, in the order of members, then of time.

    Attributes
    ----------
    x : ndarray, shape (K, n)
        The points, on the plane to roundoff.
    t : ndarray, shape (K,)
        When.
    member : ndarray of int, shape (K,)
        Of which trajectory.
    members : int
        How many trajectories there were.
    names : tuple of str
        The coordinates.
    plane : tuple of ndarray and float
        Normal and offset.
    period : float or None
        Distance of the parallel planes, if there are many.
    direction : str
        ``"both"``, ``"up"`` or ``"down"``.
    method : str
        The method, as its repr.
    status : str
        ``"done"``, or ``"interrupted"`` or ``"failed"`` with what was found before.
    failures : dict of int to Failure
        Members that failed, with the step, its time and why; their crossings are those before.
    events : dict of str to Points
        The points of other events, by name.
    endings : dict of int to str
        Members that an event ended, with which and when; their crossings are those before.
    """

    x: Array
    t: Array
    member: np.ndarray
    members: int
    names: tuple[str, ...]
    plane: tuple[Array, float]
    method: str
    period: float | None = None
    direction: str = "both"
    status: str = "done"
    failures: dict[int, Failure] = field(default_factory=dict)
    events: dict[str, Points] = field(default_factory=dict)
    endings: dict[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return how many crossings there are."""
        return self.t.size

    def to_xarray(self) -> xarray.Dataset:
        """Give the points as an xarray ``Dataset``, along the dimension ``crossing``."""
        from liouville._solution import export

        return export.section_to_xarray(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the points for other programs, to NetCDF (``.nc``) or a table (``.csv``)."""
        from liouville._solution import export

        export.save_section(self, path)

    def _repr_html_(self) -> str:
        """Show a table of the crossings in a notebook."""
        rows = [(name, *html.described(getattr(self, name))) for name in ("x", "t", "member")]
        return html.table(repr(self), rows, ("", "shape", "first and last"))

    def __repr__(self) -> str:
        """Return how many crossings of how many trajectories, and how many of these failed."""
        ended = f", {len(self.endings)} ended by events" if self.endings else ""
        failed = f", {len(self.failures)} failed" if self.failures else ""
        found = amount(len(self), "crossing")
        crossings = f"{found} of {amount(self.members, 'trajectory', 'trajectories')}"
        return f"<Section {self.status}: {crossings}{ended}{failed}>"


def section(
    system: Field,
    method: VolumeSplitting | FieldPlan | str = "auto",
    *,
    t: tuple[float, float],
    plane: str | ArrayLike | Callable[..., Any],
    offset: float = 0.0,
    period: float | None = None,
    direction: str = "both",
    h: float | None = None,
    steps: int | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
    threads: int | None = None,
    events: Mapping[str, Event | Callable[..., Any]] | None = None,
    x: ArrayLike,
) -> Section:
    r"""Find where trajectories cross the plane :math:`a \cdot x = c`, without keeping their states.

    A crossing is between two steps; it is found by one more step from the first of them, of a part
    of h, with the same method. The points have the accuracy of the method and lie on the plane to
    roundoff. Two crossings of one plane within a step are not seen; of parallel planes each is.

    Parameters
    ----------
    system, method, t, h, steps, params, progress, threads
        As for :func:`liouville.ensemble`.
    plane : str, callable or array_like, shape (n,)
        The name of a coordinate, or the normal a; or a function :math:`s(t, x, params)` of which
        the surface :math:`s = c` is meant: it is an :class:`Event`, with two crossings seen within
        a step, and members are not in lock-step. Or ``"t"`` for the states at the times
        :math:`c + k T` of the field within the run, with ``period`` T: the strobe map of a driven
        field. The steps are then the longest up to h of which a period is a whole number.
    offset : float, default 0
        The c of the plane.
    period : float, optional
        Distance of parallel planes that are all meant, such as :math:`2 \pi` for an angle.
    direction : {"both", "up", "down"}
        Whether :math:`a \cdot x` must grow or fall in the order of the run, also of one backwards
        in time. Times have no direction.
    events : mapping of str to Event or callable, optional
        Other events, as for :func:`liouville.ensemble`: a terminal one ends its trajectory, such as
        one that leaves a basin or comes near a singularity. Members are not in lock-step then.
    x : array_like, shape (P, n)
        Starts of P trajectories.

    Returns
    -------
    Section
        The points, their times and members.

    Raises
    ------
    TypeError, ValueError
        As for :func:`liouville.ensemble`, or there is no such plane.
    IntegrationError
        All members failed; ``error.section`` is what was found before.

    References
    ----------
    :cite:t:`henon1982`; the zero is found as by :cite:t:`oliveira2020`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import euler_top
    >>> found = lv.section(
    ...     euler_top.system, lv.VolumeSplitting(), t=(0, 9), h=0.1, plane="m1", x=[[0.3, 0.2, 1]]
    ... )
    >>> bool(abs(found.x[:, 0]).max() < 1e-14)
    True
    """
    if not isinstance(system, Field):
        raise TypeError(f"sections must be those of a field without divergence, not of {system!r}")
    if (h is None) == (steps is None):
        raise TypeError("a section takes either h or steps")
    t, h = system.in_time(t), system.in_time(h)
    interval(t)
    from liouville._methods.splitting import to_core
    from liouville._runs.fields.field import FieldRunner

    cuts, names, others = planes.cuts(offset, period, direction), system.coordinates, named(events)
    if planes.SURFACE in others:
        raise ValueError(
            f"'{planes.SURFACE}' is the event of the section itself: give it another name"
        )
    is_strobe = isinstance(plane, str) and plane == "t" and "t" not in names
    if is_strobe and others:
        hint = "lv.ensemble(..., t_eval=times, events=...) has states at given times"
        raise ValueError(hinted("events= is for planes and surfaces, and plane='t' is none", hint))
    normal = np.zeros(len(names)) if callable(plane) or is_strobe else planes.normal(plane, names)
    surface = plane if callable(plane) else planes.level(normal, cuts) if others else None
    own = surface if surface is None else planes.event(surface, cuts, direction, callable(plane))
    request = Request(
        t=t, h=h, steps=steps, every=MOST_STEPS, params=params, threads=threads, start={"x": x},
        events=None if own is None else own | others, is_ensemble=True,
    )  # fmt: skip
    runner = runner_of(system, method, request)
    assert isinstance(runner, FieldRunner)
    if is_strobe:
        return _with_some_left(_strobed(runner, request, cuts, progress))
    job = runner.job if own else replace(runner.job, observer=(normal, *cuts))
    made = runner.steps
    run = _core.run(to_core(runner.split), runner.choice.method, job)
    outcome = run if isinstance(run, dict) else advance(run, runner, progress)
    rows, points, endings = np.empty((0, 2 + len(names))), dict[str, Points](), dict[int, str]()
    if not isinstance(run, dict):
        _, rows = run.take()
        if own:
            points, endings = runner.events(run)
            met = points.pop(planes.SURFACE)
            rows = np.column_stack([met.member, met.t, met.x])
            rows = rows if callable(plane) else rows[planes.is_on(rows[:, 2:] @ normal, cuts)]
    failures = {} if isinstance(run, dict) else failures_of(run, runner)
    forwards = np.sign(made.t1 - made.t0)
    order = np.lexsort((forwards * rows[:, 1], rows[:, 0]))
    found = Section(
        x=rows[order, 2:], t=rows[order, 1], member=rows[order, 0].astype(np.int64),
        members=runner.members[0], names=names, plane=(normal, cuts[0]), method=runner.method,
        period=cuts[1], direction=direction,
        status="failed" if isinstance(outcome, dict) else outcome, failures=failures,
        events=points, endings=endings,
    )  # fmt: skip
    if isinstance(outcome, dict):
        raise _failed(found, outcome, runner)
    return _with_some_left(found)


def _failed(found: Section, outcome: dict[str, Any], runner: FieldRunner) -> IntegrationError:
    """Return the error of a run of all members."""
    message, quantity = explain(outcome, runner)
    return IntegrationError(
        message, t=outcome.get("start", runner.steps.t0), step=outcome.get("step", 0),
        quantity=quantity, member=outcome.get("member"), section=found,
    )  # fmt: skip


def _with_some_left(found: Section) -> Section:
    """Return the section, unless all members failed."""
    if len(found.failures) == found.members:
        member, failure = next(iter(found.failures.items()))
        raise IntegrationError(
            summary_of(found.failures, found.members), t=failure.t, step=failure.step,
            member=member, section=replace(found, status="failed"),
        )  # fmt: skip
    return found


def _strobed(
    runner: FieldRunner,
    request: Request,
    cuts: tuple[float, float | None, int],
    progress: Progress,
) -> Section:
    """Return the states at equal times, by runs of which these are ends of steps."""
    offset, period, direction = cuts
    if period is None:
        sentence = "period= is missing: the distance of the times that are wanted"
        raise ValueError(hinted(sentence, "that of the drive, such as 2 * np.pi / omega"))
    if direction:
        raise ValueError(hinted("times have no direction", "leave direction= out"))
    steps, many = runner.steps, runner.members[0]
    wanted = abs(steps.t1 - steps.t0) / period
    check_memory(
        f"keeping {wanted:.3g} points of {many} trajectories", wanted * runner.x.nbytes,
        "give a longer period=, or a shorter run",
    )  # fmt: skip
    sign = math.copysign(1.0, steps.t1 - steps.t0)
    each = max(math.ceil(period / abs(steps.mean(steps.t1, steps.count)) - ROUNDOFF), 1)
    first = math.floor(sign * (steps.t0 - offset) / period + ROUNDOFF) + 1
    last = math.floor(sign * (steps.t1 - offset) / period + ROUNDOFF)
    times = offset + sign * period * np.arange(first, last + 1)
    x, alive = np.full((times.size, many, len(runner.system.coordinates)), np.nan), np.arange(many)
    start, begin, made, status = runner.x[:, : x.shape[-1]], steps.t0, 0, "done"
    failures: dict[int, Failure] = {}
    # the first of these times is less than a period away, the others follow each other
    lead = abs(times[0] - begin) / period if times.size else 0.0
    stepped, total = 0, max(math.ceil(lead * each - ROUNDOFF), 1) + each * (times.size - 1)
    while made < times.size and alive.size and status == "done":
        # up to the first of these times, and from there to the last
        lead = abs(times[made] - begin) / period
        is_whole = abs(lead - 1) < ROUNDOFF
        count = times.size - made if is_whole else 1
        pace = each if is_whole else max(math.ceil(lead * each - ROUNDOFF), 1)
        own = {k: np.asarray(v)[alive] for k, v in runner.params.items() if k in runner.varied}
        found = execute(
            type(runner)(
                runner.base, runner.choice,
                replace(
                    request, t=(begin, times[made + count - 1]), h=None, steps=count * pace,
                    rtol=None, every=pace, params={**runner.params, **own}, start={"x": start},
                ),
            ),
            progress,
        )  # fmt: skip
        for place, failure in found.failures.items():
            message = counted_on(failure.message, failure.step, count * pace, stepped, total)
            whole = replace(failure, step=stepped + failure.step, message=message)
            failures[int(alive[place])] = whole
        stepped += count * pace
        x[made : made + len(found.x) - 1, alive] = found.x[1:]
        status = "done" if found.status == "partly failed" else found.status
        is_left = np.isfinite(found.x[-1]).all(axis=-1)
        start, alive = found.x[-1][is_left], alive[is_left]
        begin, made = float(found.t[-1]), made + len(found.x) - 1
    member, time = np.nonzero(np.isfinite(x).all(axis=-1).T)
    return Section(
        x=x[time, member], t=times[time], member=member, members=many,
        names=runner.system.coordinates, plane=(np.zeros(x.shape[-1]), offset),
        method=runner.method, period=period, status=status, failures=failures,
    )  # fmt: skip
