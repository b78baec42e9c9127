"""Memory that runs out: a MemoryError, or an IntegrationError with what was done; never an end.

Each kind of run is made by a process of its own whose address space is limited.
"""

import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp

import liouville as lv
from liouville._basics import arguments as _arguments

CHILD = """
import os, sys, resource
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy as np
import liouville as lv
from liouville._basics import arguments as _arguments
from liouville.problems import load
from liouville._runs import execute
from liouville._runs import runner

def pendulum(**more):
    module = load("pendulum")
    return {{"system": module.system, "t": (0.0, 1e5), **module.start, **more}}

def field(**more):
    module = load("euler_top")
    return {{"system": module.system, "method": lv.VolumeSplitting(), "t": (0.0, 1e5), "h": 1e-2,
            **module.start, **more}}

def chain(**more):
    n = 4096
    return {{"system": lv.Schrodinger(lv.Lattice(n)), "psi": np.eye(1, n)[0], **more}}

small = {{"single": 100, "steps": 100}}
call = {call}
act = lv.{act}
# everything is loaded, and threads are started
act(**{{**call, "t": {warm}}})
def run(room):
    used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + room * 2**20, resource.RLIM_INFINITY))
    try:
        found = act(**call)
        print("done", found.status)
    except lv.IntegrationError as error:
        print("IntegrationError", error.solution.t.size, str(error).replace(chr(10), " "))
    except MemoryError as error:
        print("MemoryError", str(error).replace(chr(10), " "))

run(160)
_arguments.memory = execute.memory = lambda: 1e18
runner.check_memory = lambda *_: None
run({room})
"""

ROWS = np.random.default_rng(1).normal(size=(64, 3))

CALLS = {
    "mechanics": ("integrate", "pendulum(method=lv.Spark(1), h=1e-2)", "(0.0, 1.0)"),
    "controlled": ("integrate", "pendulum(method=lv.HHT(), rtol=1e-7)", "(0.0, 1.0)"),
    "ensemble": (
        "ensemble",
        "pendulum(method=lv.Spark(1), h=1e-2, t=(0.0, 2000.0), threads=2, "
        "q=[load('pendulum').start['q']] * 64, v=[load('pendulum').start['v']] * 64)",
        "(0.0, 1.0)",
    ),
    "field": ("integrate", "field()", "(0.0, 1.0)"),
    "fields": (
        "ensemble",
        "field(t=(0.0, 2000.0), x=np.random.default_rng(1).normal(size=(64, 3)), threads=2)",
        "(0.0, 1.0)",
    ),
    "waves": (
        "integrate",
        "chain(method=lv.Chebyshev(tol=1e-3), t=np.linspace(0.0, 1.0, 10_000))",
        "(0.0, 0.1)",
    ),
    "steps of waves": (
        "integrate",
        "chain(method=lv.StabilitySplitting(), t=(0.0, 100.0), h=1e-2)",
        "(0.0, 0.1)",
    ),
    "many waves": (
        "ensemble",
        "chain(method=lv.Chebyshev(tol=1e-3), t=np.linspace(0.0, 1.0, 1000), psi=np.eye(8, 4096))",
        "(0.0, 0.1)",
    ),
}


@cache
def child(name, room):
    """Return what a limited process says of a run, and of one that does not look at its memory."""
    act, call, warm = CALLS[name]
    code = CHILD.format(act=act, call=call, warm=warm, room=room)
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False
    )
    assert found.returncode == 0, (found.returncode, found.stderr[-2000:])
    seeing, blind = found.stdout.splitlines()
    return seeing.split(maxsplit=2), blind.split(maxsplit=2)


limited = pytest.mark.skipif(sys.platform != "linux", reason="limits the address space")


@limited
@pytest.mark.parametrize("name", CALLS)
def test_a_limit_of_the_process_is_seen_before_the_run_or_on_the_way(name):
    (kind, *more), _ = child(name, 100)
    assert kind == ("IntegrationError" if name == "controlled" else "MemoryError")
    if kind == "IntegrationError":
        assert int(more[0]) > 1000


