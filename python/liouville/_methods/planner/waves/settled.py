"""Plans for an H without time: a splitting of the ladder, a Chebyshev series, or Krylov spaces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from liouville._basics.arguments import memory
from liouville._basics.errors import hinted
from liouville._methods import Chebyshev, Lanczos, SchrodingerSplitting
from liouville._methods.planner.waves.ladder import Choice, cheapest
from liouville._methods.planner.waves.plan import LEAST_NORM, NORM_TIMES, WavePlan, planned
from liouville._methods.planner.waves.propagators import Krylov, Series, Shears
from liouville._methods.planner.waves.span import LEFT_OUT, Span, check_forwards
from liouville._methods.planner.waves.speed import series_cost
from liouville._methods.planner.waves.windows import LITTLE, SERIES, Windows, windows_of
from liouville._systems import Schrodinger

#: Beyond so many steps a stable method is taken.
MANY = 50

#: Krylov spaces of fewer dimensions are compared with these, and refused for more products than the
#: second of these if they are so many times theirs: hours.
ENOUGH, HOPELESS, TIMES = 12, 1e7, 1e3


@dataclass(frozen=True)
class Settled:
    """An H without time, the span of a run, and whether its start is known to be real."""

    system: Schrodinger
    span: Span
    is_real: bool

    def plan(self, method: SchrodingerSplitting | Chebyshev | Lanczos) -> WavePlan:
        """Choose the steps of a method; one of mode "auto" may become a series."""
        self.span.check_reach(method.tol)
        if isinstance(method, Lanczos):
            return self._lanczos(method)
        if isinstance(method, Chebyshev):
            return self._series(method, self._windows(method.tol), "asked for")
        if method.mode == "auto" and not self.system.is_real:
            why = "H is complex and no gauge makes it real"
            return self._series(method, self._windows(method.tol), why)
        return self._fewest(method) if method.mode == "auto" else self._asked(method)

    def _asked(self, method: SchrodingerSplitting) -> WavePlan:
        """Return the splitting of a mode; ValueError if none reaches the tolerance."""
        found = self._splitting(method)
        if found is None:
            raise ValueError(
                hinted(
                    f"no {method.mode} splitting reaches tol = {method.tol:g} for a span of "
                    f"{self.span.thetas.sum():.3g} / beta",
                    "give a larger tol, or mode='auto', which takes a Chebyshev series then",
                )
            )
        return self._split(method, found)

    def _fewest(self, method: SchrodingerSplitting) -> WavePlan:
        """Return the plan for this tolerance or a tighter one, so that none of these takes fewer.

        A splitting may be faster though it takes more products, and stable ones come in where steps
        are many, so that products alone could fall where the tolerance does. Tolerances are
        compared four to a decade.
        """
        best: WavePlan | None = None
        for tol in self._tolerances(method.tol):
            plan, fewest = self._automatic(replace(method, tol=tol))
            if best is None or plan.products < best.products:
                best = plan
            if fewest >= best.products:
                break
        assert best is not None
        return replace(best, method=method)

    def _tolerances(self, tol: float) -> Iterator[float]:
        """Give powers of ten at steps of a quarter from a tolerance on, as far as within reach."""
        k = np.floor(4 * np.log10(tol) + 1e-9)
        if 10 ** (k / 4) < self.span.least:
            yield tol
        while (grid := float(f"{10 ** (k / 4):.12g}")) >= self.span.least:
            yield min(grid, tol)
            k -= 1

    def _automatic(self, method: SchrodingerSplitting) -> tuple[WavePlan, float]:
        """Return the plan for a tolerance, and the fewest products of any other for it."""
        thetas, found = self.span.thetas, self._splitting(method)
        least = np.inf if found is None else self._fast(method, found).shears / 2
        needed = SERIES * float(thetas.max())
        if found is not None and needed > LITTLE and needed > memory():
            return self._split(method, found), least
        windows = self._windows(method.tol)
        series = self._series(method, windows)
        least = min(least, series.products)
        if found is None:
            why = f"no splitting reaches {method.tol:g} over {thetas.sum():.3g} / beta"
            return replace(series, reasons=(why, *series.reasons)), least
        return _faster(self.system, self._split(method, found), series, windows.terms), least

    def _splitting(self, method: SchrodingerSplitting) -> Choice | None:
        thetas, tol = self.span.thetas, method.tol - self.span.roundoff
        found = cheapest(thetas, tol, method.mode == "stable")
        if found is not None and method.mode == "auto" and found.steps.sum() > MANY:
            return cheapest(thetas, tol, True) or found
        return found

    def _fast(self, method: SchrodingerSplitting, found: Choice) -> Choice:
        """Return the cheapest splitting where a stable one was taken."""
        if not found.rung.stable:
            return found
        return cheapest(self.span.thetas, method.tol - self.span.roundoff, False) or found

    def _split(self, method: SchrodingerSplitting, found: Choice) -> WavePlan:
        span, rung, steps = self.span, found.rung, int(found.steps.sum())
        kind = "stable" if rung.stable else "fast"
        norm = found.bound
        if rung.stable:
            norm = min(norm, rung.norm_bound(found.x, steps, found.stretches))
        norm_tol = max(NORM_TIMES * (norm + span.roundoff), LEAST_NORM)
        why = "fewest products of the splittings that keep to the tolerance"
        if kind == "stable" and method.mode == "auto" and steps > MANY:
            why += f", stable ones beyond {MANY} steps"
        if not self.system.is_real:
            why += "; a shear by a complex H is a product"
        return planned(
            self.system, method, span,
            scheme=f"{rung.name} ({kind} splitting of {rung.n} shears)",
            steps=found.steps,
            theta=found.x,
            products=found.shears / (2 if self.system.is_real else 1),
            bound=found.bound + span.roundoff,
            reasons=(why,),
            core=Shears(rung.coefficients, span.sigma, norm_tol),
        )  # fmt: skip

    @cached_property
    def _least(self) -> Windows:
        """The windows of series for the least tolerance."""
        span, whole = self.span, float(self.span.intervals.sum())
        return windows_of(
            span.intervals, span.beta, (span.least - span.roundoff) / whole, self.system.size,
            self.is_real and self.system.is_real,
        )  # fmt: skip

    def _windows(self, tol: float) -> Windows:
        """Return the windows of series that share the tolerance.

        They are the same for every tolerance, so that a tighter one never takes fewer products.
        """
        span = self.span
        return replace(self._least, rate=(tol - span.roundoff) / float(span.intervals.sum()))

    def _series(
        self, method: SchrodingerSplitting | Chebyshev, windows: Windows, *why: str
    ) -> WavePlan:
        """One series for the outputs of each window."""
        span, counts = self.span, windows.counts
        norm_tol = max(NORM_TIMES * method.tol, LEAST_NORM)
        if windows.is_real:
            why = (*why, "the start is real, which halves the products of the first series")
        if counts.max() > 1:
            why = (*why, "outputs within a window take no products of their own")
        return planned(
            self.system, method, span,
            scheme=f"Chebyshev (series of degree {windows.degrees.max()})",
            theta=span.beta * float(windows.lengths.max()),
            products=windows.products,
            bound=method.tol,
            reasons=why,
            core=Series(span.bounds, windows.rate, norm_tol, tuple(counts.tolist())),
        )  # fmt: skip

    def _lanczos(self, method: Lanczos) -> WavePlan:
        """Estimate the products by steps that keep the bound of a Krylov space's error.

        Nothing grows where H absorbs, so that the bound is one of the run's error.
        """
        thetas, norm_tol = self.span.thetas, max(NORM_TIMES * method.tol, LEAST_NORM)
        why = "asked for; the number of products is that of a state of all energies"
        absorber, kind = self.system.absorber, "Lanczos"
        if absorber is not None:
            check_forwards(self.span.times[-1] - self.span.t0)
            thetas = thetas + 0.5 * float(absorber.max()) / self.system.hbar * self.span.intervals
            why, kind = why.replace("asked for", LEFT_OUT), "Arnoldi"
        products = _krylov_products(thetas, method.tol, method.dimension)
        if method.dimension < min(ENOUGH, self.system.size):
            other = _krylov_products(thetas, method.tol, ENOUGH)
            said = (
                f"spaces of dimension {method.dimension} take about {products:.2g} products, "
                f"those of dimension {ENOUGH} {other:.2g}"
            )
            if products > max(HOPELESS, TIMES * other):
                hint = f"give dimension={ENOUGH}, or a larger tol"
                sentence = f"{said}: for tol = {method.tol:g} steps of a low order are short"
                raise ValueError(hinted(sentence, hint))
            if products > 2 * other:
                why += f"; {said}"
        rate = method.tol / float(self.span.intervals.sum())
        return planned(
            self.system, method, self.span,
            scheme=f"{kind} (Krylov spaces of dimension {method.dimension})",
            theta=float(thetas.max()),
            products=products,
            bound=None if absorber is None else method.tol,
            reasons=(why,),
            core=Krylov(method.dimension, rate, norm_tol),
        )  # fmt: skip


def _faster(system: Schrodinger, splitting: WavePlan, series: WavePlan, terms: float) -> WavePlan:
    """Choose by the time of the products, and of the terms that are added to outputs."""
    why = [f"a Chebyshev series would take {series.products:g} products"]
    if series.products < splitting.products:
        cost, term = series_cost(system, series.products)
        slower = f"a product takes about {cost:g} times as long in a series as in a splitting"
        if terms:
            slower += (
                f", and adding a term to a state takes {term:g} of a product; there are "
                f"{terms:.0f} of them"
            )
        if cost * (series.products + term * terms) < splitting.products:
            other = f"a splitting would take {splitting.products:g} products"
            return replace(series, reasons=(*series.reasons, other, slower))
        why.append(slower)
    return replace(splitting, reasons=(*splitting.reasons, *why))


def _krylov_products(thetas: np.ndarray, tol: float, dimension: int) -> float:
    """Estimate the products of steps in Krylov spaces, for a state of all energies."""
    step = _krylov_step(dimension, tol / max(float(thetas.sum()), 1e-300))
    return dimension * float(np.maximum(np.ceil(thetas / step), 1).sum())


def _krylov_step(dimension: int, rate: float) -> float:
    r"""Return the longest step, in units of 1/beta, with an error of `rate` times it.

    The off-diagonal elements of Lanczos' matrix are about half a unit each for a state of all
    energies, and the error of a step s of m of them is at most :math:`(s / 2)^m / m!`.
    """
    m = dimension
    return float(np.exp((np.log(rate) + m * np.log(2.0) + math.lgamma(m + 1)) / (m - 1)))
