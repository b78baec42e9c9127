"""Stored runs with contacts: the bits of runs in memory, whatever they are cut off by."""

import signal
from contextlib import suppress
from itertools import count
from multiprocessing import get_context

import casadi as ca
import numpy as np
import pytest
from test_stored import CutError, assert_prefix, cutting, killed, needs_fork, same, small

import liouville as lv
from liouville._runs.contacts import run as course
from liouville._runs.stored import touching
from liouville.bodies import Assembly, Plane, Sphere

__all__ = ["small"]  # a fixture

G = 9.81


def lagrangian(t, q, v, params):
    return ca.sumsqr(v) / 2 - G * q[1]


def height(t, q, params):
    return q[1]


def slip(t, q, v, params):
    return v[0] - ca.sin(3 * t)


def low(t, q, v, lam, params):
    return q[0] - 0.1


def both(t, q, v, params):
    return ca.vertcat(q[0] * v[0], q[1])


def bouncing(**more):
    """Return a block that bounces, slips and sticks on a belt that swings."""
    system = lv.Lagrangian(
        lagrangian, q=("x", "y"), contacts={"floor": lv.Contact(height, 0.5, 0.2, 0.3, slip)}
    )
    call = {"system": system, "method": lv.Spark(3), "t": (0, 5), "q": [0, 0.5], "v": [1, 0]}
    return call | {"h": 0.05, "events": {"low/a": low}, "observe": {"a/b": both}} | more


def ball():
    """Return a ball that slides, turns and rolls, whose angles no coordinate counts."""
    m = Assembly(gravity=(0, 0, -G))
    body = m.body("ball", mass=1.0, inertia=[0.4 * 0.01] * 3, at=(0, 0, 0.1))
    m.free("flight", body)
    m.contact("lane", Sphere(body, 0.1), Plane("ground"), friction=0.2)
    start = m.start(rates={"flight": (3, 1, 0, 2, -5, 1)})
    return {"system": m.system(), "method": lv.Spark(2), "t": (0, 1), "h": 0.02, **start}


def pendulum():
    """Return a pendulum that hits a stop, whose constraint and work are kept."""
    m = Assembly(gravity=(0, 0, -G))
    bob = m.body("bob", mass=1.0, inertia=[0.1] * 3, at=(0, 0, -1))
    stops = lv.bodies.Limits(-0.5, 0.5, restitution=0.7)
    m.revolute("A", "ground", bob, at=(0, 0, 0), axis=(0, 1, 0), limits=stops)
    start = m.start(rates={"A": 2.0})
    return {"system": m.system(), "method": lv.Spark(3), "t": (0, 3), "h": 0.02, **start}


KINDS = {
    "equal": bouncing,
    "every third": lambda: bouncing(every=3),
    "given times": lambda: bouncing(t_eval=np.linspace(0, 5, 77)),
    "controlled": lambda: bouncing(h=None, rtol=1e-8),
    "ended": lambda: bouncing(events={"low": lv.Event(low, terminal=2)}),
    "ball": ball,
    "pendulum": pendulum,
}


def agree(one, other):
    same(one, other)
    for name, record in one.contacts.items():
        again = other.contacts[name]
        assert record.changes == again.changes
        for what in ("mode", "gap", "normal", "friction", "slip"):
            assert getattr(record, what).tobytes() == getattr(again, what).tobytes(), what


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_cut_off_again_and_again_has_the_bits_of_one_that_was_not(
    kind, small, tmp_path, monkeypatch
):
    monkeypatch.setattr(course, "LONGEST", 16)
    lv.integrate(**KINDS[kind]()).save(tmp_path / "whole.zarr")
    whole, path = lv.load(tmp_path / "whole.zarr"), tmp_path / "run.zarr"
    with pytest.raises(CutError):
        lv.integrate(**KINDS[kind](), store=lv.Store(path, 5), progress=cutting(2))
    for cuts in count(1):
        with suppress(CutError):
            solution = lv.resume(path, progress=cutting(2 + 2**cuts))
            break
        assert_prefix(lv.load(path), whole)
    assert cuts > 1
    agree(whole, lv.load(path))
    assert solution.t.tolist() == [whole.t[0], whole.t[-1]]
    agree(whole, lv.load(lv.resume(path).path))


@needs_fork
def test_processes_killed_at_any_moment_leave_the_bits_of_one_that_lived(tmp_path):
    call = bouncing(t=(0, 60))
    lv.integrate(**call).save(tmp_path / "whole.zarr")
    whole, path = lv.load(tmp_path / "whole.zarr"), tmp_path / "run.zarr"
    assert killed(path, call, whole, 4, seed=4) > 0  # how many is the machine's affair
    agree(whole, lv.load(path))


@needs_fork
def test_an_interrupt_ends_behind_a_stretch_and_the_run_goes_on_from_there(tmp_path):
    whole = lv.integrate(**bouncing(t=(0, 60)))

    def stopped(pipe):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        beat = count()

        def progress(done, total):
            if next(beat) == 1:
                signal.raise_signal(signal.SIGINT)

        run = lv.integrate(**bouncing(t=(0, 60)), store=tmp_path / "run.zarr", progress=progress)
        pipe.send((run.status, run.message, run.t[-1]))

    receive, send = get_context("fork").Pipe(duplex=False)
    process = get_context("fork").Process(target=stopped, args=(send,))
    process.start()
    status, message, end = receive.recv()
    process.join()
    assert status == "interrupted"
    assert message.startswith(f"interrupted at t = {end:g};")
    assert message.endswith("run.zarr') goes on")
    lv.resume(tmp_path / "run.zarr")
    assert lv.load(tmp_path / "run.zarr").t.tobytes() == whole.t.tobytes()


