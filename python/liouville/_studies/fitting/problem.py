"""The values of the unknowns at which the sum of losses of all measurements is least."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from liouville._basics.arguments import amount
from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._basics.scipy import scipy
from liouville._studies.fitting import remarks
from liouville._studies.fitting.measurements import shared_unit
from liouville._studies.fitting.motions import Model, Motion
from liouville._studies.fitting.profile import Held
from liouville._studies.fitting.result import Fit, Fitted, Least
from liouville._studies.fitting.robust import LOSSES, Loss, robust
from liouville.analysis.point import Array

#: Fits from where the last one ended, until no unknown can lessen the residuals by more than this
#: part of them.
MOST, SETTLED = 10, 1e-3
#: Residuals below this part of the states, or of the start of the guess, are roundoff.
ROUNDED = 1e-8
#: Motions that differ by less than this part of them do so by roundoff.
EXACT = 1e-12
#: A singular value of the scaled Jacobian below this part of the largest determines nothing, of
#: unknowns that have more than the second part in it.
RANK, APART = 1e-10, 0.1
#: Nor does an unknown that as large a change of its own moves states by less than this part.
NOTHING = 1e-11
#: Where a fit from the guess is poor, fits to these parts of the time lead to another minimum.
GROWING = (0.125, 0.25, 0.5)


class Problem:
    """Motions that were measured, and the values of the unknowns that are sought.

    The unknowns are the elements of the parameters, then directions of the start of each motion.
    """

    def __init__(
        self, model: Model, motions: list[Motion], loss: Loss, *, is_absolute: bool
    ) -> None:
        self.model, self.unknowns, self.motions = model, model.unknowns, motions
        self.loss, self.is_absolute = loss, is_absolute
        self.unit = shared_unit([motion.data for motion in motions], is_absolute)
        self.params, self.bounds = self.unknowns.params, self.unknowns.bounds
        self.evaluations = 0
        for motion in motions:
            motion.begin(self.params)

    def solve(self) -> Fit:
        """Fit from the guess, and where that is poor from fits to growing parts of the time."""
        guess = self._place()
        found = self._settled()
        if found is not None and not self._is_poor(found):
            return self._fit(found, "")
        kept = self._place()
        again = self._grown(guess)
        if again is not None and (found is None or again.loss < (1 - SETTLED) * found.loss):
            than = "a lower minimum than the guess" if found else "a minimum, and the guess to none"
            return self._fit(again, f"fits to growing parts of the time led to {than}")
        self._take(kept)
        return self._fit(self._surely(self._settled() if found else None), "")

    def _grown(self, guess: tuple[dict[str, Any], list[dict[str, Array]]]) -> Least | None:
        """Fit from the guess to growing parts of the time, and to all of it."""
        self._take(guess)
        for part in (*GROWING, 1.0):
            self._within(part)
            try:
                found = self._settled()
            except (IntegrationError, ValueError):
                found = None  # so short a time may not determine what is sought
        return found

    def least(self, known: float) -> Held:
        """Return the least sum of squares from here, in units of the deviations, and where it is.

        What a prior of a value that is held adds is `known`.
        """
        if len(self.bounds) or self.unknowns.free:
            size = self._surely(self._settled()).size
        else:
            self._cuts = np.zeros(len(self.motions) + 1, dtype=int)
            for motion in self.motions:
                motion.settle(self.params)
            self._run(np.empty(0))
            residuals = self._residuals(np.empty(0))
            size = float(residuals @ residuals)
        params, starts = self._place()
        unit = self.unit if self.is_absolute else float(self.motions[0].data.weights[0, 0])
        return Held(size * unit**2 + known, params, starts)

    def _within(self, part: float) -> None:
        """Take what was measured within this part of the time of each motion."""
        for motion in self.motions:
            motion.is_there = motion.data.is_there & (motion.until <= part)

    def _place(self) -> tuple[dict[str, Any], list[dict[str, Array]]]:
        """Return parameters and starts as they are now."""
        return self.params, [motion.start for motion in self.motions]

    def _take(self, place: tuple[dict[str, Any], list[dict[str, Array]]]) -> None:
        self.params = place[0]
        for motion, start in zip(self.motions, place[1], strict=True):
            motion.start = start

    def _is_poor(self, found: Least) -> bool:
        """Return whether residuals are far larger than sigma, or than a part of what was seen."""
        dof = found.residuals.size - len(found.covariance)
        is_small = self.is_absolute and found.size * self.unit**2 <= dof
        return bool(self._said_of_residuals(found)) and not is_small

    def _said_of_residuals(self, found: Least) -> str:
        """Say where residuals are not of the size that is known, or as large as what was seen."""
        dof, own = found.residuals.size - len(found.covariance), found.residuals * self.unit
        measured = own[: own.size - len(self.unknowns.priors)]
        if not dof:
            return ""
        if self.loss is not LOSSES["linear"]:
            return remarks.of_most(measured)
        if self.is_absolute:
            return remarks.of_size(own, dof)
        values = [motion.values()[motion.is_there] for motion in self.motions]
        return remarks.of_spread(
            float(np.std(found.residuals)), float(np.std(np.concatenate(values)))
        )

    def _settled(self) -> Least | None:
        """Fit from where the last fit ended until losses are least there, None if they never are.

        Raises
        ------
        ValueError, IntegrationError
            The measurements do not determine the unknowns, or a run from there fails.
        """
        least_squares = scipy("optimize", "a fit").least_squares
        for _ in range(MOST):
            counts = [motion.settle(self.params) for motion in self.motions]
            self._cuts = len(self.bounds) + np.cumsum([0, *counts])
            x = np.concatenate([self.unknowns.theta(self.params), np.zeros(sum(counts))])
            there = sum(int(np.count_nonzero(motion.is_there)) for motion in self.motions)
            there += len(self.unknowns.priors)
            if there < x.size:
                known = f"{amount(there, 'measurement')} cannot determine"
                raise ValueError(f"{known} {amount(x.size, 'unknown')}")
            if there == x.size and not self.is_absolute:
                counted = f"{amount(x.size, 'unknown')} to {amount(there, 'measurement')}"
                sentence = f"nothing says how good a fit of {counted} is"
                raise ValueError(hinted(sentence, "give sigma=, their standard deviation"))
            free = np.full((len(x) - len(self.bounds), 2), (-np.inf, np.inf))
            sides = np.vstack([self.bounds, free]).T
            self._run(x)  # a failure here is that of the guess
            jacobian = self._jacobian(x)
            self._covariance(jacobian)
            # each unknown in the unit that moves the states as the others do: tolerances are alike
            found, at = self._sought(least_squares, x, sides, 1 / self._scales(jacobian))
            if found.status == 0:
                return None
            residuals = self._residuals(at)
            jacobian = self._jacobian(at)
            covariance = self._covariance(jacobian)
            self.params = self.unknowns.taken(self.params, at[: len(self.bounds)])
            # SciPy's units are those of the first guess, beside whose slopes all others may vanish
            if self._is_least(at, residuals, jacobian, covariance):
                return Least(residuals, jacobian, covariance, float(self._rho(residuals)[0].sum()))
        return None

    def _surely(self, found: Least | None) -> Least:
        """Return a fit that was found; ValueError where there is none."""
        if found is None:
            raise ValueError(
                remarks.of_none(self.evaluations, [motion.met() for motion in self.motions])
            )
        return found

    def _is_least(self, x: Array, residuals: Array, jacobian: Array, covariance: Array) -> bool:
        """Return whether no unknown that is free can lessen the sum of losses, to first order.

        An unknown next to a bound, beyond which the sum falls, is not.
        """
        sizes = np.concatenate([motion.sizes_of_guess() for motion in self.motions])
        size = np.linalg.norm(residuals)
        if size <= ROUNDED * np.linalg.norm(sizes):
            return True
        roots = np.sqrt(self._rho(residuals)[1])
        residuals, jacobian = roots * residuals, roots[:, None] * jacobian
        own, size = len(self.bounds), np.linalg.norm(residuals)
        falls = -(jacobian.T @ residuals)[:own]
        near = SETTLED * np.sqrt(np.diagonal(covariance)[:own] / residuals.size) * size
        (low, high), theta = self.bounds.T, x[:own]
        held = ((theta - low <= near) & (falls < 0)) | ((high - theta <= near) & (falls > 0))
        free = jacobian[:, ~np.concatenate([held, np.zeros(len(x) - own, dtype=bool)])]
        along = np.linalg.qr(free / np.linalg.norm(free, axis=0))[0].T @ residuals
        return bool(np.linalg.norm(along) <= SETTLED * size)

    def _rho(self, residuals: Array) -> tuple[Array, Array, Array]:
        """Return the loss and its derivatives of residuals; priors have squares."""
        z = (residuals * self.unit) ** 2
        found, plain = self.loss(z), LOSSES["linear"](z)
        last = z.size - len(self.unknowns.priors)
        rho, first, second = (
            np.concatenate([x[:last], y[last:]]) for x, y in zip(found, plain, strict=True)
        )
        return rho, first, second

    def _shares(self, residuals: Array) -> tuple[Array, Array]:
        """Return sqrt(rho(r^2)) over |r|, and the derivative of sqrt(rho(r^2)) by |r|."""
        if self.loss is LOSSES["linear"] or not np.isfinite(residuals).all():
            return np.ones_like(residuals), np.ones_like(residuals)
        size = np.maximum(np.abs(residuals) * self.unit, np.finfo(float).tiny ** 0.25)
        rho, first, _ = self._rho(size / self.unit)
        root = np.sqrt(rho)
        return root / size, first * size / root

    def _sought(
        self, least_squares: Any, x: Array, sides: Array, units: Array
    ) -> tuple[Any, Array]:
        """Return SciPy's result from x with unknowns in these units, and the unknowns."""
        first = x / units

        def own(scaled: Array) -> Array:
            found: Array = np.clip(scaled * units, *sides)
            return (
                x if np.array_equal(scaled, first) else found
            )  # a rounding beside it no run may be

        # the square of sqrt(rho) is the loss, so that the method sees squares alone
        def roots(scaled: Array) -> Array:
            found = self._residuals(own(scaled))
            return found * self._shares(found)[0]

        def slopes(scaled: Array) -> Array:
            at = own(scaled)
            found: Array = (
                self._shares(self._residuals(at))[1][:, None] * self._jacobian(at) * units
            )
            return found

        found = least_squares(
            roots, first, bounds=sides / units, jac=slopes, x_scale="jac",
            xtol=1e-12, ftol=1e-14, gtol=1e-14,
        )  # fmt: skip
        return found, own(found.x)

    def _run(self, x: Array) -> None:
        """Run all motions with these values, and their tangents."""
        self._at = np.full(x.shape, np.nan)
        params = self.unknowns.taken(self.params, x[: len(self.bounds)])
        self.evaluations += len(self.motions)
        for motion, first, last in zip(self.motions, self._cuts, self._cuts[1:], strict=False):
            motion.go(params, x[first:last])
        self._at = x.copy()

    def _residuals(self, x: Array) -> Array:
        if not np.array_equal(x, self._at):
            try:
                self._run(x)
            except (IntegrationError, ValueError):
                # the trust region becomes smaller where no motion is
                count = sum(int(motion.is_there.sum()) for motion in self.motions)
                return np.full(count + len(self.unknowns.priors), np.inf)
        own = [motion.residuals() for motion in self.motions]
        return np.concatenate([*own, self.unknowns.off(x[: len(self.bounds)]) / self.unit])

    def _jacobian(self, x: Array) -> Array:
        assert np.array_equal(x, self._at), "derivatives come from the run of the residuals"
        own = len(self.bounds)
        rows = []
        for motion, first, last in zip(self.motions, self._cuts, self._cuts[1:], strict=False):
            part = motion.jacobian()
            whole = np.zeros((len(part), x.size))
            whole[:, :own], whole[:, first:last] = part[:, :own], part[:, own:]
            rows.append(whole)
        priors = np.zeros((len(self.unknowns.priors), x.size))
        priors[:, :own] = self.unknowns.slopes_of_priors / self.unit
        return np.concatenate([*rows, priors])

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
        seen = np.concatenate([motion.sizes() for motion in self.motions])
        typical = np.abs(self.unknowns.theta(self.params))
        typical[typical == 0] = 1.0
        own = np.concatenate([1 / typical, *(motion.along() for motion in self.motions)])
        size = float(np.linalg.norm(seen))
        if self.is_absolute and not any(
            motion.values()[motion.is_there].any() for motion in self.motions
        ):
            size = max(size, 1 / self.unit)  # beside zeros roundoff is seen alone
        nothing = scales <= NOTHING * size * own
        if nothing.any():
            self._undetermined(nothing)
        return scales

    def _undetermined(self, unknowns: np.ndarray) -> None:
        names = self.unknowns.names
        parts = [names[k] for k in np.flatnonzero(unknowns) if k < len(names)]
        what = quoted(parts) if parts else "the start"
        sentence = f"the measurements do not determine {what}"
        hint = "fix something of it, measure what it changes, or begin where it matters"
        raise ValueError(hinted(sentence, hint))

    def _fit(self, found: Least, said: str) -> Fit:
        """Return the fit, with the covariance of parameters and of the starts."""
        residuals, covariance, sigma = found.residuals, found.covariance, None
        dof = residuals.size - len(covariance)
        if self.is_absolute:
            covariance, residuals = covariance / self.unit**2, residuals * self.unit
            if self.loss is not LOSSES["linear"]:
                slopes, known = found.jacobian * self.unit, len(self.unknowns.priors)
                covariance = robust(self.loss, residuals, slopes, covariance, known)
        else:
            deviation = np.sqrt(residuals @ residuals / dof)  # in the unit of the weights
            covariance = covariance * deviation**2
            unit = float(self.motions[0].data.weights[0, 0])
            sigma, residuals = float(deviation) * unit, residuals * unit
        names, spreads = self._spreads(len(covariance))
        spread_out = spreads @ covariance @ spreads.T
        moved = spreads @ self._moved_by_finer_steps(found.jacobian)
        words = [said, self._said_of_residuals(found)]
        at = self.unknowns.theta(self.params), self.bounds
        words.append(remarks.of_bounds(names, *at, np.sqrt(np.diagonal(spread_out))))
        cuts = np.cumsum([int(motion.is_there.sum()) for motion in self.motions])
        trials = [
            Fitted(motion.params, motion.start, -own, *motion.measured, motion.solution)
            for motion, own in zip(self.motions, np.split(residuals, cuts), strict=False)
        ]
        fit = Fit(
            params=self.params, trials=tuple(trials), names=tuple(names), covariance=spread_out,
            residuals=-residuals, sigma=sigma, dof=dof, evaluations=self.evaluations,
        )  # fmt: skip
        words.append(remarks.of_step(fit, moved))
        return replace(fit, message="; ".join(filter(None, words)))

    def _spreads(self, width: int) -> tuple[list[str], Array]:
        """Return the names of all that was fitted, and its derivatives by the unknowns."""
        own, names, places = len(self.bounds), [*self.unknowns.names], self.model.system.places
        each = [(state, x) for state in self.model.system.states for x in places[state]]
        rows = [k for k, (state, _) in enumerate(each) if state in self.unknowns.free]
        spreads = [np.eye(own, width)]
        for k, motion in enumerate(self.motions if rows else ()):
            prefix = f"trials[{k}]." if len(self.motions) > 1 else ""
            names += [f"{prefix}{each[row][0]}.{each[row][1]}" for row in rows]
            slopes, part = motion.slopes_of_start()[rows], np.zeros((len(rows), width))
            part[:, :own] = slopes[:, :own]
            part[:, self._cuts[k] : self._cuts[k + 1]] = slopes[:, own:]
            spreads.append(part)
        return names, np.concatenate(spreads)

    def _moved_by_finer_steps(self, jacobian: Array) -> Array:
        """Return how far the unknowns move with half the step, by one step of Gauss and Newton.

        They are NaN where no such run is.
        """
        self.evaluations += len(self.motions)
        try:
            off = [motion.moved_by_finer_steps() for motion in self.motions]
        except IntegrationError:
            return np.full(jacobian.shape[1], np.nan)
        sizes = np.concatenate([motion.sizes() for motion in self.motions])
        if np.linalg.norm(np.concatenate(off)) <= EXACT * np.linalg.norm(sizes):
            return np.zeros(jacobian.shape[1])
        off.append(np.zeros(len(self.unknowns.priors)))
        scales = np.linalg.norm(jacobian, axis=0)
        change = np.linalg.lstsq(jacobian / scales, np.concatenate(off), rcond=None)[0]
        found: Array = -change / scales
        return found