@limited
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize(
    "room", [100, *(pytest.param(room, marks=pytest.mark.slow) for room in (150, 250))]
)
def test_memory_that_runs_out_unforeseen_is_an_error_with_the_solution_so_far(name, room):
    _, (kind, *more) = child(name, room)
    assert kind in ("IntegrationError", "MemoryError")
    if name in ("mechanics", "controlled", "field"):
        assert kind == "IntegrationError"
        assert int(more[0]) > 10_000
        assert "not fit in memory" in more[1]


SWEEP = """
import os, resource, sys
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy as np
import liouville as lv
from liouville.problems import load
from liouville._runs import execute
from liouville._runs import runner

n, many = 10**6, 300_000
swing, turn = load("pendulum"), load("euler_top")
wave = lv.Schrodinger((n, lambda x: 2 * x - np.roll(x, 1) - np.roll(x, -1)), bounds=(0.0, 4.0))
psi = np.ones(n) / np.sqrt(n) + 0j
x = np.random.default_rng(0).normal(size=(many, 3))
q, v = np.tile([1.0, 0.0], (many, 1)), np.zeros((many, 2))
values = swing.system.values({{}})[None]
small, starts = lv.Schrodinger(lv.Lattice(4096)), np.full((200, 4096), 1 / 64 + 0j)
at, split = turn.system.coordinates[0], lv.VolumeSplitting()
acts = {{
    "series": lambda: lv.integrate(wave, lv.Chebyshev(1e-6), t=(0.0, 0.5), psi=psi),
    "shears": lambda: lv.integrate(wave, lv.SchrodingerSplitting(1e-6), t=(0.0, 0.5), psi=psi),
    "section": lambda: lv.section(turn.system, split, plane=at, t=(0.0, 0.1), h=0.01, x=x),
    "starts": lambda: lv.ensemble(
        swing.system, lv.Spark(2), t=(0.0, 0.5), steps=1, q=q, v=v, threads=1
    ),
    "fields": lambda: lv.ensemble(turn.system, split, t=(0.0, 0.1), steps=1, x=x, threads=1),
    "waves": lambda: lv.ensemble(small, lv.Chebyshev(1e-6), t=(0.0, 0.5), psi=starts, threads=1),
    "check": lambda: swing.system.violation(0.0, q, v, values, hidden=True),
}}
act = acts[{name!r}]
execute.memory = lambda: 1e18
runner.check_memory = lambda *_: None
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
_, hard = resource.getrlimit(resource.RLIMIT_AS)
for room in {rooms}:
    resource.setrlimit(resource.RLIMIT_AS, (used + room * 2**20, hard))
    try:
        act()
        said = "done"
    except (MemoryError, lv.IntegrationError) as error:
        said = type(error).__name__
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
    print(room, said, flush=True)
"""


@limited
@pytest.mark.parametrize("name", ["series", "shears", "section", "starts", "fields", "waves"])
@pytest.mark.parametrize(
    "rooms",
    [(35, 65, 100, 130), pytest.param(tuple(range(30, 151, 5)), marks=pytest.mark.slow)],
    ids=["some", "all"],
)
def test_no_limit_of_memory_aborts_a_run(name, rooms):
    swept(name, rooms)


@limited
def test_a_check_of_starts_takes_no_memory_of_their_size():
    assert swept("check", (4,)) == ["4 done"]


def swept(name, rooms):
    """Return what is said where so many MB are left."""
    said = []
    alone = {**os.environ, "MALLOC_ARENA_MAX": "1"}
    for room in rooms:  # each in a process of its own: what one has freed another may take
        code = SWEEP.format(name=name, rooms=(room,))
        found = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True, text=True, timeout=300, check=False, env=alone,
        )  # fmt: skip
        assert found.returncode == 0, (room, found.returncode, found.stderr[-500:])
        assert found.stdout.startswith(f"{room} ")
        said.append(found.stdout.strip())
    return said


