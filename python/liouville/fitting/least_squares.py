"""Parameters and starts that fit measured motions, by least squares with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._options import started
from liouville._scipy import scipy
from liouville.analysis.point import Array
from liouville.errors import IntegrationError, hinted, quoted
from liouville.fitting.freedoms import FreeStart, movable
from liouville.fitting.measurements import Measurements, System
from liouville.fitting.result import Fit, of_size, of_step
from liouville.fitting.unknowns import Unknowns
from liouville.integrate import integrate
from liouville.methods import Method
from liouville.runners.edges import hints_without_events
from liouville.runners.execute import finished
from liouville.solution import Solution
from liouville.systems import Mechanics, SemiExplicit

#: Fits from where the last one ended, until no unknown can lessen the residuals by more than this
#: part of them.
MOST, SETTLED = 10, 1e-3
#: Residuals below this part of the states, or of the start of the guess, are roundoff.
ROUNDED = 1e-8
#: A singular value of the scaled Jacobian below this part of the largest determines nothing, of
#: unknowns that have more than the second part in it.
RANK, APART = 1e-10, 0.1
#: Nor does an unknown that as large a change of its own moves states by less than this part.
NOTHING = 1e-11


def fit(
    system: Mechanics | SemiExplicit,
    method: Method,
    data: Mapping[str, ArrayLike],
    *,
    h: float,
    params: Sequence[str] | Mapping[str, ArrayLike] = (),
    free: Sequence[str] = (),
    sigma: float | Mapping[str, ArrayLike] | None = None,
    bounds: Mapping[str, Any] | None = None,
    t0: float | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> Fit:
    r"""Fit parameters and the start of a motion to measurements of it, by least squares.

    .. math::

        \min_{\theta, y_0, z_0} \sum_k \bigl(x_k - x(t_k; \theta, y_0, z_0)\bigr)^2 / \sigma_k^2

    Gauss and Newton's method with a trust region; residuals and their derivatives come from the
    same run, the derivatives as its tangents, exact to roundoff. A start stays on its constraints,
    also while lengths in them are fitted: it is moved as ``system.consistent`` moves it.

    Parameters
    ----------
    system : Mechanics or SemiExplicit
        What moves.
    method : Method
        Any that has tangents of the system: of mechanics ``Spark``, ``LobattoPair`` or a
        ``Composition`` of them, ``HHT``, ``GeneralizedAlpha`` or ``ArnoldBruls``.
    data : mapping of str to array_like, or DataFrame
        ``"t"``, shape (k,), increasing, and measured values by the name of a coordinate or unknown,
        shape (k,), or of a state of the system such as ``"q"``, shape (k, n), or (k,) of one
        coordinate. NaN is no measurement. Times at equal distances are ends of steps; others lie
        within steps, as those of ``t_eval=``.
    h : float
        The largest step, in the system's unit of time.
    params : sequence of str, or mapping
        Names of the parameters to fit, from their defaults, or values to begin with by name.
        Others keep their defaults.
    free : sequence of str
        States of the start that are fitted too: ``"q"``, ``"v"``, or what the system calls them.
        One of them alone moves as far as the other, which is held, stays on its constraints. Of a
        semi-explicit system ``"y"``, which z follows.
    sigma : float or mapping, optional
        Standard deviation of all measurements, or by the names in `data`, as a number, one for each
        coordinate, or of the shape of the data. Without it measurements count alike, and their
        deviation is found from the residuals.
    bounds : mapping, optional
        Least and largest value of parameters by name, ``{"l": (0, 2)}``; None leaves a side open.
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
        no fit is found: sums of squares still fall where the trials end.
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
    nothing of `bounds`: of an unknown that has come to one it is that without it.

    References
    ----------
    :cite:t:`bock1983` for fits through differential-algebraic equations.

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
    if not isinstance(system, Mechanics | SemiExplicit):
        sentence = (
            f"fit takes a mechanical or a semi-explicit system, not a {type(system).__name__}"
        )
        raise TypeError(hinted(sentence, "lv.vjp has gradients of the others, for an optimiser"))
    measured = Measurements(system, data, h, sigma, t0)
    unknowns = Unknowns.of(system, params, free, bounds)
    return _Problem(system, method, measured, unknowns, started(start, values)).solve()


