"""Events: zeros of a function along a trajectory, and what they do to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.errors import hinted

#: The suffix of the names of states after a reset.
AFTER = "_after"

#: States by name, as arrays.
States = Mapping[str, np.ndarray]

#: Which zeros count: the sign of the change.
DIRECTIONS = {"both": 0, "up": 1, "down": -1}


@dataclass(frozen=True)
class Impact:
    r"""Newton's law of impact, as the reset of an :class:`Event` with a function :math:`e(t, q)`.

    .. math::

        e_t + e_q v^+ = -\varepsilon \, (e_t + e_q v^-), \qquad
        p^+ - p^- = e_q^T \Lambda + r_\lambda \hat\lambda

    The impulse :math:`\Lambda` acts along the gradient of :math:`e`, and :math:`\hat\lambda` are
    the impulses of all constraints, which hold after the impact too.

    Parameters
    ----------
    restitution : float or callable, default 1
        :math:`\varepsilon`, from 0 (no rebound) to 1 (no loss), or a function of the arguments of
        the event, whose values are taken as they are: beyond 1 the impact adds energy, below 0 the
        motion goes on through.

    Raises
    ------
    TypeError, ValueError
        It is no such thing.

    References
    ----------
    :cite:t:`glocker2001`; :doc:`/theory/steps`.

    Examples
    --------
    >>> import liouville as lv
    >>> ball = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0], q=("height",))
    >>> ground = lv.Event(lambda t, q, v, lam, params: q[0], "down", reset=lv.Impact(0.5))
    >>> run = lv.integrate(
    ...     ball, lv.Spark(2), t=(0, 3), h=0.1, events={"ground": ground}, q=[0.5], v=[0.0]
    ... )
    >>> run.events["ground"].t[:4].round(12).tolist()
    [1.0, 2.0, 2.5, 2.75]
    """

    restitution: float | Callable[..., Any] = 1.0

    def __post_init__(self) -> None:
        """Refuse what is no restitution."""
        given = self.restitution
        if callable(given):
            return
        if isinstance(given, (bool, np.bool_)) or not isinstance(given, int | float | np.number):
            raise TypeError(f"restitution must be a number or a function, not {given!r}")
        if not 0 <= given <= 1:
            raise ValueError(f"restitution must be from 0 to 1, not {given}")

    @property
    def is_elastic(self) -> bool:
        """Whether it undoes itself."""
        return not callable(self.restitution) and self.restitution == 1


@dataclass(frozen=True)
class Event:
    r"""A function :math:`e(t, q, v, \lambda)` whose changes of sign along a run are wanted.

    Parameters
    ----------
    function : callable
        ``function(t, q, v, lam, params)``, a scalar; called once with CasADi symbols. ``q`` and
        ``v`` are the system's own states: ``q`` and ``p`` of a ``Hamiltonian``, ``y`` and ``z`` of
        a ``Mechanical``. The multipliers are solved for only where it uses them. Of a
        ``SemiExplicit`` system, whose z takes their place, ``function(t, y, z, params)``; of a
        ``PolynomialField``, ``GriddedField`` or ``PotentialField``, without resets,
        ``function(t, x, params)``.
    direction : {"both", "up", "down"}
        Whether :math:`e` must grow or fall where it changes its sign, in the order of the run:
        one that goes backwards in time passes it the other way. A function that comes to zero where
        the run ends is met there. One that is zero where the run starts is not, as it is not known
        from which side it came, and as the run before has met it. An exception is an
        event with a direction and a reset that turns the motion back, as an :class:`Impact` does,
        from which the motion would go on in that direction: a ball that starts on its ground needs
        ``"down"``, and falls through with ``"both"``.
    terminal : bool or int, default False
        Whether the event ends the run, or how many of it do. All events at that time are kept.
    reset : Impact or callable, optional
        The state after the event, with which the run goes on: an :class:`Impact`, or a function of
        the same arguments that returns the velocities after it (``p`` of a ``Hamiltonian``, ``z``
        of a ``Mechanical``, ``y`` of a ``SemiExplicit``), or a mapping of states, such as
        ``{"q": ..., "v": ...}``, each whole or some entries by coordinate. This state is moved onto
        the constraints, as ``system.consistent`` moves a start, by impulses in the velocities.
        ``solution.events`` has both states: ``q`` and ``v`` before, ``q_after`` and ``v_after``.
        A record at the time of a reset is of the state after it, also the first and the last one.

    Raises
    ------
    TypeError, ValueError
        One of them is no such thing.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> lowest = lv.Event(lambda t, q, v, lam, params: q[0], direction="up", terminal=2)
    >>> run = lv.integrate(
    ...     pendulum.system, lv.Spark(4), t=(0, 9), h=0.1, events={"lowest": lowest},
    ...     **pendulum.start
    ... )
    >>> len(run.events["lowest"])
    2
    >>> run.message
    "event 'lowest' at t = 4.14372"
    """

    function: Callable[..., Any]
    direction: str = "both"
    terminal: bool | int = False
    reset: Impact | Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        """Refuse what is no event."""
        if not callable(self.function):
            raise TypeError(f"function must be a function, not {self.function!r}")
        if self.direction not in DIRECTIONS:
            raise ValueError(
                f"direction must be one of {', '.join(DIRECTIONS)}, not {self.direction!r}"
            )
        if not isinstance(self.terminal, (bool, np.bool_, int, np.integer)):
            raise TypeError(f"terminal must be True, False or a number, not {self.terminal!r}")
        if self.terminal < 0:
            raise ValueError(f"terminal must be at least 1, or False, not {self.terminal}")
        if not (self.reset is None or isinstance(self.reset, Impact) or callable(self.reset)):
            sentence = f"reset must be an Impact or a function, not {self.reset!r}"
            hint = "reset=lv.Impact(0.8), or a function that returns the velocities after it"
            raise TypeError(hinted(sentence, hint))


@dataclass(frozen=True)
class Touch(Event):
    """An event that is met too where its function is down to `size` and turns back."""

    size: float = 0.0


def named(events: Any) -> dict[str, Event]:
    """Return events by name, functions as events of default options."""
    if events is None:
        return {}
    if not isinstance(events, Mapping):
        hint = 'name it: events={"name": function}'
        raise TypeError(hinted(f"events must be a mapping of names, not {events!r}", hint))
    for name in events:
        if not isinstance(name, str) or not name:
            raise TypeError(f"the names of events must be nonempty strings, not {name!r}")
    return {
        name: event if isinstance(event, Event) else _plain(name, event)
        for name, event in events.items()
    }


def _plain(name: str, function: Any) -> Event:
    if not callable(function):
        raise TypeError(f"event '{name}' must be an Event or a function, not {function!r}")
    return Event(function)


def sides_of(states: States, names: Sequence[str]) -> list[list[np.ndarray]] | None:
    """Return states of an event by these names before its resets and after, None without resets."""
    if f"{names[0]}{AFTER}" not in states:
        return None
    return [[states[f"{name}{end}"] for name in names] for end in ("", AFTER)]