SAVED = """
import os, resource, shutil
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy as np
import liouville as lv

n = 2**20
call = {{"system": lv.Schrodinger(lv.Lattice(n)), "method": lv.StabilitySplitting(),
        "t": (0.0, 0.02), "h": 0.01, "psi": np.eye(1, n)[0], "states": False, "threads": 1}}
lv.integrate(**call, store={folder!r} + "/warm.zarr")
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
lv._basics.arguments.memory = lambda: 1e18
for room in range(240, 10, -10):  # until the run fits and its state beside it does not
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (used + room * 2**20, hard))
    try:
        said = lv.integrate(**call, store={folder!r} + "/run.zarr").status
    except MemoryError as error:
        said = "MemoryError " + str(error)
        break
    shutil.rmtree({folder!r} + "/run.zarr")
print(said)
"""


@limited
def test_a_state_that_cannot_be_saved_beside_the_run_is_an_error(tmp_path):
    code = SAVED.format(folder=str(tmp_path))
    alone = {**os.environ, "MALLOC_ARENA_MAX": "1"}  # what threads reserve is not what is used
    found = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, timeout=300, check=False, env=alone,
    )  # fmt: skip
    assert found.returncode == 0, (found.returncode, found.stderr[-2000:])
    assert "the state of the run does not fit in memory" in found.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["warm.zarr"]


def test_limits_of_control_groups_count(tmp_path, monkeypatch):
    listed = tmp_path / "cgroup"
    monkeypatch.setattr(
        _arguments,
        "GROUPS",
        {"": (str(tmp_path / "two"), "memory.max"), "memory": (str(tmp_path / "one"), "limit")},
    )
    for path, text in {
        "two/memory.max": "max", "two/job/memory.max": "30000000", "two/job/step/memory.max": "max",
        "one/limit": "9223372036854771712", "one/job/limit": "20000000",
    }.items():  # fmt: skip
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    found = {}
    for line in (
        "0::/job/step",
        "5:cpu,memory:/job",
        "5:cpu:/job",
        "0::/elsewhere",
        "3:name=a b:/",
    ):
        listed.write_text(f"{line}\n")
        found[line] = [*_arguments._of_groups(listed)]
    assert found == {
        "0::/job/step": [30000000], "5:cpu,memory:/job": [20000000, 9223372036854771712],
        "5:cpu:/job": [], "0::/elsewhere": [], "3:name=a b:/": [],
    }  # fmt: skip
    assert [*_arguments._of_groups(tmp_path / "none")] == []
    listed.write_text("0::/job/step\n")
    monkeypatch.setattr(_arguments, "LISTED", listed)
    assert _arguments.memory() == 0.8 * 30000000


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: lv.SpinChain(30),
            r"a chain of 30 spins, with a state takes 60 GiB, with 4 GiB available",
        ),
        (lambda: lv.Grid(0, 1, (4096, 8192)), r"a grid of 33554432 points takes 4 GiB.*\nhint: "),
        (
            lambda: lv.Lattice((1000, 20_000)),
            r"a lattice with its 100000000 entries takes 6.71 GiB",
        ),
    ],
)
def test_what_would_fill_the_memory_while_it_is_made_is_refused_before(make, words, monkeypatch):
    monkeypatch.setattr(_arguments, "memory", lambda: 4.0 * 2**30 - 2**12)
    with pytest.raises(MemoryError, match=words):
        make()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: lv.Grid(0, 1, 10**300), r"^a grid of 1e\+300 points takes 1.19e\+293 GiB, with"),
        (lambda: lv.Lattice(10**300), r"^a lattice with its 3e\+300 entries takes 2.01e\+293 GiB"),
        (
            lambda: lv.integrate(
                lv.Schrodinger(np.diag([0.0, 1e60]), drive=[(lambda t, _: t, np.ones((2, 2)))]),
                lv.Magnus(), t=(0, 1), steps=3, psi=[1, 0],
            ),
            r"^the series of an exponential over 5.56e\+58 / beta takes 8.28e\+50 GiB",
        ),
    ],
)  # fmt: skip
def test_numbers_too_large_to_be_counted_have_no_more_digits_than_they_need(make, words):
    with pytest.raises(MemoryError, match=words):
        make()


