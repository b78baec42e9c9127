"""Parameters and starts that fit measured motions, by least squares with exact derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from liouville._basics.arguments import number
from liouville._basics.errors import hinted, quoted
from liouville._basics.options import started
from liouville._methods import Method
from liouville._runs.choice import named
from liouville._studies.fitting.motions import Model, Motion, Trial
from liouville._studies.fitting.observed import Observed
from liouville._studies.fitting.problem import Problem
from liouville._studies.fitting.profile import Held, Profile
from liouville._studies.fitting.result import Fit
from liouville._studies.fitting.robust import loss_of
from liouville._studies.fitting.unknowns import Unknowns
from liouville._systems import Field, Mechanics, SemiExplicit
from liouville._systems.events import Event


def fit(
    system: Mechanics | SemiExplicit | Field,
    method: Method | str = "auto",
    data: Mapping[str, ArrayLike] | Trial | Sequence[Trial] | None = None,
    *,
    h: float | None = None,
    rtol: float | None = None,
    params: Sequence[str] | Mapping[str, ArrayLike] = (),
    free: Sequence[str] = (),
    sigma: float | Mapping[str, ArrayLike] | None = None,
    bounds: Mapping[str, Any] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    loss: str = "linear",
    observe: Mapping[str, Any] | None = None,
    events: Mapping[str, Event | Callable[..., Any]] | None = None,
    t0: float | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> Fit:
    r"""Fit parameters and the start of a motion to measurements of it, by least squares.

    .. math::

        \min_{\theta, y_0, z_0} \sum_k \rho\Bigl(\bigl(x_k - x(t_k; \theta, y_0, z_0)\bigr)^2 /
        \sigma_k^2\Bigr)

    Gauss and Newton's method with a trust region; residuals and their derivatives come from the
    same run, the derivatives as its tangents, exact to roundoff. A start stays on its constraints,
    also while lengths in them are fitted: it is moved as ``system.consistent`` moves it.

    Parameters
    ----------
    system : Mechanics, SemiExplicit or Field
        What moves.
    method : Method or str, default "auto"
        Any that has tangents of the system, or its name, as for ``integrate``: of mechanics
        ``Spark``, ``LobattoPair`` or a ``Composition`` of them, ``HHT``, ``GeneralizedAlpha`` or
        ``ArnoldBruls``; of fields ``VolumeSplitting``.
    data : mapping of str to array_like, DataFrame, Dataset, or sequence of Trial
        ``"t"``, shape (k,), increasing, and measured values by the name of a coordinate, unknown or
        constraint (its multiplier), shape (k,), of a state of the system such as ``"q"`` or
        ``"lam"``, shape (k, n), or (k,) of one coordinate, which is ``"v[x]"`` too, or of a
        function in `observe`. Tables of pandas and xarray have their times in a column or an
        index called ``t`` or ``time``. NaN is no measurement. Times at equal distances are ends of
        steps; others lie within steps, as those of ``t_eval=``. Several motions with parameters in
        common are a sequence of
        :class:`Trial`, each with its data and its start.
    h, rtol : float
        The largest step, in the system's unit of time, or the tolerance of controlled steps.
    params : sequence of str, or mapping
        Names of the parameters to fit, from their defaults, or values to begin with by name.
        Others keep their defaults.
    free : sequence of str
        States of the start that are fitted too: ``"q"``, ``"v"``, or what the system calls them.
        One of them alone moves as far as the other, which is held, stays on its constraints. Of a
        semi-explicit system ``"y"``, which z follows; of a field ``"x"``.
    sigma : float or mapping, optional
        Standard deviation of all measurements, or by the names in `data`, as a number, one for each
        coordinate, or of the shape of the data. Without it measurements count alike, and their
        deviation is found from the residuals.
    bounds : mapping, optional
        Least and largest value of parameters by name, ``{"l": (0, 2)}``; None leaves a side open.
        A fit may begin at one.
    priors : mapping, optional
        Value and standard deviation of parameters by name that are known besides; such a pair
        counts as a measurement. Takes `sigma`.
    loss : str
        ``"linear"`` for least squares, or ``"huber"``, ``"soft_l1"`` or ``"cauchy"``, by which
        residuals beyond their `sigma` count less: outliers move a fit little.
    observe : mapping of str to callable, optional
        Functions of (t, states, params) that were measured, by the names in `data`; or of
        (t, states, lam, params) with multipliers, such as ``system.joint_force("A")``.
    events : mapping of str to Event, optional
        Events of the run with their resets, such as impacts, as those of ``integrate``.
    t0 : float, optional
        Time of the start, before the first measurement or, by default, at it.
    start, **values : mapping, or array_like by name
        The start by the system's names, or a guess of what is free of it.

    Returns
    -------
    Fit
        Values, their covariance and the motion that fits.

    Raises
    ------
    TypeError, ValueError
        Names, shapes, times or bounds are wrong, nothing is to be fitted, there are fewer
        measurements than unknowns, or no more without `sigma`, they do not determine them all, or
        no fit is found: sums of squares still fall where the runs end.
    IntegrationError
        The run from the first guess fails.
    KeyboardInterrupt
        A run was interrupted.
    ImportError
        SciPy is missing.

    Notes
    -----
    The covariance is :math:`(J^T J)^{-1}` with the Jacobian J of the residuals at the end, times
    the mean square of residuals where `sigma` is not given: their sum of squares over the number of
    measurements less that of unknowns. With K unknowns and N measurements it holds 95 % of truths
    in the ellipsoid of :math:`\chi^2_K` where `sigma` is given, and otherwise of
    :math:`K F_{K, N - K}`, as far as states are linear in the unknowns over its size. It knows
    nothing of `bounds`: an unknown that has come to one has the covariance without it, and
    ``message`` names it. That of a robust loss is Huber's.

    Where residuals from the guess are poor, or no minimum is found, the fit is made again to an
    eighth, a quarter, half and all of the time: the minimum of a longer time is beside that of a
    shorter one, not beside the guess. The lower minimum is returned, and ``message`` says so.

    References
    ----------
    :cite:t:`bock1983` for fits through differential-algebraic equations, :cite:t:`huber1981` for
    robust ones.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> lagrangian = lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2
    >>> system = lv.Lagrangian(lagrangian, q=("x",), params={"k": 1.0})
    >>> t = np.linspace(0, 2, 21)
    >>> data = {"t": t, "x": np.cos(2 * t)}
    >>> found = lv.fit(system, lv.Spark(3), data, h=0.1, params=["k"], q=[1.0], v=[0.0])
    >>> f"{found.params['k']:.6f}"
    '4.000000'
    """
    if not isinstance(system, Mechanics | SemiExplicit | Field):
        sentence = (
            f"fit takes a mechanical or semi-explicit system or a field, not a "
            f"{type(system).__name__}"
        )
        raise TypeError(hinted(sentence, "lv.vjp has its gradients, for an optimiser"))
    if data is None:
        sentence = "data= is missing: the times and the measured values"
        raise TypeError(hinted(sentence, 'write fit(system, data={"t": times, "x": values})'))
    unknowns = Unknowns.of(system, params, free, bounds, priors)
    options = {} if events is None else {"events": events}
    taken: Method = named(system, method, rtol)
    model = Model(system, taken, unknowns, Observed(system, observe), _steps(h, rtol), options)
    if rtol is not None and getattr(system, "contacts", None) is not None:
        sentence = "fits of a system with contacts take h=, not rtol="
        raise TypeError(hinted(sentence, "changes of contacts are found within equal steps"))
    trials = _trials(data, started(start, values), t0)
    sigmas = [sigma if trial.sigma is None else trial.sigma for trial in trials]
    if any(each is None for each in sigmas) and any(each is not None for each in sigmas):
        sentence = "some trials have sigma, and others have none"
        raise ValueError(hinted(sentence, "give the fit sigma=, that of all other trials"))
    motions = [Motion(model, *each) for each in zip(trials, sigmas, strict=True)]

    rho, is_absolute = loss_of(loss, sigmas[0]), sigmas[0] is not None
    if priors and not is_absolute:
        sentence = "priors are weighed against measurements by their deviations"
        raise ValueError(hinted(sentence, "give sigma=, the deviation of the measurements"))
    found = Problem(model, motions, rho, is_absolute=is_absolute).solve()
    if loss != "linear":
        return found

    def held(params: Mapping[str, Any], starts: Sequence[Any], name: str, value: float) -> Held:
        own = replace(model, unknowns=replace(unknowns, params=dict(params)).without(name, value))
        near = [replace(trial, start=x) for trial, x in zip(trials, starts, strict=True)]
        each = [Motion(own, *x) for x in zip(near, sigmas, strict=True)]
        return Problem(own, each, rho, is_absolute=is_absolute).least(unknowns.known(name, value))

    sides = dict(zip(unknowns.names, map(tuple, unknowns.bounds.tolist()), strict=True))
    return replace(found, _profile=Profile(held, sides))


def _steps(h: Any, rtol: Any) -> dict[str, float]:
    """Return the one of both that is given."""
    if (h is None) == (rtol is None):
        sentence = "steps must be given by h= or by rtol=, " + ("not both" if h else "one of both")
        raise TypeError(hinted(sentence, "h is the largest step, in the unit of time"))
    name, value = ("h", h) if rtol is None else ("rtol", rtol)
    size = number(f"{name} must be a number", value)
    if not size > 0:
        raise ValueError(f"{name} must be positive, not {size:g}")
    return {name: size}


def _trials(data: Any, start: Mapping[str, Any], t0: Any) -> list[Trial]:
    """Return the trials of a call; TypeError or ValueError where their parts do not fit."""
    if isinstance(data, Trial):
        data = [data]
    if isinstance(data, Mapping) or hasattr(data, "columns") or not isinstance(data, Sequence):
        return [Trial(data, start, t0=t0)]
    for each in data:
        if not isinstance(each, Trial):
            sentence = f"data must be a mapping or a sequence of lv.Trial, not of {each!r}"
            raise TypeError(hinted(sentence, 'write [lv.Trial({"t": times, "q": values}, start)]'))
    if not data:
        raise ValueError("data has no trial")
    if start or t0 is not None:
        given = quoted([*start]) if start else "'t0'"
        raise TypeError(
            hinted(f"{given} must be given by trials", "write lv.Trial(data, start, t0=...)")
        )
    return list(data)