class _Problem:
    """Measurements, and the run that is to meet them."""

    def __init__(
        self, system: System, method: Method, data: Measurements, unknowns: Unknowns,
        start: Mapping[str, Any],
    ) -> None:  # fmt: skip
        self.system, self.method, self.data, self.unknowns = system, method, data, unknowns
        self.params, self.free, self.bounds = unknowns.params, unknowns.free, unknowns.bounds
        self.start: dict[str, Any] = dict(zip(system.states, system.start(start), strict=True))
        self.guessed = np.abs(np.concatenate([*self.start.values()]))
        self.evaluations = 0

    def solve(self) -> Fit:
        """Fit, from where the last fit ended until squares are least there."""
        least_squares = scipy("optimize", "a fit").least_squares
        system, t, given = self.system, self.data.t0, self.start
        self.start = dict(system.consistent(t=t, params=self.params, **given))
        for _ in range(MOST):
            self.place = FreeStart.of(system, t, given, self.start, self.params, self.free)
            along = self.place.basis.shape[1]
            x = np.concatenate([self.unknowns.theta(self.params), np.zeros(along)])
            there = int(np.count_nonzero(self.data.is_there))
            if there < x.size:
                raise ValueError(f"{there} measurements do not determine {x.size} unknowns")
            if there == x.size and not self.data.is_absolute:
                sentence = f"{there} measurements of {x.size} unknowns do not say how good they are"
                raise ValueError(hinted(sentence, "give sigma=, their standard deviation"))
            free = np.full((len(x) - len(self.bounds), 2), (-np.inf, np.inf))
            sides = np.vstack([self.bounds, free]).T
            self.last = self._run(x)  # a failure here is that of the guess
            jacobian = self._jacobian(x)
            self._covariance(jacobian)
            # each unknown in the unit that moves the states as the others do: tolerances are alike
            found, at = self._sought(least_squares, x, sides, 1 / self._scales(jacobian))
            if found.status == 0:
                raise self._unfound()
            residuals = self._residuals(at)
            jacobian = self._jacobian(at)
            covariance = self._covariance(jacobian)
            self.params, self.start = self.last.params, self.last.start
            # SciPy's units are those of the first guess, beside whose slopes all others may vanish
            is_least = self._is_least(at, residuals, jacobian, covariance)
            if is_least:
                break
        if not is_least:
            raise self._unfound()
        return self._fit(covariance, residuals, jacobian)

    def _unfound(self) -> ValueError:
        sentence = f"no fit is found in {self.evaluations} runs"
        return ValueError(hinted(sentence, "begin nearer, or fit to a shorter time first"))

    def _is_least(self, x: Array, residuals: Array, jacobian: Array, covariance: Array) -> bool:
        """Return whether no unknown that is free can lessen the sum of squares, to first order.

        An unknown next to a bound, beyond which the sum falls, is not.
        """
        sizes = np.abs(self._of(self.last.run.states)[self.data.first :]) + self.guessed
        size = np.linalg.norm(residuals)
        if size <= ROUNDED * np.linalg.norm((sizes / self.data.weights)[self.data.is_there]):
            return True
        own = len(self.bounds)
        falls = -(jacobian.T @ residuals)[:own]
        near = SETTLED * np.sqrt(np.diagonal(covariance)[:own] / residuals.size) * size
        (low, high), theta = self.bounds.T, x[:own]
        held = ((theta - low <= near) & (falls < 0)) | ((high - theta <= near) & (falls > 0))
        free = jacobian[:, ~np.concatenate([held, np.zeros(len(x) - own, dtype=bool)])]
        along = np.linalg.qr(free / np.linalg.norm(free, axis=0))[0].T @ residuals
        return bool(np.linalg.norm(along) <= SETTLED * size)

    def _sought(
        self, least_squares: Any, x: Array, sides: Array, units: Array
    ) -> tuple[Any, Array]:
        """Return what SciPy finds from x with unknowns in these units, and the unknowns."""

        def own(scaled: Array) -> Array:
            found: Array = np.clip(scaled * units, *sides)
            return found

        found = least_squares(
            lambda scaled: self._residuals(own(scaled)), x / units, bounds=sides / units,
            jac=lambda scaled: self._jacobian(own(scaled)) * units, x_scale="jac",
            xtol=1e-12, ftol=1e-14, gtol=1e-14,
        )  # fmt: skip
        return found, own(found.x)

    def _run(self, x: Array) -> _Tried:
        """Run with these values, and their tangents."""
        self.evaluations += 1
        theta, along = np.split(x, [len(self.bounds)])
        params = self.unknowns.taken(self.params, theta)
        start: dict[str, Any] = {**self.place.moved(along, params)}
        tangents: dict[str, Any] = {
            f"params.{name}": 1.0 if np.ndim(params[name]) == 0 else np.eye(np.size(params[name]))
            for name in self.unknowns.fitted
        }
        tangents |= self.place.tangents(along, params, self.unknowns.fitted, start)
        with hints_without_events():
            run = integrate(
                self.system, self.method, params=params, tangents=tangents, **self.data.run,
                **start,
            )  # fmt: skip
        finished(run)
        return _Tried(x.copy(), params, start, tangents, run)

    def _residuals(self, x: Array) -> Array:
        if not np.array_equal(x, self.last.x):
            try:
                self.last = self._run(x)
            except (IntegrationError, ValueError):
                # the trust region becomes smaller where no motion is
                return np.full(int(self.data.is_there.sum()), np.inf)
        there = self._of(self.last.run.states)[self.data.first :]
        found: Array = ((there - self.data.values) / self.data.weights)[self.data.is_there]
        return found

    def _jacobian(self, x: Array) -> Array:
        assert np.array_equal(x, self.last.x), "derivatives come from the run of the residuals"
        slopes = self._slopes(self.last.run)[self.data.first :] / self.data.weights[:, None]
        found: Array = np.moveaxis(slopes, 1, 2)[self.data.is_there]
        return found

    def _slopes(self, run: Solution) -> Array:
        """Return derivatives of all records by the unknowns, shape (k, K, w)."""
        columns: dict[str, Array] = {}
        for name, tangent in run.tangents.items():
            rows = self._of(tangent.states)
            columns[name] = rows if rows.ndim == 3 else rows[:, None]
        # a direction of both states is the sum of its parts, as is what parameters do to a start
        found: Any = sum(columns.pop(name) for name in movable(self.system))
        if columns:
            found[:, : len(self.bounds)] += np.concatenate([*columns.values()], axis=1)
        slopes: Array = found
        return slopes

    def _slopes_of_start(self) -> Array:
        """Return derivatives of both states of the start, shape (w, K).

        Parameters in constraints move it too.
        """
        run = integrate(
            self.system, self.method, params=self.params, tangents=self.last.tangents,
            **self.data.first_step, **self.start,
        )  # fmt: skip
        found: Array = self._slopes(finished(run))[0].T
        return found

    def _of(self, states: Mapping[str, Array]) -> Array:
        """Return both states of all records side by side."""
        return np.concatenate([states[name] for name in self.system.states], axis=-1)

    def _covariance(self, jacobian: Array) -> Array:
        """Return the covariance of the unknowns for measurements of deviation one."""
        scales = self._scales(jacobian)
        _, sizes, right = np.linalg.svd(jacobian / scales, full_matrices=False)
        if not (sizes > RANK * sizes[0]).all():
            self._undetermined(np.abs(right[-1]) > APART)
        half = right.T / sizes / scales[:, None]
        found: Array = half @ half.T
        return found

    def _scales(self, jacobian: Array) -> Array:
        """Return the sizes of derivatives; ValueError where one is nothing but roundoff."""
        scales: Array = np.linalg.norm(jacobian, axis=0)
        states = self._of(self.last.run.states)[self.data.first :] / self.data.weights
        typical = np.abs(self.unknowns.theta(self.params))
        typical[typical == 0] = 1.0
        own = np.concatenate([1 / typical, self._along()])
        nothing = scales <= NOTHING * np.linalg.norm(states[self.data.is_there]) * own
        if nothing.any():
            self._undetermined(nothing)
        return scales

    def _along(self) -> Array:
        """Return how much each direction changes the start, as parts of the largest of its states.

        Positions and velocities have units of their own, and one may begin at zero.
        """
        found = np.zeros(self.place.basis.shape[1])
        for name, part in self.place.bases.items():
            largest = np.abs(self.last.run.states[name]).max()
            if part.size and largest > 0:
                found += np.linalg.norm(part, axis=0) / largest
        return found

    def _undetermined(self, unknowns: np.ndarray) -> None:
        names = self.unknowns.names
        parts = [names[k] for k in np.flatnonzero(unknowns) if k < len(names)]
        what = quoted(parts) if parts else "the start"
        sentence = f"the measurements do not determine {what}"
        raise ValueError(hinted(sentence, "fix something of it, or measure what it changes"))

    def _fit(self, covariance: Array, residuals: Array, jacobian: Array) -> Fit:
        """Return what was found, with the covariance of parameters and of the start."""
        sigma, unknowns = None, len(covariance)
        if self.data.is_absolute:
            covariance, residuals = covariance / self.data.unit**2, residuals * self.data.unit
        else:
            left = residuals.size - unknowns
            deviation = np.sqrt(residuals @ residuals / left)  # in the unit of the weights
            covariance = covariance * deviation**2
            unit = float(self.data.weights[0, 0])
            sigma, residuals = float(deviation) * unit, residuals * unit
        own, names, places = len(self.bounds), [*self.unknowns.names], self.system.places
        each = [(state, x) for state in self.system.states for x in places[state]]
        rows = [k for k, (state, _) in enumerate(each) if state in self.free]
        names += [f"{each[k][0]}.{each[k][1]}" for k in rows]
        spread = np.zeros((own + len(rows), unknowns))
        spread[:own, :own] = np.eye(own)
        if rows:
            spread[own:] = self._slopes_of_start()[rows]
        spread_out, dof = spread @ covariance @ spread.T, residuals.size - unknowns
        moved = spread @ self._moved_by_half_a_step(jacobian)
        words = [of_size(residuals, dof)] if sigma is None else []
        words.append(of_step(names, moved, np.sqrt(np.diagonal(spread_out))))
        return Fit(
            params=self.params, start=self.start, names=tuple(names), covariance=spread_out,
            residuals=-residuals, sigma=sigma, dof=dof, evaluations=self.evaluations,
            message="; ".join(filter(None, words)), solution=self.last.run,
        )  # fmt: skip

    def _moved_by_half_a_step(self, jacobian: Array) -> Array:
        """Return how far the unknowns move with half the step, by one step of Gauss and Newton.

        They are NaN where no such run is.
        """
        run = self.data.run | {"steps": 2 * self.data.run["steps"]}
        if "every" in run:
            run["every"] *= 2
        self.evaluations += 1
        try:
            half = integrate(self.system, self.method, params=self.params, **run, **self.start)
        except IntegrationError:
            return np.full(jacobian.shape[1], np.nan)
        change = (self._of(finished(half).states) - self._of(self.last.run.states))[
            self.data.first :
        ]
        scales = np.linalg.norm(jacobian, axis=0)
        off = (change / self.data.weights)[self.data.is_there]
        found: Array = -np.linalg.lstsq(jacobian / scales, off, rcond=None)[0] / scales
        return found


@dataclass(frozen=True)
class _Tried:
    """A run with some values of the unknowns."""

    x: Array
    params: dict[str, Any]
    start: dict[str, Array]
    tangents: dict[str, Any]
    run: Solution
