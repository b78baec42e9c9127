"""Stored runs: the bits of runs in memory, whatever they are cut off by.

One file, since one table of runs goes through every way to be cut off.
"""

import errno
import os
import random
import resource
import shutil
import signal
import sys
import time
import tracemalloc
import warnings
from contextlib import suppress
from itertools import count
from multiprocessing import get_context
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import xarray
from scipy import sparse

import liouville as lv
from liouville import problems
from liouville._basics import checksum, locks
from liouville._runs.stored import folder, running, stream
from liouville._solution import export

GROUPS = ("states", "invariants", "residuals", "observed", "balance")
FACTS = ("names", "h", "tolerances", "method", "params", "status", "message", "dense_order")


class CutError(BaseException):
    """Ends a run as nothing does that asks."""


def pendulum(**more):
    module = problems.load("pendulum")
    return {"system": module.system, "method": lv.HHT(), "t": (0.0, 2.0), **module.start, **more}


def both(t, q, v, params):
    return ca.vertcat(q[0] * v[0], q[1])


def height(t, q, v, lam, params):
    return q[0]


def sphere():
    """Return a system of index 2: a point on the unit sphere, whose z pushes it back."""
    return lv.SemiExplicit(
        field=lambda t, y, z, params: [y[1] - y[0] * z[0], -y[0] - y[1] * z[0], -y[2] * z[0]],
        constraint=lambda t, y, params: (ca.dot(y, y) - 1) / 2,
        y=3,
        z=1,
    )


def low(t, y, z, params):
    return y[0]


def turning(**more):
    """Return a call whose solution has an array of each kind, but fewer than a pendulum's."""
    call = {"system": sphere(), "method": lv.Spark(1), "t": (0.0, 6.0), "y": [0.6, 0.0, 0.8]}
    return {**call, "steps": 60, "events": {"low": low}, **more}


def crank(**more):
    """Return a slider-crank that jumps next to its centre: its links are nearly equal."""

    def links(t, q, params):
        length = 1.000001**2
        return [ca.sumsqr(q[:2]) - 1, (q[0] - q[2]) ** 2 + q[1] ** 2 - length]

    system = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2, links, q=3)
    slider = np.cos(1.0) + np.sqrt(1.000001**2 - np.sin(1.0) ** 2)
    start = system.consistent(q=[np.cos(1.0), np.sin(1.0), slider], v=[-1, 0.5, 0], hold="q")
    call = {"system": system, "method": lv.Spark(3), "t": (0.0, 3.0), "h": 0.01}
    return {**call, **start, **more}


