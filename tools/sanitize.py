"""Run the core's tests under sanitizers: what ``make sanitize`` runs.

Accesses to memory by the address sanitizer, races of threads by the thread sanitizer, and the one
module with unsafe code, the evaluation of tapes, by the interpreter Miri. The first comes with
every Rust; the others want components of a nightly one, and where these are missing that is said.
"""

# ruff: noqa: T201

import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

TESTS = ["-p", "liouville-tests", "--test", "all"]

#: Elementary functions in plain Rust: Miri has no assembly.
SOFT = ["--features", "libm/force-soft-floats"]

#: Tests that work with several threads.
THREADED = ["ensemble", "together", "split_operator", "memory"]


@dataclass(frozen=True)
class Check:
    """A command of cargo's, what it wants of the environment, and what must be installed for it."""

    name: str
    command: list[str]
    environment: dict[str, str]
    wants: dict[str, bool] = field(default_factory=dict)


def said(*command: str) -> str:
    """Return what a command says, nothing if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def checks() -> list[Check]:
    """Return what can be run, and what it wants."""
    lines = said("rustc", "-vV").splitlines()
    host = dict(line.split(": ", 1) for line in lines if ": " in line).get("host", "")
    nightly = said("rustc", "+nightly", "--print", "sysroot")
    has_sources = (Path(nightly) / "lib/rustlib/src/rust/library").is_dir() and bool(nightly)
    linux = {"Linux on x86-64, whose sanitizers come with Rust": host.startswith("x86_64-unknown-")}
    # a test asks for more memory than there is, and is to be told so
    options = {"ASAN_OPTIONS": "allocator_may_return_null=1"}
    address = {"RUSTC_BOOTSTRAP": "1", "RUSTFLAGS": "-Zsanitizer=address", **options}
    thread = {"RUSTFLAGS": "-Zsanitizer=thread"}
    test = ["test", "--release", "--target", host, *TESTS]
    return [
        Check("address", ["cargo", *test], address, linux),
        Check(
            "thread",
            ["cargo", "+nightly", *test, "-Zbuild-std", "--", *THREADED],
            thread,
            linux | {"the component rust-src of the nightly toolchain": has_sources},
        ),
        Check(
            "miri",
            ["cargo", "+nightly", "miri", "test", *TESTS, *SOFT, "--", "tape"],
            {"MIRIFLAGS": "-Zmiri-disable-isolation -Zmiri-deterministic-floats"},
            {
                "the component miri of the nightly toolchain": bool(
                    said("cargo", "+nightly", "miri", "--version")
                ),
                "the component rust-src of the nightly toolchain": has_sources,
            },
        ),
    ]


def main() -> int:
    """Run all that the toolchain can; returns the exit status."""
    chosen, failed = sys.argv[1:], []
    for check in checks():
        if chosen and check.name not in chosen:
            continue
        missing = [what for what, is_there in check.wants.items() if not is_there]
        if missing:
            print(f"{check.name}: not run, for want of {' and of '.join(missing)}")
            continue
        target = {"CARGO_TARGET_DIR": str(ROOT / "target" / check.name)}
        environment = {**os.environ, **check.environment, **target}
        print(f"{check.name}:", *check.command, flush=True)
        if subprocess.run(check.command, cwd=ROOT, env=environment, check=False).returncode:
            failed.append(check.name)
    if failed:
        print("failed:", *failed)
    return len(failed) > 0


if __name__ == "__main__":
    sys.exit(main())
