"""Try the properties with cases that no run has seen, for a given time: what ``make fuzz`` runs.

``python tools/fuzz.py 300`` goes in rounds, each with a seed of its own: the properties of the core
with twenty times the cases of ``make test``, then those of the package with four times the
examples. The first that fails ends it, with the command that fails again.
"""

# ruff: noqa: T201

import argparse
import os
import re
import secrets
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: How many times the cases of ``make test``.
CORE_TIMES, PACKAGE_TIMES = 20, 4

#: A function that takes arguments is a property: proptest's macro gives them.
PROPERTY = re.compile(r"#\[test\]\s+fn (\w+)\(\s*[^)\s]")


def core_properties() -> list[str]:
    """Return the names of the properties of the core, from the sources of its tests."""
    places = sorted((ROOT / "crates" / "tests" / "tests").rglob("*.rs"))
    return [name for place in places for name in PROPERTY.findall(place.read_text("utf-8"))]


def rounds(seed: int) -> list[tuple[dict[str, str], list[str]]]:
    """Return the commands of a round and what they want of the environment."""
    core = {"PROPTEST_RNG_SEED": str(seed), "FUZZ_TIMES": str(CORE_TIMES)}
    package = {"FUZZ_TIMES": str(PACKAGE_TIMES)}
    cargo = [
        "cargo",
        "test",
        "--quiet",
        "--release",
        "-p",
        "liouville-tests",
        "--test",
        "all",
        "--",
    ]
    pytest = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "hypothesis and not slow"]
    profile = ["--hypothesis-profile=fuzz", f"--hypothesis-seed={seed}"]
    return [(core, [*cargo, "--", *core_properties()]), (package, [*pytest, *profile])]


def tried(environment: dict[str, str], command: list[str], seconds: float) -> bool:
    """Run a command for so long at most; returns whether nothing failed."""
    try:
        done = subprocess.run(
            command, cwd=ROOT, env={**os.environ, **environment}, timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return True
    if done.returncode == 0:
        return True
    words = [f"{name}={value}" for name, value in environment.items()]
    words += [f"'{word}'" if " " in word else word for word in command]
    print("\nfailed; the same cases again:\n  " + " ".join(words))
    return False


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seconds", type=float, help="how long to try")
    end = time.monotonic() + parser.parse_args().seconds
    while time.monotonic() < end:
        seed = secrets.randbits(32)
        print(f"seed {seed}", flush=True)
        for environment, command in rounds(seed):
            left = end - time.monotonic()
            if left > 0 and not tried(environment, command, left):
                return 1
    print("nothing failed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
