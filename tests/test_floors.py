"""The floors of the house: a module uses what lies below it, and each outside name has its room.

The tables are those of ``docs/house.md``. A failure names the file and the offending import.
"""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CRATES = ROOT / "crates"
PACKAGE = ROOT / "python" / "liouville"

# what a crate may use of the others is what its Cargo.toml says; these are the floors within each,
# and a crate without any is one room
CRATE_FLOORS = {
    "base": (
        ("bracket", "cancel", "checkpoint", "clone", "elementary", "error", "parallel"),
        ("number",),
        ("real",),
        ("simd",),
        ("compensated", "linalg", "observe"),
        ("linear", "tableau", "tape"),
        ("newton",),
        ("method",),
        ("composition", "recorder"),
        ("run",),
        ("ensemble",),
    ),
    "fourier": (),
    "problem": (),
    "small": (),
    "spark": (
        (
            *("estimate", "full_newton", "lanes", "node_schur", "predictor"),
            *("probe", "small_newton", "sparse_schur", "stages", "update", "yardstick"),
        ),
        ("rattle", "tangent"),  # the one falls back on the stage equations, the other follows them
    ),
    "alpha": (),
    "index2": (
        ("semi_explicit",),
        ("attempt", "estimate", "newton_matrix", "predictor", "probe", "stages"),
        ("tangent",),
    ),
    "mechanics": (("events",), ("run",)),
    "fields": (("problem",), ("volume",), ("run",)),
    "gridded": (),
    "waves": (("problem",), ("method",), ("run",)),
}
PACKAGE_FLOORS = (
    ("_core",),
    ("_basics",),
    ("_systems",),
    ("_methods",),
    ("_solution",),
    ("bodies",),
    ("_runs",),
    ("analysis",),
    ("_studies",),
    ("_bridges", "plot", "problems", "results"),
    ("_cli",),
    ("__main__",),
)
# the floors within a room; what is not listed there may use all of its room
ROOM_FLOORS = {
    "_basics": (
        ("casadi", "errors", "handlers", "html", "schema"),
        ("arguments", "checksum", "faults", "job", "locks", "options", "progress", "scipy"),
    ),
    "_systems": (
        ("events", "program", "tape"),
        ("tracing",),
        ("fields", "mechanics", "waves"),
        ("derivatives",),
        ("members",),
    ),
    "_methods": (("control",), ("splitting",), ("planner",)),
    "_solution": (
        ("contacts", "drifts", "exports", "failure", "motions", "points", "tangents"),
        ("chain_rule", "parts", "states"),
        ("computed",),
        ("solution",),
        ("export",),
    ),
    "_runs": (
        ("edges", "energy"),
        ("runner",),
        ("creeping",),
        ("execute", "tangents", "watch"),
        ("adjoint",),
        ("members_adjoint",),
        ("fields", "mechanics", "waves"),
        ("choice",),
        ("between", "contacts", "distribute"),
        ("ensemble", "gradients", "integrate"),
        ("stored",),
    ),
}
# to_xarray() and save() fetch the exporter when called, joint() and body() those of assemblies,
# integrate() what stores a run, a solution the method for states between its steps;
# starts of members are those of an ensemble, and tangents name the methods that have none;
# rotation numbers are those of a section
LAZY = {
    ("analysis", "_studies"),
    ("_solution", "bodies"),
    ("_solution", "_runs"),
    ("_solution.exports", "export"),
    ("_runs.integrate", "stored"),
    ("_runs.tangents", "choice"),
    ("_systems", "_runs"),
    ("_systems.mechanics", "members"),
}

CRATE_ROOMS = {
    "faer": ("base/src/linalg/sparse.rs",),
    "libm": ("base/src/tape/execute.rs",),
    "pulp": ("base/src/simd/",),
    "rayon": ("base/src/cancel.rs", "base/src/ensemble/", "base/src/parallel.rs"),
    "realfft": ("fourier/",),
    "rustfft": ("fourier/",),
    "twofloat": ("base/src/tableau/",),
    "pyo3": ("py/",),
    "numpy": ("py/",),
}
PACKAGE_ROOMS = {
    "casadi": ("_basics/casadi.py", "problems/"),
    "liouville._basics.casadi": (
        "_bridges/casadi.py",
        "_runs/contacts/",
        "_studies/optimal/",
        "bodies/",
        "_systems/",
    ),
    "google_crc32c": ("_runs/stored/folder.py",),
    "h5netcdf": ("_solution/export/",),
    "jax": ("_bridges/jax.py",),
    "matplotlib": ("plot/",),
    "mujoco": ("bodies/files.py",),
    "pyarrow": ("_solution/export/",),
    "rich": ("_cli/", "_basics/progress.py"),
    "scipy": (
        "_basics/scipy.py",
        "_solution/export/",
        "_systems/waves/graph.py",
    ),
    "skfem": ("_bridges/fem.py",),
    "sympy": ("_systems/sympy/"),
    "torch": ("_bridges/torch.py",),
    "typer": ("_cli/",),
    "xarray": ("_solution/export/", "_systems/fields/gridded/reading.py"),
    "zarr": ("_solution/export/",),
}