@pytest.mark.parametrize("many", [1, touching.MANY])
def test_a_run_that_fails_keeps_what_was_done_in_its_folder(many, tmp_path, monkeypatch):
    """A wall comes down on the block at t = 4, and no motion is left."""
    monkeypatch.setattr(touching, "MANY", many)
    press = lv.Contact(lambda t, q, params: 4 - t - q[1])
    floor = lv.Contact(height, friction=0.2, slip=slip)
    system = lv.Lagrangian(lagrangian, q=("x", "y"), contacts={"floor": floor, "wall": press})
    call = bouncing(system=system, q=[0, 0], events=None)
    with pytest.raises(lv.IntegrationError) as plain:
        lv.integrate(**call)
    with pytest.raises(lv.IntegrationError, match="'floor' and 'wall' contradict") as caught:
        lv.integrate(**call, store=tmp_path / "run.zarr")
    left = lv.load(tmp_path / "run.zarr")
    assert left.status == "failed"
    assert left.t.tobytes() == plain.value.solution.t.tobytes()
    assert caught.value.solution.path == str(tmp_path / "run.zarr")
    assert left.message == plain.value.solution.message
    with pytest.raises(lv.IntegrationError, match="'floor' and 'wall' contradict"):
        lv.resume(tmp_path / "run.zarr")
    assert left.t.tobytes() == lv.load(tmp_path / "run.zarr").t.tobytes()


def sliding(**more):
    """Return a block that comes to rest at t = 0.4, which the alpha method does not hold."""
    floor = lv.Contact(height, friction=0.5, slip=lambda t, q, v, params: v[0])
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - 10 * q[1],
        q=("x", "y"),
        contacts={"floor": floor},
    )
    call = {"system": system, "method": lv.GeneralizedAlpha(0.9), "t": (0, 1), "h": 0.1}
    return call | {"q": [0, 0], "v": [2, 0]} | more


def weightless(**more):
    """Return a ball above a table whose weight is no number from t = 0.55 on."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - ca.sqrt(0.55 - t) * q[0],
        q=("y",),
        contacts={"table": lv.Contact(lambda t, q, params: q[0])},
    )
    call = {"system": system, "method": lv.Spark(2), "t": (0, 1), "h": 0.1, "q": [1], "v": [0]}
    return call | more


FAILING = {
    "in the first stretch": weightless,
    "as the second begins": sliding,
    "before there is a record": lambda: sliding(t_eval=[0.9]),
}


@pytest.mark.parametrize("kind", FAILING)
def test_a_run_that_fails_early_keeps_its_records_and_fails_again_on_its_way(kind, tmp_path):
    call, path = FAILING[kind](), tmp_path / "run.zarr"
    with pytest.raises(lv.IntegrationError) as plain:
        lv.integrate(**call)
    plain.value.solution.save(tmp_path / "whole.zarr")
    whole, message = lv.load(tmp_path / "whole.zarr"), str(plain.value).splitlines()[0]
    with pytest.raises(lv.IntegrationError, match=message):
        lv.integrate(**call, store=path)
    agree(whole, lv.load(path))
    with pytest.raises(lv.IntegrationError, match=message):
        lv.resume(path)
    agree(whole, lv.load(path))


def test_functions_of_a_stored_run_need_no_module(tmp_path):
    call = sliding(
        method=lv.Spark(2),
        observe={"power": lambda t, q, v, params: -5 * v[0]},
        events={"slow": lambda t, q, v, lam, params: v[0] - 1},
        control=lv.Reversible(monitor=lambda t, q, v, params: 1 / (1 + v[0] ** 2)),
    )
    lv.integrate(**call).save(tmp_path / "whole.zarr")
    lv.integrate(**call, store=tmp_path / "run.zarr")
    job = (tmp_path / "run.zarr" / "checkpoint" / "job.pickle").read_bytes()
    assert __name__.encode() not in job
    agree(lv.load(tmp_path / "whole.zarr"), lv.load(tmp_path / "run.zarr"))


WHOLE = {
    "one stretch": {"t": (0, 0.3)},
    "one step": {"t": (0, 0.05)},
    "one stretch and no states": {"t": (0, 0.3), "states": False},
    "no record in the first": {"t_eval": [0.5, 1.0]},
    "one record, the last": {"t_eval": [5.0]},
}


@pytest.mark.parametrize("kind", WHOLE)
def test_a_run_of_few_stretches_or_records_is_stored_whole(kind, tmp_path):
    call = bouncing(events=None, **WHOLE[kind])
    lv.integrate(**call).save(tmp_path / "whole.zarr")
    solution = lv.integrate(**call, store=tmp_path / "run.zarr")
    assert solution.status == "done"
    agree(lv.load(tmp_path / "whole.zarr"), lv.load(tmp_path / "run.zarr"))


def test_stores_and_tangents_of_runs_with_contacts_are_not_for_each_other(tmp_path):
    with pytest.raises(TypeError, match="tangents= of runs with contacts go without store="):
        lv.integrate(**bouncing(), tangents={"v": [1.0, 0]}, store=tmp_path / "run.zarr")
    assert not [*tmp_path.iterdir()]
