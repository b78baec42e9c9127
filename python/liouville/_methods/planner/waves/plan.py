"""Plans of wave functions: method, steps, products and the bound of the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._methods import Chebyshev, SchrodingerSplitting, SplitOperator, WaveMethod
from liouville._methods.planner.plan import AGAIN, Plan, check_fields, decoded
from liouville._methods.planner.waves.driven import driving
from liouville._methods.planner.waves.propagators import (
    Diagonal,
    Driven,
    Krylov,
    MagnusSteps,
    Processed,
    Propagator,
    Series,
    Shears,
    SplitSteps,
    read_propagator,
)
from liouville._methods.planner.waves.span import Span
from liouville._methods.schrodinger import LEAST_TOLERANCE, NYSTROM
from liouville._systems import Schrodinger
from liouville._systems.waves.bounds import Spectrum

#: Products of a splitting to a tolerance are fewer than so many for a state that is kept, and for
#: each 1 / beta: the tightest tolerances take 20.
MOST = 100.0

#: The norm may be off by ten times what method and roundoff promise, and by so much in any case.
NORM_TIMES, LEAST_NORM = 10.0, 1e-10

#: No run has more steps to a tolerance on a grid.
LONG = 1e9

#: What plans that can be saved have for the core, besides shears.
Planned = Series | Krylov | Diagonal | Driven | MagnusSteps | SplitSteps


def planned(
    system: Schrodinger,
    method: WaveMethod,
    span: Span,
    *,
    scheme: str,
    products: float,
    core: Propagator,
    reasons: tuple[str, ...],
    theta: float,
    bound: float | None = None,
    steps: Sequence[int] | np.ndarray | None = None,
) -> WavePlan:
    """Make the plan of a run over a span: `steps` to each state that is kept, one by default."""
    return WavePlan(
        method=method,
        reasons=reasons,
        scheme=scheme,
        t0=span.t0,
        stops=span.stops(np.ones(len(span.times)) if steps is None else steps),
        theta=theta,
        bounds=span.bounds,
        guarantee=span.spectrum.guarantee,
        products=products,
        bound=bound,
        core=core,
        is_complex=not system.is_real,
    )


@dataclass(frozen=True, repr=False)
class WavePlan(Plan):
    r"""The steps of a wave function with nothing left to choose, and why; see :class:`Plan`.

    Attributes
    ----------
    method : Method
        The method that was planned, with its tolerance.
    scheme : str
        What it takes, in words, such as ``"L32_9.4 (stable splitting of 32 shears)"``.
    t0 : float
        Time of the start.
    stops : tuple of (float, int)
        Times of the states that are kept, and the steps to each from the one before; a series
        makes the states of a window without steps, and counts one for each.
    theta : float
        Length of the longest step or window in units of :math:`1/\beta`, with :math:`\beta` half
        the width of the spectrum; for :class:`Magnus` without steps of a given size an estimate.
    bounds : tuple of float
        Smallest and largest eigenvalue it is safe for, in units of :math:`\hbar/t`.
    guarantee : str
        What these bounds are: ``"rigorous"``, ``"probable"``, ``"with probability 1 - 1e-6"`` or
        ``"given"``.
    products : float
        Products :math:`H \psi` it takes, two real ones each; for Lanczos an estimate, for
        :class:`Magnus` without steps of a given size an estimate of how many there may be, for
        :math:`H(t)` known by its products the least; pairs of FFTs for :class:`SplitOperator`, an
        estimate where it chooses its steps.
    bound : float or None
        A-priori bound of the error at the end, relative to the norm, roundings included; None
        where none is known.
    reasons : tuple of str
        Why, and what else there was.
    is_complex : bool
        Whether H is complex, and no gauge makes it real.
    """

    form: ClassVar[str] = "wave"
    method: WaveMethod
    reasons: tuple[str, ...]
    scheme: str
    t0: float
    stops: tuple[tuple[float, int], ...]
    theta: float
    bounds: tuple[float, float]
    guarantee: str
    products: float
    bound: float | None
    core: Propagator = field(repr=False, compare=False)
    is_complex: bool = False

    @property
    def steps(self) -> int:
        """Number of steps in all."""
        return sum(steps for _, steps in self.stops)

    @property
    def windows(self) -> int:
        """Number of series, each of which makes several states; 0 where steps make them."""
        if isinstance(self.core, Driven):
            return self.core.windows
        return len(self.core.windows) if isinstance(self.core, Series) else 0

    @property
    def times(self) -> tuple[float, ...]:
        """Times of the start and of the states that are kept."""
        return (self.t0, *(t for t, _ in self.stops))

    @property
    def is_settled(self) -> bool:
        """Whether it is for an H without time, which a drive may be a part of."""
        return isinstance(self.core, Shears | Series | Krylov | Diagonal | Processed)

    def check(self, times: Sequence[float], system: Schrodinger) -> None:
        """Refuse another equation, or other times, than it was made for."""
        if self.times != tuple(times):
            raise ValueError(hinted("the plan was made for other times", AGAIN))
        system = system.settled if self.is_settled else system
        of_time = isinstance(self.core, Driven | MagnusSteps)
        of_any = isinstance(self.core, MagnusSteps | SplitSteps)
        if not of_any and of_time != system.is_driven:
            kind = "without time" if system.is_driven else "that depends on time"
            raise ValueError(hinted(f"the plan was made for an H {kind}", AGAIN))
        span = float(np.abs(np.diff(times)).sum())
        tol = getattr(self.method, "tol", None) if isinstance(self.core, Driven) else None
        driven = driving(system, times, tol) if of_time else None
        known = [driven.spectrum] if driven else [system.spectrum(0.0), system.spectrum(span)]
        if isinstance(self.core, SplitSteps):
            known = [Spectrum(system.bounds_at(self.t0), system.guarantee)]
        if self.bounds not in [spectrum.bounds for spectrum in known]:
            raise ValueError(hinted("the plan was made for another spectrum", AGAIN))
        if self.is_complex == system.is_real:
            kind = "complex" if self.is_complex else "real"
            raise ValueError(hinted(f"the plan was made for a {kind} H", AGAIN))
        core, points = self.core, system.points_between(times[0], times[-1])
        # derivatives add breaks of their own
        is_same = driven is None or driven.parts == getattr(core, "parts", None)
        if not is_same or not set(points) <= set(getattr(core, "breaks", points)):
            raise ValueError(hinted("the plan was made for another H(t)", AGAIN))
        self._check_work(system, Span(times[0], tuple(times[1:]), known[-1]))

    def _check_work(self, system: Schrodinger, span: Span) -> None:
        """Refuse what only a crafted file says, and whose run would not end."""
        core, counts = self.core, np.array([float(count) for _, count in self.stops])
        for name in ("dimension", "tol"):
            own = getattr(core, name, None)
            if own is not None and own != getattr(self.method, name, None):
                raise ValueError(hinted(f"{self.method!r} has no {name} {own:g}", AGAIN))
        most = np.ones(counts.size)
        if isinstance(core, Shears):
            most = MOST * (span.thetas + 1.0) / max(0.5 * core.coefficients.size, 1.0)
        elif not isinstance(core, Diagonal):
            assert isinstance(core, Planned)
            error = core.rate * float(span.intervals.sum())
            least = span.least - span.roundoff
            if isinstance(core, SplitSteps):  # that of the state, which no plan knows
                least = LEAST_TOLERANCE
            if not 0.5 * least <= error <= 1.0:
                said = f"errors of {error:.3g} in all are none that a plan allows"
                raise ValueError(hinted(said, AGAIN))
        if isinstance(core, SplitSteps):
            own = usual_split(system, None)
            if isinstance(self.method, SplitOperator):
                own = self.method
            steps = (own.scheme, order_of(system, own), span.beta)
            if (core.scheme, core.order, core.beta) != steps:
                raise ValueError(hinted(f"its steps are not those of {own!r}", AGAIN))
            parts, longest = zip(*core.bands, (1.0, core.longest), strict=True)
            if not all(0 < part <= 1 for part in parts):
                said = f"{parts} are no parts of the wave numbers"
                raise ValueError(hinted(said, AGAIN))
            if not min(core.first, *longest) * LONG >= float(span.intervals.sum()):
                raise ValueError(hinted("its steps are too short for a run to end", AGAIN))
        if (counts > most).any():
            k = int((counts > most).argmax())
            said = f"{self.stops[k][1]} steps to t = {span.times[k]:g} are more than a plan has"
            raise ValueError(hinted(said, AGAIN))

    def propagated(self, system: Schrodinger) -> _core.Hamiltonian:
        """Return H as the plan has it: that of products may be the sum that it was found to be."""
        if isinstance(self.core, Driven) and self.core.by_differences:
            assert isinstance(self.method, SchrodingerSplitting | Chebyshev)
            found = system.separated(self.t0, self.stops[-1][0], self.method.tol)
            if found is not None:
                return found.hamiltonian
        return system.settled.hamiltonian if self.is_settled else system.hamiltonian

    def __repr__(self) -> str:
        """Name the scheme, steps and products."""
        return f"<WavePlan by {self.scheme}: {self._stages}, {self.products:g} products>"

    @property
    def _stages(self) -> str:
        """Windows or steps, by number."""
        count, word = (self.windows, "window") if self.windows else (self.steps, "step")
        return f"{count} {word}{'' if count == 1 else 's'}"

    def _lines(self) -> list[str]:
        low, high = self.bounds
        to = self.stops[-1][0]
        kept = f", {len(self.stops)} states kept" if len(self.stops) > 1 else ""
        bound = "not known beforehand" if self.bound is None else f"{self.bound:.1e}"
        return [
            self.scheme,
            f"  t = {self.t0:g} to {to:g} in {self._stages}{kept}; "
            f"{self.products:g} products H psi",
            f"  spectrum within [{low:.6g}, {high:.6g}] ({self.guarantee}), "
            f"theta = {self.theta:.4g} a {'window' if self.windows else 'step'}",
            f"  error at most {bound}",
            *self._why,
        ]

    @classmethod
    def _read(cls, given: dict[str, Any]) -> Self:
        core = read_propagator(decoded(given["core"]))
        plan = cls(
            **decoded({**given, "method": None, "core": None})
            | {"method": given["method"], "core": core}
        )
        if not isinstance(plan.method, WaveMethod) or not isinstance(core, Planned | Shears):
            raise TypeError(f"its method is {plan.method!r}, by {core.kind}")
        for each in (plan, core):
            check_fields(each)
        if not plan.stops:
            raise ValueError("it has no steps")
        return plan


def usual_split(system: Schrodinger, tol: float | None) -> SplitOperator:
    """Return the split operator that is taken where none is asked for."""
    return SplitOperator("BM6", tol) if system.mixes else SplitOperator(tol=tol)


def order_of(system: Schrodinger, method: SplitOperator) -> int:
    """Return the order of a split operator, with a coupling of components beside T."""
    return 4 if system.mixes and method.scheme in NYSTROM else method.order