def rust_files():
    """Return the sources of all crates but the tests, as ``base/src/tape/mod.rs``."""
    names = (path.relative_to(CRATES).as_posix() for path in sorted(CRATES.glob("*/src/**/*.rs")))
    return [name for name in names if not name.startswith("tests/")]


def source(file):
    """Return a Rust file's text without its unit tests, which may look anywhere."""
    return (CRATES / file).read_text(encoding="utf-8").split("#[cfg(test)]")[0]


@cache
def python_files():
    return {path.relative_to(PACKAGE).as_posix(): path for path in sorted(PACKAGE.rglob("*.py"))}


def module(file):
    """Name the module a file belongs to: ``method/spark.rs`` is part of ``method``."""
    return file.split("/")[0].removesuffix(".rs").removesuffix(".py")


@cache
def imports(path):
    """Return every dotted name a file imports, but for annotations: ``liouville.bodies.Body``."""
    return [*_imports(path)]


def _imports(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    blocks = [node for node in ast.walk(tree) if isinstance(node, ast.If)]
    typing_only = [node for node in blocks if "TYPE_CHECKING" in ast.unparse(node.test)]
    for node in typing_only:
        node.body = [ast.Pass()]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = path.relative_to(PACKAGE.parent).with_suffix("").parts[: -node.level or None]
            prefix = ".".join(package) if node.level else ""
            source = ".".join(filter(None, (prefix, node.module)))
            yield from (f"{source}.{alias.name}" for alias in node.names)


def climbs(floors, user, used):
    """Say whether ``user`` reaches for its own floor or one above."""
    height = {name: floor for floor, names in enumerate(floors) for name in names}
    assert user in height, f"{user} has no floor: give it one in test_floors.py and docs/house.md"
    return user != used and height.get(used, -1) >= height[user]


FLOORED = [
    file
    for file in rust_files()
    if CRATE_FLOORS.get(file.split("/")[0]) and not file.endswith("src/lib.rs")
]


def used_by(file):
    """Return the modules of its own crate that a Rust file uses."""
    text = source(file)
    used = set(re.findall(r"\bcrate::(\w+)", text))
    for group in re.findall(r"\bcrate::\{(.*?)\};", text, re.DOTALL):
        used |= set(re.findall(r"(?:^|,)\s*(\w+)", re.sub(r"\{.*?\}", "", group, flags=re.DOTALL)))
    return used


def told(bad, does):
    """Say which files do what they should not."""
    return "\n".join(f"{file} {does} {sorted(names)}" for file, names in bad.items() if names)


def test_rust_modules_use_lower_floors_only():
    bad = {}
    for file in FLOORED:
        crate, path = file.split("/src/")
        floors, user = CRATE_FLOORS[crate], module(path)
        bad[file] = {name for name in used_by(file) if climbs(floors, user, name)}
    assert len(bad) > 100
    assert not any(bad.values()), told(bad, "uses what is not below it:")


def test_python_modules_use_lower_floors_only():
    bad = {}
    for file, path in python_files().items():
        if file != "__init__.py":
            user = module(file)
            used = {name.split(".")[1] for name in imports(path) if "liouville." in name}
            used -= {name for other, name in LAZY if other == user}
            bad[file] = {name for name in used if climbs(PACKAGE_FLOORS, user, name)}
    assert len(bad) > 100
    assert not any(bad.values()), told(bad, "imports what is not below it:")


@pytest.mark.parametrize("room", ROOM_FLOORS)
def test_modules_of_a_room_use_its_lower_floors_only(room):
    floors = ROOM_FLOORS[room]
    listed = {name for names in floors for name in names}
    inside = {file: path for file, path in python_files().items() if file.startswith(f"{room}/")}
    assert {module(file.removeprefix(f"{room}/")) for file in inside} >= listed
    bad = {}
    for file, path in inside.items():
        user = module(file.removeprefix(f"{room}/"))
        own = [name.split(".") for name in imports(path) if name.startswith(f"liouville.{room}.")]
        used = {words[2] for words in own}
        used -= {name for other, name in LAZY if other == f"{room}.{user}"}
        if user in listed:
            bad[file] = {name for name in used if climbs(floors, user, name)}
    assert not any(bad.values()), told(bad, "imports what is not below it:")


def test_the_package_has_few_rooms():
    assert len({module(file) for file in python_files()} - {"__init__", "__main__"}) <= 13


def outside(names, rooms, file):
    """Return the names that have a room, and this file is not in it."""
    return {name for name in names if name in rooms and not file.startswith(rooms[name])}


def test_outside_names_keep_to_their_room_in_rust():
    bad = {}
    for file in rust_files():
        spoken = re.findall(r"\b(?:use\s+)?(\w+)::", source(file))
        bad[file] = outside(spoken, CRATE_ROOMS, file)
        if "unsafe {" in source(file) and file != "base/src/tape/execute.rs":
            bad[file].add("unsafe")
    assert not any(bad.values()), told(bad, "speaks of")


def test_outside_names_keep_to_their_room_in_python():
    bad = {}
    for file, path in python_files().items():
        names = [name.split(".") for name in imports(path)]
        spoken = [words[0] for words in names] + [".".join(words[:3]) for words in names]
        bad[file] = outside(spoken, PACKAGE_ROOMS, file)
        text = path.read_text(encoding="utf-8")
        if "OP_" in text and not file.startswith("_systems/tape/"):
            bad[file].add("CasADi's codes")
        if not file.startswith("_cli/") and re.search(r"^\s*print\(", text, re.MULTILINE):
            bad[file].add("print")
    assert not any(bad.values()), told(bad, "speaks of")


def test_a_module_that_reaches_up_is_seen():
    base, index2 = CRATE_FLOORS["base"], CRATE_FLOORS["index2"]
    assert climbs(base, "tape", "method")
    assert climbs(base, "tape", "tableau")
    assert not climbs(base, "method", "tape")
    assert climbs(index2, "semi_explicit", "stages")
    assert climbs(PACKAGE_FLOORS, "_solution", "plot")


def test_a_name_out_of_its_room_is_seen():
    assert outside(["scipy", "numpy", "rich"], PACKAGE_ROOMS, "_cli/screen.py") == {"scipy"}
    assert "fields.rs does no ['a']" in told({"fields.rs": {"a"}, "b.rs": set()}, "does no")


def private_names(text):
    """Return the private names that a module defines, and those that it reads of other objects."""
    own, read = set(), set()
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.FunctionDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                own.add(name)
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name):
                own |= {name} if isinstance(node.ctx, ast.Store) else set()
            case ast.Attribute(attr=name):
                read.add(name)
    return [{name for name in names if re.match("_[^_]", name)} for names in (own, read)]


