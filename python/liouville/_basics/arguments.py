"""Checks of numbers, intervals and memory, before anything runs."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from liouville._basics.errors import hinted

#: Beyond this, a step's number and its time are no longer exact.
MOST_STEPS = 2**53

#: Of shorter times squares have no digits left, nor have their parts as small as roundoff.
SHORTEST = 1e-130


def number(wanted: str, value: Any) -> float:
    """Return a real number as a float; TypeError has the type wanted."""
    if type(value) is float:
        return value
    value = _scalar(value)
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise TypeError(f"{wanted}, not {value!r}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


class ReadOnly(dict[str, Any]):
    """A dict that refuses changes; a copy, or one from a pickle, is a plain dict."""

    def _refuse(self, *args: Any, **kwargs: Any) -> Any:
        """Say what changes a parameter."""
        sentence = "the parameters of a system cannot be changed"
        raise TypeError(hinted(sentence, "give other values to the call: params={...}"))

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the entries alone."""
        return dict, (dict(self),)


class Missing(KeyError):
    """A KeyError that shows its sentence as it is."""

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[0])


class Named(dict[str, Any]):
    """A dict whose KeyError has the names that there are."""

    def __missing__(self, name: Any) -> Any:
        """Refuse a name."""
        there = ", ".join(map(repr, self)) or "none"
        verb = "is" if len(self) == 1 else "are"
        raise Missing(hinted(f"there is no {name!r}", f"there {verb} {there}"))


def read_only(defaults: Mapping[str, np.ndarray]) -> ReadOnly:
    """Return values of parameters by name: floats, and read-only copies of arrays."""
    found = {name: x.copy() if x.ndim else float(x) for name, x in defaults.items()}
    for x in found.values():
        if isinstance(x, np.ndarray):
            x.setflags(write=False)
    return ReadOnly(found)


def kept(given: Any) -> Any:
    """Return copies of arrays and lists, also those by name, and anything else as it is."""
    if isinstance(given, Mapping):
        return {name: kept(x) for name, x in given.items()}
    return deepcopy(given) if isinstance(given, (np.ndarray, list)) else given


def large_integers(array: np.ndarray) -> np.ndarray:
    """Return integers beyond 64 bits as floats, infinite ones if need be; else the array itself."""
    if array.dtype != object or not all(type(x) is int for x in array.flat):
        return array
    return np.array([number("an integer", x) for x in array.flat]).reshape(array.shape)


def counted(number: int) -> str:
    """Return a number of things for a message: three digits of one too large to be counted."""
    if abs(number) <= MOST_STEPS:
        return str(number)
    digits = int(math.log10(number))
    return f"{number // 10 ** (digits - 2) / 100:g}e+{digits}"


