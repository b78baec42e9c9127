"""Try a wheel and its sdist as someone would who has neither Rust nor a compiler.

``python tools/check_wheel.py dist/*.whl dist/*.tar.gz`` looks at what both contain, installs the
wheel alone into a fresh environment, runs the programs of README.md there, then its commands with
the extras that they need. ``--tests`` also unpacks the sdist and runs its own tests against the
wheel.
"""

# ruff: noqa: T201

import argparse
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
IN_SDIST = [
    "CHANGELOG.md",
    "Makefile",
    "crates/tests/Cargo.toml",
    "docs/index.md",
    "tests/conftest.py",
]
IN_WHEEL = ["liouville/__init__.py", "liouville/_core.pyi", "liouville/py.typed"]
COMPILERS = ["cargo", "rustc", "cc", "gcc", "clang", "c++"]
GUIDE = ROOT / "docs" / "guide" / "command_line.md"  # it has a model that README.md speaks of


class Environment:
    """A fresh virtual environment whose programs find nothing but each other."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, with_pip=True)
        self.programs = folder / ("Scripts" if os.name == "nt" else "bin")
        self.variables = {
            **{key: value for key, value in os.environ.items() if not key.startswith("PYTHON")},
            "PATH": str(self.programs),
        }
        found = [name for name in COMPILERS if shutil.which(name, path=str(self.programs))]
        if found:
            raise SystemExit(f"a fresh environment has {found}")

    def run(self, *command: str, cwd: Path) -> None:
        """Run one of its programs; where that fails, show what it said and end."""
        program = shutil.which(command[0], path=str(self.programs))
        if program is None:
            raise SystemExit(f"{command[0]} was not installed")
        done = subprocess.run(
            [program, *command[1:]],
            cwd=cwd,
            env=self.variables,
            check=False,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        if done.returncode != 0:
            failed = f"failed with {done.returncode}: {' '.join(command)}"
            raise SystemExit(f"{done.stdout}\n{failed}")

    def install(self, *requirements: str, cwd: Path = ROOT) -> None:
        """Install from wheels only."""
        pip = ("-m", "pip", "install", "--quiet", "--no-compile", "--only-binary", ":all:")
        self.run("python", *pip, *requirements, cwd=cwd)


def check_contents(wheel: Path, sdist: Path) -> None:
    """Check that the sdist is complete, and that the wheel has the package and nothing else."""
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    missing = [name for name in IN_SDIST if name not in names]
    names = set(zipfile.ZipFile(wheel).namelist())
    missing += [name for name in IN_WHEEL if name not in names]
    if missing:
        raise SystemExit(f"missing: {missing}")
    metadata = f"{'-'.join(wheel.name.split('-')[:2])}.dist-info/"
    strange = [
        name for name in names if not name.startswith(("liouville/", metadata, "liouville.libs/"))
    ]
    if strange:
        raise SystemExit(f"the wheel has {strange}, which are not the package's")
    if "-cp311-abi3-" not in wheel.name:
        raise SystemExit(f"{wheel.name} is not for the stable interface of Python 3.11 and later")


def blocks(page: Path, language: str) -> str:
    """Return the programs of a page in a language, one after the other."""
    found = re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
    return "\n".join(found)


def commands(page: Path) -> list[str]:
    """Return the calls of the program ``liouville`` on a page."""
    return re.findall(r"^(liouville .*?) *(?:#.*)?$", blocks(page, "sh"), re.M)


def run_tests(environment: Environment, wheel: Path, sdist: Path, folder: Path) -> None:
    """Run the tests that the sdist brings, with what the wheel has installed."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    unpacked = folder / sdist.name.removesuffix(".tar.gz")
    environment.install("pip>=25.1")
    environment.install(f"{wheel}[all]", "--group", "test", cwd=unpacked)
    environment.run("python", "-m", "pytest", "-q", "-n", "logical", cwd=unpacked)


def main() -> None:
    """Check what the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("wheel", type=Path)
    parser.add_argument("sdist", type=Path)
    parser.add_argument("--tests", action="store_true", help="run the tests of the sdist too")
    arguments = parser.parse_args()
    wheel, sdist = arguments.wheel.resolve(), arguments.sdist.resolve()
    check_contents(wheel, sdist)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = Environment(folder / "environment")
        environment.install(str(wheel))
        environment.run("python", "-c", blocks(README, "python"), cwd=folder)
        environment.install(f"{wheel}[cli,io,plot]")
        model = f"{blocks(GUIDE, 'python')}\nsystem = pendulum\n"
        (folder / "model.py").write_text(model, "utf-8")
        for command in commands(README):
            environment.run(*command.split(), cwd=folder)
        if arguments.tests:
            run_tests(environment, wheel, sdist, folder)
    size = wheel.stat().st_size / 1e6
    print(
        f"{wheel.name} ({size:.1f} MB) and {sdist.name} work in {sys.platform}'s fresh environment"
    )


if __name__ == "__main__":
    main()
