"""Models by name or file, and their descriptions."""

from __future__ import annotations

import importlib.util
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import liouville as lv
from liouville import problems
from liouville._basics.errors import hinted
from liouville._solution.points import with_ends
from liouville.bodies import Assembly


def system_of(model: str) -> tuple[ModuleType, Any]:
    """Import a problem by its name or a model file, which runs it, and find the system in it."""
    path, _, attribute = model.rpartition(":") if ".py:" in model else (model, "", "system")
    if not path.endswith(".py"):
        module = problems.load(model)
        return module, module.system
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"there is no model file {path!r}")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(file.parent.absolute()))
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        lines = [
            f":{frame.lineno}"
            for frame in traceback.extract_tb(error.__traceback__)
            if Path(frame.filename) == file.absolute() or frame.filename == str(file)
        ]
        where = path + (lines[-1] if lines else "")
        raise ValueError(f"{where}: {type(error).__name__}: {error}") from error
    system = getattr(module, attribute, None)
    if isinstance(system, Assembly):
        raise TypeError(
            f"{attribute!r} of {path} is an assembly\nhint: its system is {attribute}.system()"
        )
    if not hasattr(system, "coordinates"):
        found = [name for name, value in vars(module).items() if hasattr(value, "coordinates")]
        raise ValueError(
            f"{path} has no system called {attribute!r}\n"
            f"hint: name one after a colon, {path}:NAME; it has {', '.join(found) or 'none'}"
        )
    return module, system


def start_of(module: ModuleType) -> float:
    """Give the time a model starts at."""
    return float(getattr(module, "interval", (0.0, None))[0])


def interval_of(module: ModuleType, until: float | None) -> tuple[float, float]:
    """Give the interval of a model, or up to another end."""
    _, last = getattr(module, "interval", (0.0, None))
    end = last if until is None else until
    if end is None:
        raise ValueError(
            "no end time was given\n"
            f"hint: give --until, or define interval = (t0, t1) in {module.__name__}.py"
        )
    return start_of(module), float(end)


def check_given(
    module: ModuleType, system: Any, until: float | None, step: bool, begin: Mapping[str, Any]
) -> None:
    """Name all that is missing of a run at once; `step` says whether it needs one."""
    missing = {}
    if until is None and not hasattr(module, "interval"):
        missing["the end time"] = "--until 10"
    if step and not hasattr(module, "h"):
        missing["the step size"] = "--h 0.01"
    guessed = ("z",) if hasattr(system, "unknowns") else ()
    for name in system.states:
        if name not in begin and name not in guessed:
            size = len(system.places[name]) if hasattr(system, "places") else 1
            values = ",".join(["0"] * min(size, 3) + ["..."] * (size > 3))
            missing[f"the start {name!r}"] = f"--start {name}={values}"
    if len(missing) > 1:
        *others, last = missing
        sentence = f"{', '.join(others)} and {last} are missing"
        hint = f"give {' '.join(missing.values())}, or define them in {module.__name__}.py"
        raise ValueError(hinted(sentence, hint))


def times_of(
    module: ModuleType,
    method: Any,
    span: tuple[float, float],
    at: Sequence[float] | None,
    keep: int,
    h: float | None,
    rtol: float | None,
) -> tuple[Any, list[float] | None, float | None]:
    """Give the times of a run, those of its records if they are given, and its step.

    Of a wave function the times are those of its records: by default as many as are to be kept.
    """
    at = times_at(span, at) if at else None
    if isinstance(method, lv.WavePlan):
        return method.times, at, h
    if method.form == "wave" and at:
        return times_at(span, [*span, *at]), None, h
    if method.form == "wave" and hasattr(method, "tol") and h is None:
        return kept_times(span, keep), at, h
    return span, at, step_of(module, method) if h is None and rtol is None else h


def kept_times(interval: tuple[float, float], keep: int) -> list[float]:
    """Give the times of the start and of so many wave functions, at equal distances."""
    times: list[float] = np.linspace(*interval, keep + 1).tolist()
    return times


def times_at(interval: tuple[float, float], at: Sequence[float]) -> list[float]:
    """Give these times to keep, in the order of the run."""
    first, last = interval
    at = with_ends(np.array(at, dtype=float), first, last).tolist()
    for t in at:
        if not min(interval) <= t <= max(interval):
            raise ValueError(
                f"--at {t:g} is outside the run, from {first:g} to {last:g}\n"
                "hint: give --until, or a time within"
            )
    return sorted(set(at), reverse=last < first)


def step_of(module: ModuleType, method: Any) -> float:
    """Give the model's step; one made for Spark(3), for about as much work with any method."""
    if not hasattr(module, "h"):
        raise ValueError(
            f"no step size was given\nhint: give --h, or define h in {module.__name__}.py"
        )
    return float(module.h) / (8 if method.form == "second order" else 1)


def reference_at(reference: Mapping[float, Any], t: float) -> dict[str, Any]:
    """Give the reference at a time, empty if there is none."""
    for time, states in reference.items():
        if abs(time - t) <= 1e-12 * max(abs(time), abs(t)):
            return dict(states)
    return {}
