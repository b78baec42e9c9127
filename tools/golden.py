"""Golden end states: what every problem of the library comes to with every public method.

``python tools/golden.py --write`` integrates all cases and writes ``tests/data/golden.json``;
``--check`` integrates them again and prints for each whether it has the same bits, or else the
largest relative difference. ``--write pendulum`` and ``--check pendulum`` do so with those alone
whose names contain "pendulum".
``golden_cases.py`` has the cases. The value of one is a hash of the bits of all end states, and for
each state, as hexadecimal floats, its components or, of more than three, the first, the last and
the correctly rounded sum, of an ensemble or a derivative that alone.

The file begins with what is written by hand: ``resolved``, patterns of the cases whose solver was
replaced, and ``machine``, patterns of those whose bits depend on the processor (Fourier transforms,
LAPACK and dense panels of sparse LU choose instructions by it); both have the tolerances that hold
instead.
"""

# ruff: noqa: T201

import argparse
import fnmatch
import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from golden_cases import DATA, NAMES, Case, cases, differentiated, run

import liouville as lv

PLACE = DATA / "golden.json"

#: Less than any size, and not zero.
TINY = np.finfo(float).tiny

#: Quantities that a step solves for as h times themselves or h^2 times: roundoff in them is larger.
MULTIPLIERS = ("lam", "a")


def ends(case: Case) -> dict[str, np.ndarray]:
    """Return the end states of a run, or its derivatives."""
    if case.how == "gradient":
        return differentiated(case)
    return {name: values[-1] for name, values in run(case).states.items()}


def bits(states: Mapping[str, np.ndarray]) -> str:
    """Return a hash of all bits, without the sign of zeros."""
    parts = (np.ascontiguousarray(x + 0.0).tobytes() for x in states.values())
    return hashlib.sha256(b"".join(parts)).hexdigest()[:12]


def numbers(values: np.ndarray) -> list[float]:
    """Return what is kept of a state, of several rows the sum alone."""
    flat = np.ravel(values)
    parts = flat.view(float) if np.iscomplexobj(flat) else flat
    if values.ndim == 1 and parts.size <= 3:
        return [float(x) for x in parts]
    ends = [float(parts[0]), float(parts[-1])] if values.ndim == 1 else []
    return [*ends, math.fsum(parts)]


def written(states: Mapping[str, np.ndarray]) -> list[Any]:
    """Return a case as it stands in the file: all bits as a hash, and what the differences are of.

    A momentum is given by the velocity, and multipliers of an ensemble by its members.
    """
    hidden = ("p",) if "v" in states else ()
    kept = {
        name: " ".join(x.hex() for x in numbers(values))
        for name, values in states.items()
        if name not in hidden and not (name in MULTIPLIERS and values.ndim > 1)
    }
    return [bits(states), kept]


def difference(states: Mapping[str, np.ndarray], golden: Mapping[str, str]) -> dict[str, float]:
    """Return for each state how far it is from the golden one, relative to its largest part.

    The last number, a sum, is compared relative to the sum of the sizes of its parts. A derivative
    is relative to the largest one of its case that has no multipliers: it may vanish but for the
    roundoff of the terms that cancel.
    """
    found = {}
    others = (x for name, x in states.items() if name.removeprefix("d") not in MULTIPLIERS)
    largest = max((np.abs(x).max(initial=0.0) for x in others), default=0.0)
    for name, line in golden.items():
        wanted, flat = [float.fromhex(word) for word in line.split()], np.abs(states[name])
        part, size = max(flat.max(initial=0.0), TINY), max(flat.sum(), TINY)
        if name.startswith(("d", "by ")):
            part, size = max(part, largest), max(size, largest)
        ends = [part] * (len(wanted) - 1)
        apart = zip(numbers(states[name]), wanted, [*ends, size], strict=True)
        found[name] = max((abs(a - b) / size for a, b, size in apart), default=0.0)
    return found


