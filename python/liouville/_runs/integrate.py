"""The function that runs any system."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike, NDArray

from liouville._basics.options import by_name, started
from liouville._basics.progress import Progress
from liouville._methods import Method
from liouville._methods.control import Control
from liouville._runs.choice import runner_of
from liouville._runs.execute import checked
from liouville._runs.runner import Request
from liouville._solution.solution import Solution
from liouville._systems import Mechanics, System

if TYPE_CHECKING:
    from liouville._methods.planner import Plan
    from liouville._runs.stored import Store


@by_name
def integrate(
    system: System,
    method: Method | Plan | str = "auto",
    *,
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
    states: bool = True,
    tangents: Mapping[str, Any] | None = None,
    progress: Progress = None,
    threads: int | None = None,
    store: Store | str | os.PathLike[str] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> Solution:
    r"""Integrate a system with equal steps, or with steps of its own choice.

    Parameters
    ----------
    system : System
        The system: a Lagrangian, Hamiltonian, Mechanical, Structure, SemiExplicit, PolynomialField,
        GriddedField, PotentialField, ChargedParticles or Schrodinger.
    method : Method, Plan or str, default "auto"
        The method, or its name on the command line, such as ``"spark"``; see :doc:`/choose`.
        ``"auto"`` takes ``Spark`` for mechanics, with the stages that `rtol` wants,
        ``VolumeSplitting()`` for fields and ``SchrodingerSplitting()`` for Schrödinger equations;
        ``solution.message`` says what was taken, of a wave ``solution.method``. A plan is made by
        :func:`plan`.
    t : tuple of two floats, or sequence of float
        Start and end, in the system's unit of time; an end before the start goes backwards. A
        Schrödinger equation takes the times of all states to keep.
    h : float, optional
        Step size, positive. The step used is ``(t1 - t0) / steps`` with the least number of steps
        that makes it at most `h`. With `rtol`, the first step, or that of the trial where the alpha
        family makes reversible steps; by default the method chooses it.
        With ``control=lv.Reversible()``, the step at the start.
    steps : int, optional
        Number of steps, instead of `h`.
    rtol : float, optional
        Relative tolerance, which makes the steps controlled: the estimated error that a step adds
        to the coordinates is at most ``atol + rtol * |y|``, in the root mean square over them, and
        with ``Spark`` on Gauss points what it adds to the velocities ``rtol`` of their largest
        values; see :class:`Adaptive`. A polynomial field takes equal steps all the same, as many as
        keep the error of x within this until the end by trial runs of the whole time; `h` is the
        first step tried. A wave function's tolerance is its method's, ``tol``.
    atol : float or array_like, shape (n,), optional
        Absolute tolerance, for all coordinates or for each, in their own unit; ``rtol / 1000`` by
        default. ``solution.message`` says where that outweighs ``rtol`` times all coordinates.
    control : Adaptive or Reversible, optional
        The control of the steps: by an estimate of their error, as with `rtol` alone, or by a
        monitor of the motion. By default they are equal. ``rtol`` alone gives the alpha family
        reversible steps on conservative systems, see :doc:`/theory/steps`; ``Adaptive()`` does not.
    every : int, default 1
        Keep one state in this many; the start and the end are always kept.
    t_eval : array_like, shape (k,), optional
        Times to keep states at, in the order of the run and within it, instead of one state in
        `every`. The steps are the same; each state between them is the end of a shorter step of
        the method, of its order, with the constraints to roundoff; of a field it keeps volume. A
        time that a few roundings put beyond the end is the end. A Schrödinger equation has its
        times in `t`.
    events : mapping of str to Event or callable, optional
        Functions ``f(t, q, v, lam, params)``, of semi-explicit systems ``f(t, y, z, params)``, of
        fields ``f(t, x, params)``, whose changes of sign are wanted, by name; see :class:`Event`
        for those that have a direction, end the run, or reset its state.
    observe : mapping of str to callable, optional
        Further quantities ``f(t, q, v, params)`` (the system's own states), scalars or vectors,
        evaluated in the core at each kept step; of mechanics also ``f(t, q, v, lam, params)`` with
        multipliers, such as ``system.joint_force("A")``.
    params : mapping, optional
        Parameters that differ from the system's defaults.
    states : bool, default True
        Whether states and multipliers are kept; without them only invariants, residuals and
        observed quantities are.
    tangents : mapping of str to array_like, optional
        Directions to differentiate the run in, by name: a state of the system such as ``"q"`` or
        ``"v"``, ``"params.name"``, and ``"t0"`` or ``"t1"`` where steps are equal. Each is an array
        of the shape of that, or d of them stacked, of shape (d, n). ``solution.tangents`` has the
        derivatives of the discrete solution, to roundoff; see :doc:`/theory/adjoint`. A direction
        that leaves the constraints, such as that of a length in them, is moved onto them by the
        tangent of ``system.consistent``. Controlled steps are held, and follow errors of tangents
        too. With contacts steps are equal, and directions starts and parameters. Of mechanical
        systems by ``Spark``, ``LobattoPair`` and compositions of them and by those of the alpha
        family, of semi-explicit systems by ``"y"``, of fields without divergence by ``"x"``,
        parameters and ends, and of Schrödinger equations by ``"psi"``, parameters, samples and
        times, as for :func:`vjp`.
    progress : bool or callable, optional
        True shows a bar, on a terminal or in a notebook. A function is called about twenty times a
        second, ``progress(done, total)``, with numbers of steps, or times where steps are
        controlled.
    threads : int, optional
        Threads for one large state of a polynomial field or a Schrödinger equation: at most and by
        default as many as this process has processors. The result does not depend on them, bit
        for bit.
    store : Store or path, optional
        A ``.zarr`` folder that the records go to while the run is going on, in constant memory;
        there must be nothing there yet. A run that was cut off goes on with :func:`resume`.
        :class:`Store` says how often.
    start, **values : mapping, or array_like by name
        Start values by the system's names, each of shape (n,): ``q`` and ``v``, ``q`` and ``p``,
        ``y`` and ``z``, ``x``, or ``psi``. Of a ``SemiExplicit`` system z is a guess that may be
        left out. A dict by coordinate name is taken too, but for ``psi``. The alpha family also
        takes its own ``a``, to go on from ``solution.a[-1]`` with the same step size. With it
        ``ArnoldBruls`` takes velocities as it left them, off their constraints, and finds its
        reactions anew: it goes on to the fourth order of the step, and the others to roundoff.

    Returns
    -------
    Solution
        With k = ceil(steps / every) + 1 kept times. An interrupt (Ctrl-C) returns what was done,
        with status "interrupted". A run that an event ended is done, and its message says so.
        With `store` only the first and the last record, and where the others are: its ``path``,
        for :func:`load` or ``xarray.open_zarr``.

    Raises
    ------
    TypeError
        An argument is of the wrong kind or missing, or the method does not take this system.
    ValueError
        An argument is out of range, or the start violates the constraints.
    MemoryError
        The records, or the matrices of the method, would not fit in memory.
    IntegrationError
        A step failed; ``error.solution`` is what was computed before it. Or a run with tangents is
        at a kink of the model, or passes over a jump of its equations that a direction moves.
    FileExistsError
        There is something at `store` already.

    Notes
    -----
    Times are :math:`t_0 + n h`, computed and not summed up; those of steps that are not equal are
    sums with compensated rounding.

    Examples
    --------
    >>> import liouville as lv
    >>> system = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0] ** 2 / 2, q=("x",))
    >>> solution = lv.integrate(system, lv.Spark(3), t=(0, 10), h=0.1, q=[1.0], v=[0.0])
    >>> f"{solution.q[-1, 0]:.6f}"  # cos 10
    '-0.839072'
    """
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, atol=atol, control=control, every=every, t_eval=t_eval,
        events=events, observe=observe, params=params, states=states, tangents=tangents,
        threads=threads, start=started(start, values), is_stored=store is not None,
    )  # fmt: skip
    if isinstance(system, Mechanics) and system.contacts is not None:
        # imported here: few systems have contacts
        from liouville._runs import contacts

        if store is None:
            return contacts.integrate(system, method, request, progress)
        from liouville._runs import stored
        from liouville._runs.stored.touching import begin_touching

        return begin_touching(system, method, request, stored.place_of(store), progress)
    if store is None:
        return checked(runner_of(system, method, request), request, progress)
    from liouville._runs import stored

    place = stored.place_of(store)
    return stored.begin(runner_of(system, method, request), place, progress)
