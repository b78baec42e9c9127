"""The result of a run: times, states, invariants, residuals, and its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import html
from liouville._basics.arguments import Named, amount
from liouville._solution import parts
from liouville._solution.computed import Computed
from liouville._solution.contacts import ContactRecord, counts_of
from liouville._solution.drifts import Drifts, worst
from liouville._solution.exports import Exports
from liouville._solution.failure import Failure
from liouville._solution.motions import Motions
from liouville._solution.points import Points
from liouville._solution.states import States, Stats
from liouville._solution.tangents import Tangent
from liouville._systems import System

Array = NDArray[Any]

#: What a solution has by names, which a KeyError lists.
NAMED = (
    "states",
    "invariants",
    "residuals",
    "observed",
    "angles",
    "names",
    "balance",
    "events",
    "tangents",
)

#: All residuals that a solution may have, in their order.
RESIDUALS = ("constraint", "hidden", "nonholonomic")


@dataclass(frozen=True, eq=False, repr=False)
class Solution(States, Drifts, Computed, Exports, Motions):
    r"""A run's result: arrays with time as the first axis, and the record of how it went.

    Below, k is the number of kept steps, n of coordinates and m of constraints, l of them
    nonholonomic. In an ensemble of P members, every array but ``t`` has the member as its second
    axis: ``x`` has shape (k, P, n). All arrays are read-only, all numbers in the system's units.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Times of the kept steps: the start, one step in ``every``, and always the last step.
    states : dict of str to ndarray
        ``q``, ``v``, ``p`` of shape (k, n) and ``lam`` of shape (k, m); a ``Mechanical`` system has
        ``y`` and ``z`` in the place of ``q``, a ``SemiExplicit`` one nothing besides these, a
        ``PolynomialField`` has ``x``, a ``Schrodinger`` equation has ``psi``, complex. Methods of
        the alpha family add ``acceleration`` and their own ``a``. Empty if the run stored no
        states. Each is also an attribute: ``solution.q``.
    invariants : dict of str to ndarray, shape (k,)
        Energy and the system's own invariants, by name; the norm of a wave function.
    initial : dict of str to float, or ndarray of shape (P,)
        The invariants at the start of a run that keeps no record of it, as with ``t_eval=[7.3]``;
        empty where the first record is the start.
    residuals : dict of str to ndarray, shape (k, m - l)
        ``constraint`` is :math:`g(t, q)`, ``hidden`` is :math:`g_t + g_q v`; ``nonholonomic``, of
        shape (k, l) and only where there are such constraints, is :math:`k(t, q, v)`.
    observed : dict of str to ndarray, shape (k,) or (k, j)
        The quantities of ``observe=``, by name; of a wave function also its complex
        ``autocorrelation``, :math:`\langle \psi(0) | \psi(t) \rangle`.
    angles : dict of str to ndarray, shape (k,)
        Of an assembly the angles of joints that no coordinate counts, as ``"A.angle"``, continuous
        over turns since the start of the run; NaN from where a step was too long to count them.
    balance : dict of str to ndarray, shape (k,)
        Where the energy of a Lagrangian or a Structure went, if the method records it: ``work``
        and ``dissipated``, which are attributes too. Empty otherwise.
    error : dict of str to ndarray, shape (k, n)
        Estimates of the errors of the states, by
        :func:`~liouville.analysis.extrapolate`; empty otherwise.
    events : dict of str to Points
        Where the functions of ``events=`` changed their sign, by name, with the states there; of an
        ensemble those of one member after another.
    contacts : dict of str to ContactRecord
        What the contacts of a system did, by name: modes, gaps, forces and changes.
    dense_order : int
        The order of the method, where the states of all steps are kept and the system is a
        mechanical or semi-explicit one: then ``solution(t)`` gives the states between them, of an
        ensemble ``solution.member(i)(t)``. 0 otherwise.
    choice : Method or None
        The method itself, which makes them; None where there are none, and after
        :func:`liouville.load`.
    names : dict of str to tuple of str
        ``coordinates`` (n of them) and ``constraints`` (m of them, the nonholonomic ones last); of
        a ``SemiExplicit`` system also its ``unknowns`` z.
    h : float
        Step size used, the mean of them if they are controlled.
    tolerances : dict of str to float or list of float
        ``rtol`` and ``atol`` of controlled steps; empty if the steps are equal.
    method : str
        The method, as its repr.
    stats : dict
        Numbers of the run. Of all: ``steps`` made and ``seconds`` taken. Of mechanical and
        semi-explicit systems: ``iterations``, the corrections of the equations of a step;
        ``evaluations`` of the forces, one for each stage; ``cold_starts``, steps whose extrapolated
        start failed. With ``Spark`` and ``LobattoPair`` the ``solver``, or both by which steps
        were made, and ``newton_steps``, how often the full simplified Newton iteration was begun,
        for a step or a part of one; with RATTLE and the alpha family
        ``factorizations`` of Newton matrices, which may serve several steps. Of controlled steps
        ``rejected``, those made again, and ``h_smallest``, ``h_largest`` and ``h_next``, the step
        to go on with. Of fields: ``flows`` of pieces, and how many ``pieces`` there are. Of wave
        functions: ``products``, those :math:`H \psi` that the steps took (two real ones each),
        ``widened``, how often bounds of the energies had to be, and ``bound``, that of the error,
        known before the run: of splittings and Chebyshev series of an H without time, and of
        series in time that are power series, but of no ``Lanczos``, ``Magnus`` or
        ``SplitOperator``; ``absorbed``, the part of the norm that an absorber took. An ensemble has
        the sums of its members, whatever computes them: those of a member are those of a run of its
        own, and end where it fails. But it has ``steps`` and ``pieces`` of the member with most,
        ``products`` of each on average, and the largest ``bound``.
    params : dict of str to float or list of float
        Parameters the run used.
    varied : tuple of str
        The parameters of an ensemble that have a value for each member, along their first axis.
    changing : tuple of str
        Which of the invariants the model itself changes: the energy where a force that has no
        potential, damping, or time has a part in it.
    units : dict of str to str
        Units of axes and tables, by ``with_units``, else empty.
    status : str
        ``"done"``, ``"failed"`` or ``"interrupted"``, with all up to the last good step; of an
        ensemble some of whose members failed ``"partly failed"``.
    message : str
        Why it is not done, of an ensemble which members failed, or which event ended it; and where
        an energy that nothing drives changed by more than its own size, jumped, or rose though it
        can only fall, among what is kept: steps were too large. Else empty.
    members : int or None
        Number P of members of an ensemble, None for a single run.
    failures : dict of int to Failure
        Members of an ensemble that failed, in their order, with the step, its time and why; what
        they have after it is NaN.
    endings : dict of int to str
        Members of an ensemble that an event ended, with which and when; what they have after it is
        NaN.
    tangents : dict of str to Tangent
        Derivatives of the states in the directions of ``tangents=``, by name:
        ``solution.tangents["params.l"].q``.
    reactions : ndarray, shape (k, n), or None
        The reaction forces of a solution that was loaded; :meth:`reaction` gives them.
    system : System or None
        The system integrated; None after :func:`liouville.load`.
    stretches : tuple of (Solution, ndarray)
        Of a run with contacts that keeps all steps its smooth stretches, and the places of the
        constraints of the system itself among those of each; ``solution(t)`` asks them. Pickles and
        files do not keep them.
    path : str or None
        Where all records are, of a run with ``store=``: then only the first and the last are here.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> solution = lv.integrate(pendulum.system, lv.Spark(3), t=(0, 1), h=0.1, **pendulum.start)
    >>> solution.status, solution.q.shape, solution.names["coordinates"]
    ('done', (11, 2), ('x', 'y'))
    >>> solution([0.25, 0.75]).q.shape
    (2, 2)
    """

    t: Array
    states: dict[str, Array]
    invariants: dict[str, Array]
    residuals: dict[str, Array]
    observed: dict[str, Array]
    names: dict[str, tuple[str, ...]]
    h: float
    method: str
    stats: Stats
    initial: dict[str, Any] = field(default_factory=dict)
    params: dict[str, Any] = field(default_factory=dict)
    angles: dict[str, Array] = field(default_factory=dict)
    balance: dict[str, Array] = field(default_factory=dict)
    tolerances: dict[str, Any] = field(default_factory=dict)
    error: dict[str, Array] = field(default_factory=dict)
    events: dict[str, Points] = field(default_factory=dict)
    contacts: dict[str, ContactRecord] = field(default_factory=dict)
    dense_order: int = 0
    choice: Any = None
    units: dict[str, str] = field(default_factory=dict)
    status: str = "done"
    message: str = ""
    members: int | None = None
    failures: dict[int, Failure] = field(default_factory=dict)
    endings: dict[int, str] = field(default_factory=dict)
    varied: tuple[str, ...] = ()
    changing: tuple[str, ...] = ()
    tangents: dict[str, Tangent] = field(default_factory=dict)
    reactions: Array | None = None
    system: System | None = None
    stretches: tuple[tuple[Solution, Array], ...] = ()
    path: str | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only: what is recorded is not edited."""
        for group in NAMED:
            object.__setattr__(self, group, Named(getattr(self, group)))
        self.t.setflags(write=False)
        if self.reactions is not None:
            self.reactions.setflags(write=False)
        for group in parts.GROUPS:
            for values in getattr(self, group).values():
                values.setflags(write=False)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the stretches, which are systems of their own."""
        return self.__dict__ | ({"stretches": (), "dense_order": 0} if self.stretches else {})

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickle, its arrays read-only."""
        self.__dict__.update(state)
        self.__post_init__()

    def __repr__(self) -> str:
        """Return how the run went, how well it kept what it should, and its message."""
        message = [line for line in self.message.split("\n") if line]
        if self.endings:
            message.append(f"events ended {len(self.endings)} of {self.members} members")
        if not self.t.size:
            lines = [f"<Solution {self.status}: nothing computed, {self.method}", *message]
            return "\n ".join(lines) + ">"
        if self.path is not None:
            lines = [f"<Solution {self.headline}", f"its records are in {self.path!r}", *message]
            return "\n ".join(lines) + ">"
        residuals = {name: self._largest(np.abs(r)) for name, r in self.residuals.items() if r.size}
        drifts: dict[str, float] = {}
        changes: dict[str, float] = {}
        for name in self.invariants:
            group = changes if name in self.changing else drifts
            group[name + self.drift_words(name)] = self._largest(self.invariant_drift(name))
        kept = [*worst("worst residual", residuals), *worst("worst drift", drifts)]
        kept += worst("largest change", changes)
        kept = [", ".join(kept)] if kept else []
        kept += [": ".join(pair) for pair in counts_of(self.contacts)]
        lines = [f"<Solution {self.headline}", *kept, *message]
        return "\n ".join(lines) + ">"

    @property
    def headline(self) -> str:
        """How the run went: status, steps, interval, members and method, in one line."""
        steps = self.stats.get("steps", len(self.t) - 1)
        span = f"t = {self.t[0]:g}" + (f" to {self.t[-1]:g}" if len(self.t) > 1 else "")
        span += "" if self.members is None else f", {amount(self.members, 'member')}"
        made = amount(steps, "step")
        return f"{self.status}: {made} of {self.step_size}, {span}, {self.method}"

    def _repr_html_(self) -> str:
        """Show a table of the arrays in a notebook."""
        return html.of_solution(self)

    def member(self, member: int) -> Solution:
        """Give one member of an ensemble as a solution of its own, without copying its arrays.

        Parameters
        ----------
        member : int
            Its number, from 0; -1 is the last.

        Returns
        -------
        Solution
            With its own parameters, status and message. Of a member that failed, or that an
            interrupt stopped, it has the rows up to its last good step.

        Raises
        ------
        ValueError
            There is no such member, or this is a single run.
        TypeError
            The member is no integer.
        """
        return parts.member_of(self, member)

    def sel(
        self,
        *,
        time: slice | float | None = None,
        coordinate: Sequence[str] | str | None = None,
        member: int | None = None,
    ) -> Solution:
        """Select times, coordinates and a member by their labels, as ``xarray`` does.

        Parameters
        ----------
        time : slice or float, optional
            Times, both ends included, in either order; a third number keeps one state in so many:
            ``slice(0.0, 1.0)``, ``slice(None, None, 10)``. One time is that of a kept state; the
            axis stays.
        coordinate : sequence of str, or str, optional
            Names of the coordinates to keep, or the one; the axis stays.
        member : int, optional
            A member of an ensemble, as :meth:`member` gives it.

        Returns
        -------
        Solution
            Its arrays are views of the same memory, but for coordinates that do not follow one
            another. Drift is measured from the start of the run all the same, and invariants,
            multipliers and residuals are of all coordinates.

        Raises
        ------
        ValueError
            No kept state is at these times, or there is no such coordinate.
        TypeError
            One of the two is of another kind.
        """
        found = self if member is None else parts.member_of(self, member)
        return parts.part_of(found, time, coordinate)

    def _largest(self, sizes: Array) -> float:
        """Return the largest value, of those members that have come so far."""
        if self.members is not None and (self.failures or self.endings or self.status != "done"):
            sizes = sizes[~np.isnan(sizes)]
        return float(np.max(sizes, initial=0.0))

    @property
    def step_size(self) -> str:
        """The step size in words: "h = 0.01", or "mean h = 0.01" of controlled steps."""
        return f"{'mean ' if self.tolerances else ''}h = {self.h:.6g}"