def outcome(case: Case) -> dict[str, np.ndarray] | str:
    """Return the end states of a case, or the kind of error with which it is refused."""
    try:
        return ends(case)
    except (TypeError, ValueError, lv.IntegrationError) as error:
        return type(error).__name__


def excused(case: str, golden: Mapping[str, Any]) -> dict[str, float] | None:
    """Return the tolerances of a case that need not have the same bits."""
    for kind in ("resolved", "machine"):
        for entry in golden[kind]:
            if any(fnmatch.fnmatchcase(case, pattern) for pattern in entry["cases"]):
                return {"states": entry["states"], "multipliers": entry["multipliers"]}
    return None


def verdict(case: Case, golden: Mapping[str, Any]) -> tuple[bool, str]:
    """Compare a case with the file: whether it holds, and in words what came out."""
    found, name = outcome(case), str(case)
    refusal = golden["refused"].get(name)
    if isinstance(found, str):
        if refusal is None:
            return False, f"refused with {found}, had end states"
        return found == refusal, f"refused with {found}, as it was with {refusal}"
    if refusal is not None:
        return False, f"taken, was refused with {refusal}"
    hashed, states = golden["cases"][name]
    if bits(found) == hashed:
        return True, "same bits"
    apart = difference(found, states)
    worst = max(apart, key=lambda state: apart[state])
    told = f"differs by {apart[worst]:.1e} in {worst}"
    allowed = excused(name, golden)
    if allowed is None:
        return False, told
    kinds = {state: "multipliers" if state in MULTIPLIERS else "states" for state in apart}
    return all(apart[state] <= allowed[kind] for state, kind in kinds.items()), told


def load() -> dict[str, Any]:
    """Read the file."""
    found: dict[str, Any] = json.loads(PLACE.read_text(encoding="utf-8"))
    return found


def write(part: str) -> None:
    """Run the cases whose names contain `part` and write all, one a line, with what stays."""
    kept = load() if PLACE.exists() else {"resolved": [], "machine": []}
    states, refused = {}, {}
    for case in (case for problem in NAMES for case in cases(problem)):
        name = str(case)
        found = outcome(case) if part in name else kept["refused"].get(name)
        if isinstance(found, str):
            refused[name] = found
        else:
            states[name] = kept["cases"][name] if found is None else written(found)
    parts = {"resolved": kept["resolved"], "machine": kept["machine"]}
    parts |= {"refused": refused, "cases": states}
    PLACE.write_text(as_lines(parts), encoding="utf-8")
    print(f"{len(states)} cases and {len(refused)} refusals: {PLACE.stat().st_size} bytes")


def as_lines(parts: Mapping[str, Any]) -> str:
    """Return JSON with a line for each entry."""
    blocks = []
    for name, entries in parts.items():
        opened, closed = "[]" if isinstance(entries, list) else "{}"
        lines = (
            [json.dumps(entry) for entry in entries]
            if isinstance(entries, list)
            else [f"{json.dumps(k)}: {json.dumps(v)}" for k, v in entries.items()]
        )
        inside = ",\n".join(lines)
        blocks.append(f"{json.dumps(name)}: {opened}\n{inside}\n{closed}")
    return "{\n" + ",\n".join(blocks) + "\n}\n"


def check(part: str) -> bool:
    """Print the verdict on each case whose name contains `part`."""
    golden, count, broken = load(), 0, []
    for case in (case for problem in NAMES for case in cases(problem)):
        if part in str(case):
            holds, told = verdict(case, golden)
            print(f"{'      ' if holds else 'BROKEN'} {case}: {told}")
            count += 1
            if not holds:
                broken.append(case)
    print(f"{count - len(broken)} of {count} cases hold")
    return not broken


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", nargs="?", const="", metavar="PART", help="write it anew")
    parser.add_argument("--check", nargs="?", const="", metavar="PART", help="compare with it")
    given = parser.parse_args()
    if given.write is not None:
        write(given.write)
    return 0 if given.check is None else int(not check(given.check))


if __name__ == "__main__":
    raise SystemExit(main())
