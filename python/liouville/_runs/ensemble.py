"""Many members at once: in lock-step lanes, on many threads, or on an executor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted
from liouville._basics.options import by_name, started
from liouville._basics.progress import Progress
from liouville._methods import Method
from liouville._runs.choice import runner_of
from liouville._runs.execute import checked, plain
from liouville._runs.runner import Request
from liouville._solution.solution import Solution
from liouville._systems import Mechanics, Schrodinger, System

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from liouville._methods.planner import Plan


@by_name
def ensemble(
    system: System,
    method: Method | Plan | str = "auto",
    *,
    t: Sequence[Any] | NDArray[Any],
    h: float | None = None,
    steps: int | None = None,
    every: int = 1,
    t_eval: ArrayLike | None = None,
    release: ArrayLike | None = None,
    events: Mapping[str, Any] | None = None,
    observe: Mapping[str, Any] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    states: bool = True,
    tangents: Mapping[str, Any] | None = None,
    progress: Progress = None,
    threads: int | None = None,
    executor: Executor | None = None,
    chunk: int | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> Solution:
    """Integrate a system from many start values at once, in lock-step lanes and on many threads.

    All members take the same steps, and each has the same bits as a run of its own by the same
    method, whatever the other members are and however many threads there are. What a
    ``VolumeSplitting`` leaves open is chosen by trial runs from the starts, so from those of all
    members here and from its own in a run alone: they then differ by the error of the method. One
    plan for all of them, by :func:`plan`, gives the same bits. A member that fails is put down in
    ``failures``, and the others go on. Members with contacts run one after another, each in modes
    of its own, with records at the same times.

    Parameters
    ----------
    system : System
        A Lagrangian, Hamiltonian, Mechanical, Structure, SemiExplicit, PolynomialField,
        GriddedField, PotentialField, ChargedParticles or Schrodinger: what is integrated.
    method : Method, Plan or str, default "auto"
        How: any method for the system, with steps of equal size; names as for :func:`integrate`.
    t, h, steps, every, t_eval, events, observe, states
        As for :func:`integrate`; with events, and on constraints with `t_eval`, members are not in
        lock-step. What is kept of all members is what takes memory: ``every=steps`` keeps starts
        and ends, ``states=False`` only invariants and `observe`.
    release : array_like, shape (P,), optional
        Times of release of the members of a field, from the start of the run to before its end, or
        dates: a member begins there with its start values, and what it has before is NaN. All end
        together, each by equal steps. Drifts of invariants are counted from its own release, where
        tangents begin, too, and which the direction ``t0`` moves.
    params : mapping, optional
        Parameters that differ from the defaults. They may have a further, first axis of members: a
        number as shape (P,), a vector of j numbers as (P, j). Fields of such members are split
        alike, and are not in lock-step; one with fewer terms, as where a parameter is 0, is split
        by itself, by the same method. Wave functions are each planned as alone, and may then begin
        with one state, of shape (N,).
    tangents : mapping of str to array_like, optional
        As for :func:`integrate`, the same directions for all members, of which each then runs by
        itself: derivatives have the member as their second axis. Wave functions keep what these
        take of all members until the end.
    progress : bool or callable, optional
        True shows a bar, on a terminal or in a notebook. A function is called about twenty times a
        second, ``progress(done, total)``, with numbers of steps; of members with an executor.
    threads : int, optional
        At most and by default as many as this process has processors, and one in each worker of an
        executor; no more than there are blocks of members. The result does not depend on them, bit
        for bit.
    executor : concurrent.futures.Executor, optional
        Whose workers integrate the members, on this machine or others; see
        :doc:`/guide/cluster`. The result has the same bits.
    chunk : int, optional
        Members a worker is given at a time; by default a quarter of its share.
    start, **values : mapping, or array_like by name
        Start values by the system's names, with a row for each of P members: ``q`` and ``v`` of
        shape (P, n), and so on. Those of a mechanical or semi-explicit system may also have shape
        (n,), for all members alike, as may ``x`` where parameters have rows; ``z`` of the latter,
        of shape (P, l), is a guess that may be left out. Beside `psi` a Grid or a Lattice may be
        given a ``potential`` for each member, of shape (P, N) or in its own shape after P, in place
        of the one it has.

    Returns
    -------
    Solution
        Its arrays have the member as their second axis: ``q`` of shape (k, P, n), invariants of
        shape (k, P). After the step at which a member failed, or which it did not come to before
        an interrupt (Ctrl-C), its values are NaN, as after an event that ended its run. Where some
        members failed, its status is "partly failed" and its message has their numbers; where all
        did, "failed".
        :meth:`Solution.member` gives one of them, and ``for`` goes through them.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As for :func:`integrate`.
    IntegrationError
        The start of no member can be taken, or, of a run with tangents as for :func:`integrate`,
        one is at a kink or passes over a jump.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import euler_top
    >>> many = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.1]]
    >>> lv.ensemble(euler_top.system, lv.VolumeSplitting(), t=(0, 1), steps=10, x=many).x.shape
    (11, 2, 3)
    """
    given = started(start, values)
    request = Request(
        t=t, h=h, steps=steps, every=every, t_eval=t_eval, events=events, observe=observe,
        params=params, states=states, tangents=tangents, threads=threads, start=given,
        is_ensemble=True,
    )  # fmt: skip
    if release is not None:
        # imported here: few ensembles have times of release
        from liouville._runs import released

        released.check_releases(system)
        if executor is None:
            return released.released(system, method, request, release, progress)
    if isinstance(system, Mechanics) and system.contacts is not None:
        if executor is not None:
            raise TypeError("executor= is not for ensembles with contacts")
        # imported here: few systems have contacts
        from liouville._runs import contacts

        return contacts.ensemble(system, method, request, progress)
    runner = runner_of(system, method, request)
    at = None if release is None else released.times_of(runner, release)
    if executor is None:
        if chunk is not None:
            raise TypeError("chunk is for an executor: give executor= too")
        return checked(runner, request, progress)
    if tangents is not None:
        hint = "leave executor= out: threads of this process take the members"
        raise TypeError(hinted("an ensemble on an executor has no tangents", hint))
    if events or t_eval is not None:
        hint = "leave executor= out: threads of this process take the members"
        what = "events" if events else "states at given times"
        raise TypeError(hinted(f"an ensemble on an executor has no {what}", hint))
    from liouville._runs.distribute import Task, distribute

    part = partial(
        ensemble, runner.system, runner.choice, t=t, h=h, steps=steps, every=every, states=states,
        observe=runner.system.portable(observe), threads=threads or 1,
    )  # fmt: skip
    if isinstance(system, Schrodinger) and not system.is_many(given["psi"]):
        given["psi"] = np.ravel(given["psi"])  # one for all members has no axis of them
    task = Task(
        part,
        _arrays(given),
        _arrays(params) if runner.system is system or runner.varied else None,
        system.params,
        runner.members[0],
        (runner.steps.count // runner.every + 2) * runner.row,
        runner.steps.t0,
        at,
    )
    found = distribute(task, executor, chunk, progress)
    # the method of a chunk may be planned for its members
    method, own = runner.method, plain(runner.params)
    return replace(found, system=runner.system, method=method, params=own)


def _arrays(given: Any) -> Any:
    """Return start values or parameters as arrays, made once for all chunks."""
    if isinstance(given, Mapping):
        return {name: _arrays(x) for name, x in given.items()}
    return None if given is None else np.asarray(given)
