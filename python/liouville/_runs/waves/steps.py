"""The start, the steps and the times of a run of a Schrödinger equation, from the arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from liouville._basics.errors import hinted, misshapen
from liouville._methods import Magnus, SplitOperator, Stepped, WaveMethod
from liouville._methods.control import Steps, Takes, steps_of
from liouville._methods.planner import WavePlan
from liouville._runs.runner import Request, kept
from liouville._systems import Schrodinger

#: A run may have this in place of the potential of its grid or lattice.
POTENTIAL = "potential"


def is_stepped(method: WaveMethod | WavePlan, request: Request) -> bool:
    """Return whether steps have a given size; without one some methods choose their own."""
    chooses = isinstance(method, Magnus) or getattr(method, "tol", None) is not None
    if chooses and request.h is None and request.steps is None:
        return False
    return isinstance(method, Stepped)


def start_of(start: Mapping[str, Any]) -> Any:
    """Return psi of a start; TypeError where there is anything else but a potential."""
    if more := sorted(start.keys() - {"psi", POTENTIAL}):
        raise TypeError(f"a Schrodinger equation starts with psi=, not with {', '.join(more)}")
    if "psi" not in start:
        raise TypeError("start value 'psi' is missing: a Schrodinger equation takes psi=")
    return start["psi"]


def potentials_of(start: Mapping[str, Any], system: Schrodinger) -> np.ndarray | None:
    """Return the potentials of the members of a start, None where there are none."""
    if start.get(POTENTIAL) is None:
        return None
    given = np.asarray(start[POTENTIAL])
    shapes = system.with_potential(0.0).potential_shapes
    if given.shape[1:] not in shapes:
        wanted = " or ".join(f"(P, {', '.join(map(str, shape))})" for shape in shapes)
        raise misshapen(POTENTIAL, given.shape, f"{wanted} for P members")
    return given


def stops_of(
    times: tuple[float, ...],
    method: WaveMethod | WavePlan,
    request: Request,
    check: Callable[[int], None],
) -> list[tuple[float, int]]:
    """Return the times of the states that are kept, with the steps to each.

    How many there are is checked before they are made.
    """
    more = ", or SplitOperator(tol=), which chooses its steps" * isinstance(method, SplitOperator)
    takes = Takes(type(method).__name__, hint=f"give h or steps{more}")
    if more and all(x is None for x in (request.h, request.steps, request.rtol, request.atol)):
        raise TypeError(f"give either h or steps{more}")
    if len(times) > 2:
        if request.h is None or request.steps is not None or request.every != 1:
            sentence = f"a sequence of times are those to keep, for which {takes.name} takes h="
            given = [name for name in ("steps", "every") if getattr(request, name) not in (None, 1)]
            hint = f"leave {' and '.join(given)} out, and " * bool(given) + "give h"
            raise TypeError(hinted(sentence, hint))
        check(len(times))
        ends = [_steps(pair, request, takes) for pair in pairwise(times)]
        return [(each.t1, each.count) for each in ends]
    steps = _steps(times, request, takes)
    every = kept(steps, request.every)
    check(-(-steps.count // every) + 1)
    size = steps.mean(steps.t1, steps.count)
    whole = [(steps.t0 + k * size, every) for k in range(every, steps.count, every)]
    return [*whole, (steps.t1, steps.count - every * len(whole))]


def _steps(times: tuple[float, ...], request: Request, takes: Takes) -> Steps:
    return steps_of(
        times, request.h, request.steps, takes,
        rtol=request.rtol, atol=request.atol, control=request.control,
    )  # fmt: skip


def check_no_steps(name: str, request: Request) -> None:
    """Refuse steps for a method that chooses its own."""
    hint = "give the times of all states you want: t=np.linspace(t0, t1, 101)"
    for option in ("h", "steps", "rtol", "atol", "control"):
        if getattr(request, option) is not None:
            sentence = f"{name} chooses its steps by its tol and takes no {option}"
            raise TypeError(hinted(sentence, f"the tolerance is the method's, tol=1e-8; {hint}"))
    if request.every != 1:
        raise TypeError(
            hinted(f"{name} keeps the states at the times of t= and takes no every", hint)
        )