def amount(count: int, noun: str, plural: str | None = None) -> str:
    """Return a number of things with their noun: 1 step, 2 steps."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


def _scalar(value: Any) -> Any:
    """Return an array without axes as the number in it, and anything else as it is."""
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def count(name: str, value: Any) -> int:
    """Return an integer that is at least 1."""
    value = _scalar(value)
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} must be an integer, not {value!r}")
    if value < 1:
        raise ValueError(f"{name} must be at least 1, not {value}")
    return int(value)


def interval(t: Any, hint: str = "") -> tuple[float, float]:
    """Return start and end of a finite interval that is not empty; the hint is on more times."""
    if not isinstance(t, (tuple, list, np.ndarray)) or len(t) != 2:
        is_many = isinstance(t, (tuple, list, np.ndarray)) and np.ndim(t) == 1 and len(t) > 2
        shown = f"{len(t)} times" if is_many else repr(t)
        sentence = f"t must be a pair (start, end), not {shown}"
        raise TypeError(hinted(sentence, hint) if hint and is_many else sentence)
    t0 = number("the start of t must be a number", t[0])
    t1 = number("the end of t must be a number", t[1])
    if not math.isfinite(t1 - t0):
        raise ValueError(f"t must be a finite interval, not ({t0:g}, {t1:g})")
    if t0 == t1:
        raise ValueError(f"t must end at another time than it starts, not ({t0:g}, {t1:g})")
    if abs(t1 - t0) < SHORTEST:
        sentence = f"t = ({t0:g}, {t1:g}) is too short: a time is {SHORTEST:g} long at least"
        raise ValueError(hinted(sentence, "take another unit of time"))
    return t0, t1


def times_of(t: Any) -> tuple[float, ...]:
    """Return a start and later times, or earlier ones: a pair, or as many as wanted."""
    if isinstance(t, np.ndarray) and t.ndim == 1:
        t = t.tolist()
    if not isinstance(t, (tuple, list)) or len(t) < 2:
        raise TypeError(f"t must be a pair (start, end) or a sequence of times, not {t!r}")
    times = tuple(number("t must be made of numbers", x) for x in t)
    interval((times[0], times[-1]))
    steps = np.diff(times)
    bad = np.flatnonzero(~(np.isfinite(steps) & (steps * np.sign(times[-1] - times[0]) > 0)))
    if bad.size:
        k = int(bad[0])
        sentence = "the times of t must rise, or all fall"
        raise ValueError(f"{sentence}: {times[k]:g} is followed by {times[k + 1]:g}")
    return times


#: Files with the memory that the groups of a process may take, and where those groups are.
GROUPS = {
    "": ("/sys/fs/cgroup", "memory.max"),
    "memory": ("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
}

#: The file with the groups of this process.
LISTED = "/proc/self/cgroup"

#: So many bytes are taken without a look at the limits, which takes longer than a step.
SMALL = 2**20


def memory() -> float:
    """Return the available bytes, by the machine, the process's groups and its limits."""
    there = 2**36
    if hasattr(os, "sysconf"):
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return 0.8 * max(0, min([there, *_of_groups(LISTED), *_of_limits()]))


def _of_groups(listed: str) -> Iterator[int]:
    """Give the limits of memory of the control groups (Linux) that a process is in."""
    try:
        with open(listed, encoding="utf-8") as lines:
            found = lines.read().splitlines()
    except (OSError, ValueError):
        return
    for line in found:
        _, controllers, path = line.split(":", 2)
        for controller in {"", "memory"}.intersection(controllers.split(",")):
            top, name = GROUPS[controller]
            # in a container the path may be that of the machine outside
            folder = os.path.join(top, path.strip("/")).rstrip("/")
            while len(folder) >= len(top):
                limit = _number_in(os.path.join(folder, name))
                if limit is not None:
                    yield limit
                folder = os.path.dirname(folder)


def _number_in(file: str) -> int | None:
    """Return the number that a file holds, if it is there and no word."""
    try:
        with open(file, encoding="utf-8") as text:
            return int(text.read())
    except (OSError, ValueError):
        return None


def _of_limits() -> Iterator[int]:
    """Give what the limits of the process itself (``ulimit -v`` and ``-d``) leave."""
    if sys.platform == "win32":
        return
    import resource

    used = [0] * 7
    if os.path.exists("/proc/self/statm"):
        with open("/proc/self/statm", encoding="utf-8") as sizes:
            used = [resource.getpagesize() * int(x) for x in sizes.read().split()]
    for kind, taken in ((resource.RLIMIT_AS, used[0]), (resource.RLIMIT_DATA, used[5])):
        limit, _ = resource.getrlimit(kind)
        if limit != resource.RLIM_INFINITY:
            yield limit - taken


def check_memory(what: str, needed: float, hint: str) -> None:
    """Refuse what would not fit in memory."""
    if needed > SMALL and needed > (there := memory()):
        sentence = f"{what} takes {_size(needed)}, with {_size(there)} available"
        raise MemoryError(hinted(sentence, hint))


def _size(count: float) -> str:
    number, unit = (count / 2**30, "GiB") if count >= 2**30 else (count / 2**20, "MiB")
    is_whole = 100 <= number < MOST_STEPS
    return f"{number:.0f} {unit}" if is_whole else f"{number:.3g} {unit}"
