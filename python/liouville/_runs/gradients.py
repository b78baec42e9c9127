"""Gradients of functions of a run, by everything that the run depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import kept
from liouville._basics.errors import IntegrationError, hinted, misshapen
from liouville._basics.options import started
from liouville._basics.progress import Progress
from liouville._methods import Method
from liouville._methods.control import Control
from liouville._runs.adjoint import EVENTS, INVARIANTS, OBSERVED, Adjoint, Gradients
from liouville._runs.choice import check_system, runner_of
from liouville._runs.execute import execute
from liouville._runs.runner import Request
from liouville._solution.solution import Solution
from liouville._systems import Field, Mechanics, Schrodinger, SemiExplicit, members


class Pullback:
    r"""The transpose of a run's derivative: from cotangents of its states to gradients.

    It is called with cotangents by the names of the states, ``q``, ``v`` and ``lam`` of a
    Lagrangian: the derivatives of some scalar by these arrays of the solution, of the same shapes.
    It returns the derivatives of that scalar by everything in `wrt`. Those by times of events and
    by the states there are ``events={"name": {"t": ..., "q": ...}}``, ``"x"`` of fields, those by
    invariants of a mechanical or semi-explicit system ``invariants={"energy": ...}``.

    Cotangents of an ensemble have the member as their second axis, as its solution has, and its
    gradients have it as their first. Those of events are rows as in ``solution.events``, of one
    member after another; behind the end of a member's run they are zero. Members are pulled back
    in lock-step where they run so, without events, given times and cases of the model, otherwise
    one by one, from runs with the same bits, on as many threads as :func:`vjp` was given; wave
    functions from the run of all, where what it leaves fits in memory.

    On constraints the run records its steps, at most 64 MiB of them, and the first call follows
    these back. All others are made again from checkpoints, at most the square root of the number of
    steps of them, so a call takes up to one more run, and as much again and somewhat more for the
    transposed steps. Memory grows with that root. On constraints steps behind the last cotangent
    that is not zero are left out: what has no derivative there, as hits that accumulate, does not
    matter.

    A cotangent of ``psi`` is complex: with F a real function of the states kept, it is the array c
    for which :math:`dF = \operatorname{Re} \langle c | d\psi \rangle`, such as
    :math:`2 A \psi` for :math:`F = \langle \psi | A | \psi \rangle` and
    :math:`2 \varphi \langle \varphi | \psi \rangle` for
    :math:`F = |\langle \varphi | \psi \rangle|^2`. The gradient by a start ``psi`` is complex in
    the same way. Those of what `observe` named are ``observed={"name": ...}``, in the shapes of
    ``solution.observed``, and complex where it is. States at the starts of windows are kept by the
    run, the terms of a window are made again.

    Attributes
    ----------
    wrt : tuple of str
        What gradients are by.
    adjoint : Adjoint
        The part of it that the family of the system has.
    """

    def __init__(self, adjoint: Adjoint, solution: Solution) -> None:
        self.wrt, self.adjoint, self._solution = adjoint.wrt, adjoint, solution
        self._shapes = adjoint.shapes(solution)

    @property
    def states(self) -> tuple[str, ...]:
        """The states that have cotangents."""
        others = EVENTS, INVARIANTS, OBSERVED
        return tuple(name for name in self._shapes if not name.startswith(others))

    def __repr__(self) -> str:
        """Name what it takes and what it gives."""
        return f"<Pullback of {', '.join(self._shapes)} to {', '.join(self.wrt)}>"

    def __call__(self, **cotangents: Any) -> Gradients:
        """Pull cotangents of states, events, invariants and observables back.

        See :class:`Pullback`.

        Raises
        ------
        TypeError, ValueError
            There is no such state, or a cotangent has another shape or is not finite.
        IntegrationError
            A step cannot be differentiated, or one that cotangents depend on begins at a kink of
            the model or passes over a jump of its equations that moves.
        KeyboardInterrupt
            It was interrupted (Ctrl-C); it may be called again.
        """
        events = cotangents.pop("events", {})
        given = [events, *events.values()] if isinstance(events, Mapping) else [None]
        if not all(isinstance(x, Mapping) for x in given):
            hint = 'write events={"name": {"t": ...}}'
            raise TypeError(hinted("cotangents of events are mappings of their states", hint))
        of_events = {f"{EVENTS}{e}.{x}": y for e, own in events.items() for x, y in own.items()}
        named = cotangents | of_events
        for prefix, example in ((INVARIANTS, "energy"), (OBSERVED, "x")):
            group = prefix[:-1]
            own = named.pop(group, {})
            if not isinstance(own, Mapping):
                hint = f'write {group}={{"{example}": ...}}'
                sentence = f"cotangents of {group} are a mapping of their names"
                raise TypeError(hinted(sentence, hint))
            named |= {f"{prefix}{name}": x for name, x in own.items()}
        return self.adjoint.pulled(self._solution, self._checked(named))

    def _checked(self, cotangents: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
        """Return cotangents of all states, zero where none is given."""
        known = ", ".join(self._shapes)
        if not cotangents:
            raise TypeError(hinted("no cotangents are given", f"there are {known}"))
        for name in cotangents:
            if name not in self._shapes:
                sentence = f"there is no cotangent of '{name}'"
                raise TypeError(hinted(sentence, f"there are {known}"))
        is_complex, parts = self.adjoint.is_complex, {}
        kinds, kind = ("iufc", "complex") if is_complex else ("iuf", "real")
        for name, shape in self._shapes.items():
            try:
                value = np.asarray(cotangents[name]) if name in cotangents else np.zeros(shape)
            except ValueError:  # of rows of several lengths
                value = np.empty(0, dtype=object)
            if np.ma.is_masked(cotangents.get(name)):
                sentence = f"the cotangent of '{name}' has masked numbers"
                hint = "give zeros where nothing is to be pulled back: x.filled(0)"
                raise TypeError(hinted(sentence, hint))
            if value.dtype.kind not in kinds:
                sentence = f"the cotangent of '{name}' must be an array of {kind} numbers"
                raise TypeError(f"{sentence}, not of {value.dtype}")
            if value.shape != shape:
                hint = "it is that of the solution's array"
                raise misshapen(f"the cotangent of '{name}'", value.shape, shape, hint)
            if not np.isfinite(value).all():
                raise ValueError(f"the cotangent of '{name}' must be finite")
            parts[name] = value.astype(complex if is_complex else float)
        return parts


def vjp(
    system: Mechanics | SemiExplicit | Field | Schrodinger,
    method: Method | str = "auto",
    *,
    wrt: Sequence[str],
    t: Sequence[Any] | NDArray[Any],
    h: float | None = None,
    steps: int | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    control: Control | None = None,
    every: int = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Any] | None = None,
    observe: Mapping[str, Any] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
    threads: int | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> tuple[Solution, Pullback]:
    r"""Integrate a system, and return the run's pullback beside its solution.

    The gradient of a scalar function of the kept states by any number of parameters takes one call
    of the pullback; see :doc:`/theory/adjoint`.

    Starts or parameters with a row for each of P members make an ensemble, as :func:`ensemble`
    takes it. Its gradients have the member as their first axis, whether a name has a value for each
    member or one for all: the gradient of a sum over members by what they share is
    ``gradient.sum(axis=0)``.

    Parameters
    ----------
    system, method, t, h, steps, rtol, atol, control, every, t_eval, events, params, progress
        As for :func:`integrate`, and of members as for :func:`ensemble`: a mechanical or
        semi-explicit system by ``Spark``, ``LobattoPair`` or a composition of them, whose
        controlled steps are held, as are the times in `t_eval`; a mechanical one by ``HHT``,
        ``GeneralizedAlpha`` and ``ArnoldBruls`` too, whose controlled steps end at no switches; a
        field without divergence; or a Schrödinger equation by ``"auto"``, ``Chebyshev``,
        ``Magnus`` with `h` or `steps`, or splittings of a real H into shears. Bounds, windows,
        steps and the numbers of terms are held.
    wrt : sequence of str
        What gradients are by: states of the system such as ``"q"`` and ``"v"``, ``"params.name"``,
        and ``"t0"`` and ``"t1"`` where steps are equal, without contacts. Parameters of a field are
        those of its coefficients. Of a Schrödinger equation ``"psi"``, parameters of its drive and
        of the potential of a grid, ``"drive[k]"``, the samples of a drive, and ``"t0"``, ``"t1"``
        or ``"t"``, all the times that were given.
    observe : mapping, optional
        Of a Schrödinger equation observables as for :func:`integrate`; the pullback takes their
        cotangents.
    threads : int, optional
        At most and by default as many as this process has processors. They take the members of an
        ensemble in turn, or the rows of a large wave function. The result does not depend on them.
    start, **values : mapping, or array_like by name
        Start values, as for :func:`integrate` or :func:`ensemble`.

    Returns
    -------
    solution : Solution
        That of :func:`integrate` or :func:`ensemble`, bit for bit, by
        ``LobattoPair(2)`` to roundoff, through hits of contacts, where steps begin anew, to the
        error of a step; of an H that is differentiated by parameters or samples to
        the tolerance, as its series then have the terms, and its windows the ends, that derivatives
        need.
    pullback : Pullback
        Takes cotangents, ``pullback(q=..., lam=...)``, and returns a dict of gradients. Those by
        starts and parameters are of the run from the start as ``system.consistent`` moves it.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback.
    IntegrationError
        A step of any member failed, or the run was interrupted; ``error.solution`` is what was
        computed before.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> run = {"t": (0, 1), "steps": 50, "every": 50}
    >>> solution, pullback = lv.vjp(
    ...     pendulum.system, lv.Spark(2), wrt=["v", "params.g"], **run, **pendulum.start
    ... )
    >>> by = pullback(q=[[0, 0], [0, 1]])  # of the height at the end
    >>> by["v"].shape
    (2,)
    """
    check_system(system)
    if observe is not None and not isinstance(system, Schrodinger):
        hint = "functions of states have cotangents of the states, by their own derivatives"
        raise TypeError(hinted("observe= has cotangents of a Schrodinger equation alone", hint))
    # members are run again by what is given here, which the caller may change meanwhile
    t, t_eval, params, given = (kept(x) for x in (t, t_eval, params, started(start, values)))
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, atol=atol, control=control, every=every, t_eval=t_eval,
        events=events, observe=observe, params=params, start=given, has_pullback=True,
        threads=threads, is_ensemble=members.are_given(system, given, params),
    )  # fmt: skip
    if isinstance(system, Mechanics) and system.contacts is not None:
        # imported here: few systems have contacts
        from liouville._runs import contacts

        solution, own = contacts.vjp(system, method, request, wrt, progress)
        if solution.status != "done":
            raise IntegrationError(solution.message, solution=solution)
        return solution, Pullback(own, solution)
    adjoint = runner_of(system, method, request).adjoint(request, wrt)
    solution = execute(adjoint.runner, progress, adjoint.checkpoints)
    if solution.status != "done":
        raise IntegrationError(solution.message, solution=solution)
    return solution, Pullback(adjoint, solution)