def bent(**more):
    """Return a point in a plane given twice, whose constraints disagree behind x = 1."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        lambda t, q, params: {"flat": q[1], "bent": q[1] + ca.fmax(q[0] - 1, 0) ** 3},
        q=("x", "y"),
    )
    call = {"system": system, "method": lv.Spark(2), "t": (0.0, 2.0), "h": 0.01}
    return {**call, "q": [0, 0], "v": [1, 0], **more}


def waves(**more):
    psi = np.exp(-((np.arange(15) - 5.0) ** 2) / 8 + 0.7j * np.arange(15))
    start = {"psi": psi / np.linalg.norm(psi), "t": np.linspace(0.0, 4.0, 40)}
    return {"system": lv.Schrodinger(lv.Lattice(15)), **start, **more}


def rotor(form=ca.sin, **more):
    """Return a wave function on a ring whose potential swings, or is another function of time."""
    grid = lv.Grid(0.0, 2 * np.pi, 16, lambda t, x, params: 2 * ca.cos(x) * form(3 * t))
    psi = np.exp(1j * np.sin(grid.points[:, 0])) / np.sqrt(16)
    return waves(system=lv.Schrodinger(grid), psi=psi, **more)


def field(**more):
    module = problems.load("euler_top")
    call = {"system": module.system, "method": lv.VolumeSplitting(), "t": (0.0, 3.0), "steps": 200}
    return {**call, **module.start, **more}


KINDS = {
    "equal": lambda: pendulum(steps=300, every=7, observe={"a/b": both}),
    "controlled": lambda: pendulum(rtol=1e-4),
    "PI": lambda: pendulum(rtol=1e-4, control=lv.Adaptive()),
    "given times": lambda: pendulum(steps=300, t_eval=np.linspace(0, 2, 77)),
    "events": lambda: pendulum(steps=300, events={"low/high": height}, states=False),
    "ended": lambda: pendulum(steps=300, events={"low": lv.Event(height, terminal=2)}),
    "reset": lambda: pendulum(steps=300, events={"wall": lv.Event(height, reset=lv.Impact(0.9))}),
    "controlled reset": lambda: pendulum(
        method=lv.Spark(3),
        rtol=1e-7,
        t=(0.0, 4.0),
        events={"wall": lv.Event(height, reset=lv.Impact(0.9))},
    ),
    "spark": lambda: pendulum(method=lv.Spark(3), steps=200),
    "jumping": crank,
    "reversible": lambda: pendulum(method=lv.Spark(2), h=0.01, control=lv.Reversible()),
    "tolerant": lambda: pendulum(method=lv.Spark(3), rtol=1e-7, t=(0.0, 4.0)),
    "composed": lambda: pendulum(method=lv.Composition(lv.LobattoPair(2), "SU4"), steps=150),
    "index 2": lambda: dict(
        system=sphere(), method=lv.Spark(2), t=(0.0, 3.0), steps=150, y=[0.6, 0.0, 0.8]
    ),
    "field": lambda: field(every=3),
    "wave": lambda: waves(method=lv.SchrodingerSplitting(tol=1e-6)),
    "krylov": lambda: waves(method=lv.Lanczos(tol=1e-6)),
    "operators": lambda: waves(
        method=lv.SchrodingerSplitting(tol=1e-6),
        observe={"hop": np.eye(15, k=1), "moved": sparse.diags_array(np.arange(15.0))},
    ),
    "grid": lambda: rotor(method=lv.SplitOperator(), h=0.01),
    "split to a tolerance": lambda: rotor(method=lv.SplitOperator(tol=1e-6)),
    "split with jumps": lambda: rotor(ca.floor, method=lv.SplitOperator(tol=1e-6)),
    "levels": lambda: waves(method="auto", t=np.linspace(0.0, 400.0, 60)),
    "levels of complex H": lambda: waves(
        system=lv.Schrodinger(np.diag(1j * np.ones(14), 1) + np.diag(-1j * np.ones(14), -1)),
        method="auto",
        t=np.linspace(0.0, 400.0, 60),
    ),
}


def same(one, other):
    """Compare two solutions bit for bit."""
    assert one.t.tobytes() == other.t.tobytes()
    for group in GROUPS:
        mine, yours = getattr(one, group), getattr(other, group)
        assert list(mine) == list(yours)
        for name in mine:
            assert mine[name].shape == yours[name].shape
            assert mine[name].tobytes() == yours[name].tobytes(), name
    for fact in FACTS:
        assert getattr(one, fact) == getattr(other, fact)
    assert {**one.stats, "seconds": 0} == {**other.stats, "seconds": 0}
    assert list(one.events) == list(other.events)
    for name, points in one.events.items():
        assert points.t.tobytes() == other.events[name].t.tobytes()
        for state, values in points.states.items():
            assert values.tobytes() == other.events[name].states[state].tobytes()


@pytest.fixture
def small(monkeypatch):
    """Make chunks so small that a short run has many, and trust the disk."""
    monkeypatch.setattr(folder.os, "fsync", lambda _: None)
    monkeypatch.setattr(stream, "BYTES", 1500)
    monkeypatch.setattr(stream, "EVENTS", 2)
    monkeypatch.setattr(stream, "PAUSE", 0.0)


def cutting(every):
    """Give a progress that cuts the run off when it is called for this time."""
    calls = count(1)

    def progress(done, total):
        if next(calls) == every:
            raise CutError

    return progress


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_cut_off_again_and_again_has_the_bits_of_one_that_was_not(kind, small, tmp_path):
    whole = lv.integrate(**KINDS[kind]())
    path = tmp_path / "run.zarr"
    with pytest.raises(CutError):
        lv.integrate(**KINDS[kind](), store=lv.Store(path, 25), progress=cutting(2))
    for cuts in count(1):
        try:
            solution = lv.resume(path, progress=cutting(2 + 2**cuts))
        except CutError:
            continue
        break
    assert cuts > 1
    same(whole, lv.load(path))
    assert solution.path == str(path)
    assert solution.t.tolist() == [whole.t[0], whole.t[-1]]
    same(whole, lv.load(lv.resume(path).path))


@pytest.mark.parametrize("stride", [19, pytest.param(1, marks=pytest.mark.slow)])
def test_a_file_cut_off_in_the_middle_leaves_what_was_there(stride, small, tmp_path, monkeypatch):
    monkeypatch.setattr(stream, "BYTES", 2500)
    call = pendulum(steps=70, events={"low": height})
    whole = lv.integrate(**call)
    write, made, last = folder.Folder.write, count(), None

    def dying(self, file, data, *end):
        if next(made) != last:
            return write(self, file, data, *end)
        if is_late:
            write(self, file, data, *end)
        else:
            torn = self.path / folder.CHECKPOINT / "torn.tmp"
            torn.write_bytes(bytes(data)[: len(bytes(data)) // 2])
        raise CutError

    monkeypatch.setattr(folder.Folder, "write", dying)
    begun = 0
    for last, is_late in ((n, late) for n in count(0, stride) for late in (False, True)):
        path = tmp_path / f"{last}-{is_late}.zarr"
        made = count()
        try:
            lv.integrate(**call, store=lv.Store(path, checkpoint=30))
            break
        except CutError:
            if path.exists():
                begun += 1
                assert_prefix(lv.load(path), whole)
                same(whole, lv.load(lv.resume(path).path))
                assert not [*path.rglob("*.tmp")]
            assert not [*tmp_path.glob(".*")]
            shutil.rmtree(path, ignore_errors=True)
    assert begun > 60 / stride


def go(path, call):
    store = lv.Store(path, checkpoint="0.002s")
    lv.resume(path) if path.exists() else lv.integrate(**call, store=store)


def checkpoints(path):
    """Say which checkpoint there is: another one is another file."""
    found = (path / folder.CHECKPOINT).glob("*")
    return {(file.name, file.stat().st_ino) for file in found if file.suffix != ".tmp"}


def killed(path, call, whole, cycles, seed):
    """Kill a process that makes a run, and the next one, until one is left alone; count them.

    Each is killed at some moment after a few checkpoints of its own, and leaves the first records.
    """
    draw, context = random.Random(seed), get_context("fork")
    kills = 0
    for _ in range(cycles):
        process = context.Process(target=go, args=(path, call))
        process.start()
        for _ in range(draw.randint(1, 3)):
            there = checkpoints(path)
            while process.is_alive() and checkpoints(path) == there:
                time.sleep(1e-4)
        time.sleep(draw.uniform(0.0, 3e-3))
        process.kill()
        process.join()
        kills += process.exitcode == -signal.SIGKILL
        assert_prefix(lv.load(path), whole)
    process = context.Process(target=go, args=(path, call))
    process.start()
    process.join()
    assert process.exitcode == 0
    return kills


def assert_prefix(part, whole):
    """Compare what a reader sees of a run with the first records and events of all."""
    steps = part.t.size
    assert 1 <= steps <= whole.t.size
    assert part.t.tobytes() == whole.t[:steps].tobytes()
    for group in GROUPS:
        for name, values in getattr(part, group).items():
            assert values.tobytes() == getattr(whole, group)[name][:steps].tobytes(), name
    for name, points in part.events.items():
        assert points.t.tobytes() == whole.events[name].t[: points.t.size].tobytes()
        assert {x.shape[0] for x in points.states.values()} == {points.t.size}


def refusal(act):
    """Return the sentence by which an act is refused, and what it was refused with."""
    try:
        act()
    except Exception as error:
        return type(error).__name__, str(error)
    return None


def refusal_elsewhere(path, pipe):
    pipe.send(refusal(lambda: lv.resume(path)))


needs_fork = pytest.mark.skipif(sys.platform != "linux", reason="forks processes")


@needs_fork
@pytest.mark.parametrize("cycles", [4, pytest.param(50, marks=pytest.mark.slow)])
def test_processes_killed_at_any_moment_leave_the_bits_of_one_that_lived(cycles, tmp_path):
    call = pendulum(method=lv.Spark(3), steps=80_000 * cycles, every=20)
    call["t"] = (0.0, 0.01 * call["steps"])
    whole = lv.integrate(**call)
    path = tmp_path / "run.zarr"
    assert killed(path, call, whole, cycles, seed=cycles) > 0  # how many is the machine's affair
    same(whole, lv.load(path))


@needs_fork
@pytest.mark.parametrize("is_resumed", [False, True])
def test_a_run_that_is_going_on_is_refused_to_others(is_resumed, tmp_path):
    call, path, found = pendulum(steps=300), tmp_path / "run.zarr", []
    whole = lv.integrate(**call)
    if is_resumed:
        with pytest.raises(CutError):
            lv.integrate(**call, store=lv.Store(path, 25), progress=cutting(2))

    def looking(done, total):
        receive, send = get_context("fork").Pipe(duplex=False)
        process = get_context("fork").Process(target=refusal_elsewhere, args=(path, send))
        process.start()
        found.append(receive.recv())
        process.join()
        found.append(refusal(lambda: lv.resume(path)))
        found.append(refusal(lambda: whole.save(path)))

    store = lv.Store(path, 100)
    if is_resumed:
        lv.resume(store, progress=looking)
    else:
        lv.integrate(**call, store=store, progress=looking)
    mine = f"process {os.getpid()}"
    for kind, sentence in found:
        assert kind == "BlockingIOError"
        assert str(path) in sentence
        assert sentence.endswith((mine, "this process"))
    assert len(found) >= 6
    same(whole, lv.load(path))


@needs_fork
def test_a_run_that_was_killed_has_its_own_statistics(tmp_path, monkeypatch):
    monkeypatch.setattr("liouville._runs.stored.stream.PAUSE", 0.0)
    path = tmp_path / "run.zarr"
    call = pendulum(steps=10**7)
    process = get_context("fork").Process(target=go, args=(path, call))
    process.start()
    steps = 0
    while steps < 10**4:
        with suppress(FileNotFoundError):
            steps = lv.load(path).stats["steps"]
    process.kill()
    process.join()
    left = lv.load(path)
    assert left.status == "interrupted"
    assert left.stats["iterations"] >= left.stats["steps"] > 0
    assert left.t.size == left.stats["steps"] + 1
    assert left.t[-1] == pytest.approx(left.stats["steps"] * left.h)


@needs_fork
def test_a_killed_process_leaves_no_lock(tmp_path):
    path = tmp_path / "run.zarr"
    call = pendulum(steps=10**7)
    process = get_context("fork").Process(target=go, args=(path, call))
    process.start()
    while not checkpoints(path):
        time.sleep(1e-3)
    process.kill()
    process.join()
    with pytest.raises(CutError):
        lv.resume(path, progress=cutting(2))


def test_of_two_runs_that_begin_at_one_path_the_second_is_refused(tmp_path, monkeypatch):
    path, pickled = tmp_path / "run.zarr", running.pickled

    def overtaken(job):
        monkeypatch.setattr(running, "pickled", pickled)
        lv.integrate(**pendulum(steps=20), store=path)
        return pickled(job)

    monkeypatch.setattr(running, "pickled", overtaken)
    with pytest.raises(FileExistsError, match=r"liouville\.resume"):
        lv.integrate(**pendulum(steps=30), store=path)
    assert lv.load(path).t.size == 21
    assert [*tmp_path.iterdir()] == [path]


def test_a_file_system_without_locks_is_warned_of(tmp_path, monkeypatch):
    def refusing(opened):
        raise OSError(errno.ENOTSUP, "no locks")

    monkeypatch.setattr(locks, "_lock", refusing)
    with pytest.warns(RuntimeWarning, match=r"cannot be locked (.|\n)*no other process"):
        lv.integrate(**pendulum(steps=20), store=tmp_path / "run.zarr")


def test_a_run_may_change_the_working_directory(elsewhere, tmp_path):
    (tmp_path / "other").mkdir()
    call = pendulum(steps=300)

    def leaving(done, total):
        os.chdir(tmp_path / "other")

    solution = lv.integrate(**call, store=lv.Store("run.zarr", 25), progress=leaving)
    same(lv.integrate(**call), lv.load(solution.path))
    os.chdir(tmp_path)
    with pytest.raises(CutError):
        lv.integrate(**call, store=lv.Store("again.zarr", 25), progress=cutting(2))
    lv.resume("again.zarr", progress=leaving)
    same(lv.integrate(**call), lv.load(tmp_path / "again.zarr"))


@needs_fork
def test_memory_does_not_grow_with_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(stream, "BYTES", 1 << 20)
    receive, send = get_context("fork").Pipe(duplex=False)

    def peak(records):
        call = waves(system=lv.Schrodinger(lv.Lattice(1000)), psi=np.ones(1000))
        call["t"] = np.linspace(0.0, 1e-3 * records, records)
        # a series would keep the states of a window
        method = lv.SchrodingerSplitting(tol=1e-3, mode="fast")
        lv.integrate(**call, method=method, store=tmp_path / f"{records}.zarr")
        send.send(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10)

    found = []
    for records in (1000, 6000):
        process = get_context("fork").Process(target=peak, args=(records,))
        process.start()
        found.append(receive.recv())
        process.join()
    assert found[1] - found[0] < 5000 * 16_000 / 4


def interrupting(done, total):
    raise KeyboardInterrupt


def signalling(done, total):
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("progress", [interrupting, signalling])
def test_an_interrupted_run_is_stored_to_where_it_is_and_goes_on(progress, tmp_path):
    call = pendulum(steps=500, every=9)
    whole = lv.integrate(**call)
    path = tmp_path / "run.zarr"
    solution = lv.integrate(**call, store=lv.Store(path, 100), progress=progress)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert solution.status == "interrupted"
    assert solution.message.startswith("interrupted after 100 of 500 steps; liouville.resume(")
    stored = lv.load(path)
    # every ninth state and the present one
    assert stored.q[:-1].tobytes() == whole.q[: len(stored.t) - 1].tobytes()
    assert stored.t.size == 13
    assert stored.t[-1] == solution.t[-1] == pytest.approx(0.4)
    assert lv.resume(path).status == "done"
    same(whole, lv.load(path))


def late(t, q, v, params):
    return ca.sqrt(1.5 - t)


def test_a_failing_run_stores_all_before_it_and_fails_again(small, tmp_path):
    call = pendulum(steps=400, observe={"root": late})
    with pytest.raises(lv.IntegrationError) as plain:
        lv.integrate(**call)
    path = tmp_path / "run.zarr"
    for attempt in (lambda: lv.integrate(**call, store=path), lambda: lv.resume(path)):
        with pytest.raises(lv.IntegrationError) as stored:
            attempt()
        assert str(stored.value) == str(plain.value)
        assert stored.value.step == plain.value.step
        assert stored.value.solution.t[-1] == plain.value.solution.t[-1]
        same(plain.value.solution, lv.load(path))


def test_a_stored_run_says_where_its_energy_jumps(tmp_path):
    path = tmp_path / "run.zarr"
    said = lv.integrate(**crank(), store=path).message
    assert "the energy has jumped by" in said
    assert said == lv.load(path).message == lv.integrate(**crank()).message


@pytest.mark.parametrize("every", [1, 3])
def test_a_stored_run_ends_where_a_constraint_left_out_follows_no_longer(every, small, tmp_path):
    with pytest.raises(lv.IntegrationError, match="no longer follows from the others") as plain:
        lv.integrate(**bent(every=every))
    path = tmp_path / "run.zarr"
    for attempt in (
        lambda: lv.integrate(**bent(every=every), store=lv.Store(path, 40)),
        lambda: lv.resume(path),
    ):
        with pytest.raises(lv.IntegrationError) as stored:
            attempt()
        assert str(stored.value) == str(plain.value)
        assert (stored.value.step, stored.value.t) == (plain.value.step, plain.value.t)
        found = lv.load(path)
        assert found.q.tobytes() == plain.value.solution.q.tobytes()


def test_a_state_that_does_not_fit_ends_the_run_with_all_before_it(small, tmp_path, monkeypatch):
    path, save, calls = tmp_path / "run.zarr", stream.Stream.save, count(1)

    def full(*args):
        if next(calls) == 4:
            raise MemoryError("the state of the run does not fit in memory")
        save(*args)

    call = pendulum(method=lv.Spark(2), steps=300)
    monkeypatch.setattr(stream.Stream, "save", full)
    with pytest.raises(lv.IntegrationError, match="not fit in memory") as caught:
        lv.integrate(**call, store=lv.Store(path, 25))
    assert caught.value.step == 75
    found = lv.load(path)
    assert found.status == "failed"
    assert found.t.size == 76
    assert lv.resume(path).status == "done"
    assert lv.load(path).q.tobytes() == lv.integrate(**call).q.tobytes()


def test_a_run_that_cannot_start_leaves_nothing(tmp_path):
    def singular(t, q, v, params):
        return 1 / q[1]

    with pytest.raises(lv.IntegrationError):
        lv.integrate(**pendulum(steps=10, observe={"bad": singular}), store=tmp_path / "run.zarr")
    assert not [*tmp_path.iterdir()]


def test_others_read_the_folder_while_it_grows_and_when_it_is_done(small, tmp_path):
    path = tmp_path / "run.zarr"
    lengths = []

    def progress(done, total):
        with xarray.open_zarr(path, consolidated=False, decode_times=False) as records:
            lengths.append((done, records.time.size))
            assert records.attrs["status"] == "interrupted"

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lv.integrate(**pendulum(steps=200), store=lv.Store(path, 50), progress=progress)
        with xarray.open_zarr(path, consolidated=False, decode_times=False) as records:
            assert records.q.dims == ("time", "coordinate")
            assert records.time.size == 201
    # up to the last checkpoint
    assert lengths[:-1] == [(done, done // 50 * 50 + 1) for done, _ in lengths[:-1]]
    assert max(length for _, length in lengths) > 100
    assert len(lengths) > 3


@pytest.mark.parametrize("kind", ["equal", "events", "wave"])
def test_a_run_that_was_cut_off_leaves_all_until_its_last_checkpoint(kind, tmp_path, monkeypatch):
    """Also where no chunk of a usual size is full, and when it is cut off again."""
    monkeypatch.setattr(stream, "PAUSE", 0.0)
    monkeypatch.setattr(folder.os, "fsync", lambda _: None)
    whole, path = lv.integrate(**KINDS[kind]()), tmp_path / "run.zarr"
    with pytest.raises(CutError):
        lv.integrate(**KINDS[kind](), store=lv.Store(path, 10), progress=cutting(2))
    left = lv.load(path)
    size = left.t.size
    assert 1 < size < whole.t.size
    assert left.t.tobytes() == whole.t[:size].tobytes()
    for group in ("states", "invariants", "observed"):
        for name, values in getattr(left, group).items():
            assert values.tobytes() == getattr(whole, group)[name][:size].tobytes()
    for name, points in left.events.items():
        assert (
            points.t.tobytes() == whole.events[name].t[whole.events[name].t <= left.t[-1]].tobytes()
        )
    with pytest.raises(CutError):
        lv.resume(path, progress=cutting(1))
    assert lv.load(path).t.size >= size
    lv.resume(path)
    same(whole, lv.load(path))


def test_a_light_solution_says_where_its_records_are(tmp_path):
    path = tmp_path / "run.zarr"
    solution = lv.integrate(**pendulum(steps=20), store=path)
    assert repr(solution).endswith(f"its records are in {str(path)!r}>")
    assert solution.q.shape == (2, 2)
    with pytest.raises(ValueError, match="dense output needs"):
        solution(1.0)
    assert solution.system is not None


@pytest.mark.parametrize(
    ("more", "error", "words"),
    [
        ({"store": "run.nc"}, ValueError, r"stored in a \.zarr folder, not in 'run.nc'"),
        ({"store": 3}, TypeError, "store must be a path, not 3"),
        ({"store": "no/run.zarr"}, FileNotFoundError, "does not exist"),
        ({"store": lv.Store("no/run.zarr", 5)}, FileNotFoundError, "does not exist"),
        ({"store": lv.Store("there.zarr", "1h")}, FileExistsError, "liouville.resume"),
        ({"store": "run.zarr", "checkpoint": 5}, TypeError, r"hint: give lv.Store\(path, check"),
        ({"store": "."}, ValueError, "folder"),
        ({"store": "there.zarr"}, FileExistsError, "liouville.resume"),
    ],
)
def test_what_cannot_be_stored_is_refused_before_the_run(more, error, words, elsewhere):
    Path("there.zarr").mkdir()
    with pytest.raises(error, match=words):
        lv.integrate(**pendulum(steps=10), **more)
    assert [path.name for path in elsewhere.iterdir()] == ["there.zarr"]


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        (("run.nc",), ValueError, "stored in a .zarr folder, not in"),
        ((3,), TypeError, "store must be a path, not 3"),
        (("run.zarr", 0), ValueError, "checkpoint must be at least 1, not 0"),
        (("run.zarr", 2.5), TypeError, "checkpoint must be an integer, not 2.5"),
        (("run.zarr", "5 weeks"), ValueError, "neither steps nor a time\nhint: give checkpoint="),
        (("run.zarr", "0s"), ValueError, "neither steps nor a time"),
    ],
)
def test_a_store_that_is_none_is_refused_when_it_is_made(given, error, words):
    with pytest.raises(error, match=words):
        lv.Store(*given)


def test_the_old_spelling_of_a_checkpoint_is_refused(tmp_path):
    with pytest.raises(TypeError, match=r"resume takes no checkpoint=\nhint: give lv.Store\("):
        lv.resume(tmp_path / "run.zarr", checkpoint=5)
    with pytest.raises(TypeError, match="resume takes no often="):
        lv.resume(tmp_path / "run.zarr", often=5)


def test_what_cannot_be_pickled_is_refused_before_the_run(tmp_path):
    products = lv.Schrodinger((4, lambda x: 2 * x), bounds=(0.0, 3.0))
    with pytest.raises(TypeError, match=r"cannot be pickled(.|\n)*hint: define its functions"):
        lv.integrate(
            products, lv.Chebyshev(), t=(0.0, 1.0), psi=[1, 0, 0, 0], store=tmp_path / "run.zarr"
        )
    assert not [*tmp_path.iterdir()]


def cut_off(path):
    with pytest.raises(CutError):
        lv.integrate(**pendulum(steps=100), store=lv.Store(path, 10), progress=cutting(2))


def test_what_is_no_run_to_go_on_with_is_refused(tmp_path):
    path = tmp_path / "run.zarr"
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        lv.resume(path)
    path.mkdir()
    with pytest.raises(ValueError, match="holds no run of liouville"):
        lv.resume(path)
    path.rmdir()
    lv.integrate(**pendulum(steps=10)).save(path)
    with pytest.raises(ValueError, match=r"a solution, and no run(.|\n)*hint: .*store="):
        lv.resume(path)


def test_a_run_of_another_version_is_not_gone_on_with(tmp_path):
    path = tmp_path / "run.zarr"
    cut_off(path)
    told = path / folder.CHECKPOINT / folder.META
    group = checksum.verified(told, "attributes")
    assert group["attributes"]["liouville"]
    group["attributes"]["liouville"] = "0.0.1"
    told.write_text(checksum.signed(group, "attributes"))
    with pytest.raises(ValueError, match=r"of liouville 0\.0\.1, and this is"):
        lv.resume(path)
    assert lv.load(path).status == "interrupted"


def test_a_state_that_is_none_or_another_runs_is_refused(tmp_path):
    path, other = tmp_path / "run.zarr", tmp_path / "other.zarr"
    cut_off(path)
    with pytest.raises(CutError):
        lv.integrate(**field(), store=lv.Store(other, 10), progress=cutting(2))
    state = path / folder.CHECKPOINT / stream.STATE
    whole = state.read_bytes()
    state.write_bytes((other / folder.CHECKPOINT / stream.STATE).read_bytes())
    with pytest.raises(ValueError, match="whose state is of another run"):
        lv.resume(path)
    state.write_bytes(whole[:200] + b"bits" + whole[204:])
    with pytest.raises(ValueError, match=r"state\.npz. is damaged: it is not what its checksum"):
        lv.resume(path)
    state.unlink()
    with pytest.raises(ValueError, match="whose state cannot be read"):
        lv.resume(path)


def test_the_ends_of_a_long_run_are_read_without_the_rest(tmp_path, monkeypatch):
    monkeypatch.setattr(stream, "BYTES", 1 << 17)
    steps = 200_000
    given = pendulum(method=lv.Spark(1), t=(0.0, steps / 100), steps=steps, states=False)
    lv.integrate(**given, store=tmp_path / "run.zarr")
    export.ends(tmp_path / "run.zarr")  # imports take memory too
    tracemalloc.start()
    found = export.ends(tmp_path / "run.zarr")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.t.size == 2
    assert peak < 8 * steps  # of the times alone