def test_a_matrix_that_cannot_be_read_is_refused_before(monkeypatch):
    sparse = pytest.importorskip("scipy.sparse")
    matrix = sparse.diags_array([np.ones(20_000)], offsets=[0]).tocsr()
    monkeypatch.setattr(_arguments, "memory", lambda: 1.8e6)
    sentence = "H with its 20000 entries takes 1.91 MiB, with 1.72 MiB available"
    with pytest.raises(MemoryError, match=sentence):
        lv.Schrodinger(matrix)


@pytest.mark.parametrize("method", [lv.Chebyshev(), lv.Lanczos(dimension=12)])
def test_a_method_whose_states_do_not_fit_is_refused_before(method, monkeypatch):
    system = lv.Schrodinger(lv.Lattice(1 << 16))
    call = {"t": (0.0, 0.1), "psi": np.ones(1 << 16), "states": False}
    monkeypatch.setattr(_arguments, "memory", lambda: 3.0 * 2**20)
    with pytest.raises(
        MemoryError, match=r"stepping a state of 65536 components by .* takes \d.* MiB"
    ):
        lv.integrate(system, method, **call)
    least = lv.SchrodingerSplitting(mode="stable")
    assert lv.integrate(system, least, **call).status == "done"


def test_a_series_that_does_not_fit_is_refused_and_not_needed_beside_a_splitting():
    system = lv.Schrodinger(lv.Lattice(4))
    with pytest.raises(MemoryError, match=r"a Chebyshev series over 1.62e\+12 / beta takes"):
        lv.plan(system, lv.Chebyshev(tol=0.5), t=(0.0, 1e12))
    with pytest.raises(ValueError, match=r"t spans 1.0e\+300, out of range"):
        lv.plan(lv.Schrodinger(1e-300 * np.eye(2)), t=(0.0, 1e300))


def test_too_many_outputs_are_refused_before_they_are_planned(monkeypatch):
    from liouville._runs.waves import wave

    monkeypatch.setattr(wave, "plan_run", None)
    call = {"psi": np.ones(10**6), "t": np.linspace(0.0, 1.0, 100_001)}
    with pytest.raises(MemoryError, match=r"keeping 100001 states takes 149\d GiB, with"):
        lv.integrate(lv.Schrodinger(lv.Lattice(10**6)), "auto", **call)


SPRING = lv.Lagrangian(
    lambda t, q, v, params: v[0] ** 2 / 2 - params.k * q[0] ** 2 / 2, q=("x",), params={"k": 1.0}
)
LONG = {"t": (0, 1), "steps": 10**15, "q": [1.0], "v": [0.0]}


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (lambda: lv.analysis.lyapunov(SPRING, lv.Spark(3), **LONG), r"10{14} orthogonalisations"),
        (
            lambda: lv.optimal_control(
                SPRING, lv.Spark(2), controls=["k"], cost=lambda t, q, v, p: p.k**2, **LONG
            ),
            r"60{15} unknowns in 10{15} steps",
        ),
        (
            lambda: lv.Schrodinger(sp.coo_array(([1.0], ([0], [0])), shape=(10**12,) * 2)),
            r"H of order 10{12}, with a state,",
        ),
    ],
    ids=["exponents", "controls", "matrix"],
)
def test_what_does_not_fit_is_refused_before_its_arrays_are_made(call, what):
    with pytest.raises(MemoryError, match=rf"{what} takes \d+ GiB, with .* available\nhint: "):
        call()