def test_a_room_reads_no_private_name_of_another_room():
    rooms, read = {}, {}
    for file, path in python_files().items():
        own, read[file] = private_names(path.read_text(encoding="utf-8"))
        for name in own:
            rooms.setdefault(name, set()).add(module(file))
    bad = {
        file: {name for name in names if name in rooms and module(file) not in rooms[name]}
        for file, names in read.items()
    }
    assert len(rooms) > 100
    assert not any(bad.values()), told(bad, "reads private names of another room:")


def test_a_private_name_that_is_read_is_seen():
    text = "class A:\n    _b: int\n    def _c(self):\n        self._d = x._e + self._f\n"
    assert private_names(text) == [{"_b", "_c", "_d"}, {"_e"}]


TYPE_DEFINITION = re.compile(
    r"^(?:pub(?:\([^)]*\))? )?(?:struct|enum|trait|type|union) (\w+)", re.MULTILINE
)


def defined_twice(sources):
    """Return the type names that are defined more than once, with the files that define them."""
    places = {}
    for file, text in sources.items():
        for name in TYPE_DEFINITION.findall(text):
            places.setdefault(name, []).append(file)
    return {name: files for name, files in places.items() if len(files) > 1}


@pytest.mark.parametrize("crate", [*CRATE_FLOORS, "py"])
def test_a_type_name_is_defined_once_in_a_crate(crate):
    folder = CRATES / crate / "src"
    files = {str(p.relative_to(folder)): p.read_text("utf-8") for p in folder.rglob("*.rs")}
    assert files, f"crates/{crate}/src has no sources"
    bad = defined_twice(files)
    assert not bad, f"crates/{crate} defines types of one name twice: {bad}"


def test_a_type_name_defined_twice_is_seen():
    sources = {"a.rs": "pub(super) struct Step<S> {", "b.rs": "enum Step {\n    type Output = u8;"}
    assert defined_twice(sources) == {"Step": ["a.rs", "b.rs"]}
