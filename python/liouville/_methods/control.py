"""Control of the steps: by their number, by an estimate of their error, or by a monitor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.arguments import MOST_STEPS, count, interval, number
from liouville._basics.errors import hinted, misshapen

#: Below this, the errors of a method of order 2 are those of roundoff.
LEAST_TOLERANCE = 1e-12

#: The controls, by the names that the core has for them.
CONTROLS = ("error", "reversible")
#: Equal steps, of a number that trial runs find for a tolerance.
TRIAL = ("trial",)

#: The absolute tolerance by default, in units of the relative one.
SMALL = 1e-3

#: The least step by default, in units of the last digit of t.
DIGITS = 64

#: The spelling of controls that are given by a word.
SPELLINGS = {
    "error": "give rtol= alone, or with control=lv.Adaptive(h_min=...)",
    "reversible": "give control=lv.Reversible(monitor=..., h_min=...)",
}


@dataclass(frozen=True)
class Adaptive:
    r"""Steps by an estimate of their error, with the tolerances ``rtol`` and ``atol`` of the call.

    A step is kept if its error :math:`\epsilon_n`, the root mean square over the coordinates of
    :math:`e_i / (\mathrm{atol}_i + \mathrm{rtol}\,|y_i|)` with the estimates :math:`e_i`, is at
    most 1, and is made again shorter otherwise. ``Spark`` on Gauss points asks the same of the
    velocities, in units of rtol times the largest so far of each, with atol over the longest step
    so far; other methods estimate errors of the coordinates alone. No unit is below a thousand
    roundings. A PI controller gives the next step, :math:`h_{n+1} = 0.9\, \epsilon_n^{-0.7/k}
    \epsilon_{n-1}^{0.4/k}\, h_n` with the order k of the estimate, within 0.2 to 4 times the last.
    Such steps suit forces that dissipate and short runs: in a long run they lose what a symplectic
    method keeps. ``Spark``, ``LobattoPair`` and the alpha family take it. With ``rtol`` alone,
    without this control, the alpha family makes reversible steps on systems whose energy nothing
    changes: these keep the energy as equal steps do.

    Parameters
    ----------
    h_min : float, optional
        The run fails where it would need a smaller step, in the system's unit of time; by default
        where the time has too few digits for it.

    References
    ----------
    :cite:t:`gustafsson1991`; :doc:`/theory/steps` has the estimates.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> run = lv.integrate(
    ...     pendulum.system, lv.Spark(3), t=(0, 1), rtol=1e-6, control=lv.Adaptive(h_min=1e-9),
    ...     **pendulum.start
    ... )
    >>> bool(run.stats["h_smallest"] > 1e-9)
    True
    """

    h_min: float | None = None


@dataclass(frozen=True)
class Reversible:
    r"""Steps that follow a monitor by a rule that is the same forwards and backwards in time.

    With a monitor :math:`\sigma(t, y, z) > 0` and its rate
    :math:`\omega_n = \dot\sigma / \sigma` along the motion at state n, the steps around it are

    .. math::

        \frac{1}{h_{n+1/2}} = \frac{1}{h_{n-1/2}} - \omega_n

    in two halves whose ratios are bounded by 2/3 and 3/2. A symmetric method keeps its long-time
    behaviour with such steps; only symmetric methods take them. The ``h`` of the call is the step
    at the start.

    Parameters
    ----------
    monitor : callable, optional
        ``monitor(t, q, v, params)`` (the system's own states), a positive scalar: how long steps
        should be, up to a factor, which `h` gives. By default a time scale of the acceleration,
        :math:`r^{3/2}` near a centre of gravity; a ``SemiExplicit`` system has no default.
    h_min : float, optional
        As for :class:`Adaptive`.

    References
    ----------
    :cite:t:`hairer2005`; :doc:`/theory/steps`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> slow = lv.Reversible(monitor=lambda t, q, v, params: 1 / (1 + v[0] ** 2))
    >>> run = lv.integrate(
    ...     pendulum.system, lv.Spark(3), t=(0, 1), h=0.01, control=slow, **pendulum.start
    ... )
    >>> run.status
    'done'
    """

    monitor: Callable[..., Any] | None = None
    h_min: float | None = None


Control = Adaptive | Reversible


@dataclass(frozen=True)
class Steps:
    """How a run goes from t0 to t1: `count` equal steps, or controlled ones.

    `control` is what the core takes: "error" with rtol, atol of shape (n,), the first step or 0
    where the method is to choose it, and the least, which "trial" has too until equal steps are
    found; or "reversible" with the first and the least.
    """

    t0: float
    t1: float
    count: int = 1
    control: tuple[Any, ...] | None = None
    #: The control that equal steps were found for by trial runs, and how many steps these made.
    trial: tuple[tuple[Any, ...], int] | None = None

    @property
    def total(self) -> str:
        """Return " of 100" for a message, where the number of steps is known."""
        return f" of {self.count}" if self.control is None else ""

    @property
    def asked(self) -> tuple[Any, ...] | None:
        """The control of the steps, or that which equal ones were found for."""
        return self.control if self.trial is None else self.trial[0]

    @property
    def tolerances(self) -> dict[str, float | list[float]]:
        """Return the numbers that control the steps, empty for equal steps."""
        control = self.asked
        if control is None:
            return {}
        if control[0] == "reversible":
            return {"h": control[1]}
        _, rtol, atol, _, _ = control
        return {"rtol": rtol, "atol": float(atol[0]) if np.ptp(atol) == 0 else atol.tolist()}

    @property
    def unit(self) -> str:
        """The unit of progress."""
        return "steps" if self.control is None else "of time"

    def mean(self, end: float, steps: int) -> float:
        """Return the step, or the mean of those made up to the time `end`."""
        if self.control is None:
            return (self.t1 - self.t0) / self.count
        return (end - self.t0) / steps if steps else 0.0

    def records(self, every: int) -> int:
        """Return how many states are kept of equal steps, with the start and the end."""
        return -(-self.count // every) + 1


@dataclass(frozen=True)
class Takes:
    """The controls of :data:`CONTROLS` that a method takes, its least tolerance, and a hint.

    `estimators` are methods for the system that estimate their errors, `times` is the hint on
    times in the place of a start and an end.
    """

    name: str
    controls: tuple[str, ...] = ()
    least: float = LEAST_TOLERANCE
    hint: str = "give h or steps, or take a method that controls its steps, such as HHT"
    estimators: str = "Spark or HHT"
    times: str = "t=(start, end) is the run; t_eval= takes the times whose states you want"


def steps_of(
    t: Any,
    h: Any,
    steps: Any,
    takes: Takes,
    *,
    rtol: Any = None,
    atol: Any = None,
    control: Any = None,
    coordinates: Sequence[str] = (),
) -> Steps:
    """Return the steps asked for, of a method that takes these controls."""
    t0, t1 = interval(t, takes.times)
    kind = _kind(rtol, atol, control, takes)
    if kind is None:
        if (h is None) == (steps is None):
            more = ", or rtol" if not steps and set(takes.controls) & {"error", *TRIAL} else ""
            raise TypeError(f"give either h or steps{more}")
        return equal_steps(t0, t1, h, steps)
    if steps is not None:
        asks = "control=Reversible(...)" if kind == "reversible" else "rtol, which controls them"
        raise TypeError(f"give either steps, which are equal, or {asks}")
    h_min = None if control is None else control.h_min
    if kind == "reversible":
        if h is None:
            raise TypeError("control=Reversible(...) takes h, the step at the start")
        return Steps(t0, t1, control=(kind, *_bounds(t0, t1, h, h_min)))
    relative = _relative(rtol, takes.least)
    bounds = _bounds(t0, t1, h, h_min)
    return Steps(t0, t1, control=(kind, relative, _absolute(atol, relative, coordinates), *bounds))


def _kind(rtol: Any, atol: Any, control: Any, takes: Takes) -> str | None:
    """Return which control is asked for, and refuse what belongs to another."""
    if rtol is None and atol is None and control is None:
        return None
    if not isinstance(control, Adaptive | Reversible | None):
        hint = SPELLINGS.get(control, "") if isinstance(control, str) else ""
        hint = hint or "give control=lv.Adaptive(...) or control=lv.Reversible(...)"
        raise TypeError(
            hinted(f"control must be an Adaptive or a Reversible, not {control!r}", hint)
        )
    given = {"rtol": rtol, "atol": atol, "control": control}
    asked = [name for name, value in given.items() if value is not None]
    if takes.controls == TRIAL:
        if control is None and rtol is not None:
            return TRIAL[0]
        asked = ["control" if rtol is None and atol is None else "atol without rtol"]
    if not takes.controls or takes.controls == TRIAL:
        raise TypeError(hinted(f"{takes.name} takes equal steps and no {asked[0]}", takes.hint))
    if isinstance(control, Reversible):
        if "reversible" not in takes.controls:
            sentence = f"{takes.name} is not symmetric, as reversible steps want it"
            raise TypeError(hinted(sentence, "take Spark on Gauss points"))
        if asked[0] != "control":
            raise TypeError(f"control=Reversible(...) takes no {asked[0]}")
        return "reversible"
    if "error" not in takes.controls:
        sentence = f"{takes.name} does not estimate its errors"
        raise TypeError(hinted(sentence, f"give h or steps, or take {takes.estimators}"))
    if rtol is None:
        if control is None:
            raise TypeError(hinted("atol is for controlled steps", "give rtol= too"))
        raise TypeError("control=Adaptive(...) takes rtol, the relative tolerance")
    return "error"


def _relative(rtol: Any, least: float) -> float:
    value = number("rtol must be a number", rtol)
    if not least <= value < 1:
        raise ValueError(f"rtol must be from {least:g} to below 1, not {value:g}")
    return value


def _absolute(atol: Any, rtol: float, coordinates: Sequence[str]) -> np.ndarray:
    """Return the absolute tolerances of all coordinates."""
    n = len(coordinates)
    if atol is None:
        return np.full(n, SMALL * rtol)
    try:
        values = np.asarray(atol)
    except ValueError:  # ragged
        values = np.array(None)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"atol must be a number or an array of numbers, not {atol!r}")
    if values.shape not in ((), (n,)):
        raise misshapen("atol", values.shape, f"() or ({n},)")
    values = np.array(np.broadcast_to(values, n), dtype=float)
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if bad.size:
        name, value = coordinates[bad[0]], values[bad[0]]
        raise ValueError(
            hinted(
                f"atol must be positive and finite, not {value:g} for '{name}'",
                "it says which change does not matter; without atol= that is rtol / 1000",
            )
        )
    return values


def _bounds(t0: float, t1: float, h: Any, h_min: Any) -> tuple[float, float]:
    """Return the first step, or 0, and the least."""
    whole = abs(t1 - t0)
    first = 0.0 if h is None else min(_step("h", h), whole)
    if h_min is None:
        least = DIGITS * float(np.spacing(max(abs(t0), abs(t1))))
        least = min(least, first) if first else least
    else:
        least = _step("h_min", h_min)
        if least > whole * (1 + 1e-9):
            raise ValueError(f"h_min = {least:g} is larger than the interval, {whole:g}")
        if first and least > first:
            raise ValueError(f"h_min = {least:g} is larger than the first step, h = {first:g}")
    _check_moves(math.copysign(least, t1 - t0), max(t0, t1, key=abs))
    return first, least


def equal_steps(t0: float, t1: float, h: Any, steps: Any) -> Steps:
    """Return equal steps: `steps` of them, or the fewest that are not longer than h."""
    if h is None:
        n = float(min(count("steps", steps), MOST_STEPS))
    else:
        n = abs(t1 - t0) / min(_step("h", h), abs(t1 - t0)) * (1 - 1e-12)
    if n >= MOST_STEPS:
        what = "steps" if h is None else f"h = {h:g}"
        raise ValueError(f"{what}: more than {MOST_STEPS:.0e} steps cannot be counted")
    n = math.ceil(n)
    _check_moves((t1 - t0) / n, t0)
    return Steps(t0, t1, n)


def _step(name: str, value: Any) -> float:
    size = number(f"{name} must be a number", value)
    if not (math.isfinite(size) and size > 0):
        hint = "to go backwards, give t=(end, start)"
        raise ValueError(hinted(f"{name} must be positive and finite, not {size}", hint))
    return size


def _check_moves(step: float, t: float) -> None:
    if t + step == t:
        raise ValueError(f"a step of {step:g} does not move t = {t:g}")
