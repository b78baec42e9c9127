"""Systems with contacts as others use them: pickles, parts of solutions, switches, messages."""

import copy
import json
import pickle

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._solution.export.datasets import from_xarray

G = 9.81


def ball(restitution=0.5, friction=0.3):
    floor = lv.Contact(
        lambda t, q, params: q[1],
        restitution=restitution,
        friction=friction,
        slip=lambda t, q, v, params: v[0] - params.belt,
    )
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=("x", "y"),
        params={"belt": 0.1},
        contacts={"floor": floor},
    )


def thrown(system, **more):
    start = {"q": [0.0, 0.1], "v": [1.0, 0.0]}
    return lv.integrate(system, lv.Spark(2), t=(0, 1), h=0.1, **start, **more)


def test_a_system_with_contacts_is_pickled_without_its_functions():
    system = ball()
    run = thrown(system)
    for other in (pickle.loads(pickle.dumps(system)), copy.copy(system)):
        again = thrown(other, params={"belt": 0.1})
        assert again.q.tobytes() == run.q.tobytes()
        assert again.contacts["floor"].changes == run.contacts["floor"].changes
    arrived = pickle.loads(pickle.dumps(run))
    assert arrived.contacts["floor"].changes == run.contacts["floor"].changes
    assert thrown(arrived.system).q.tobytes() == run.q.tobytes()


def test_a_part_of_a_solution_has_that_part_of_its_contacts():
    run = thrown(ball())
    early = run.sel(time=slice(0, 0.2))
    floor, whole = early.contacts["floor"], run.contacts["floor"]
    assert len(floor.gap) == len(early.t) < len(run.t)
    assert (floor.gap == whole.gap[: len(early.t)]).all()
    assert floor.changes == whole.changes[: len(floor.changes)]
    assert 0 < len(floor.changes) < len(whole.changes)
    assert floor.changes[-1].t <= 0.2 < whole.changes[len(floor.changes)].t


def test_dense_output_goes_through_changes():
    """Between hits a parabola, then a slide to rest; at a change the state after it."""
    run = thrown(ball(0.5, 0.0))
    hits = [c.t for c in run.contacts["floor"].changes if c.kind == "hit"]
    fall = np.sqrt(0.2 / G)
    times = np.sort([0.3 * fall, fall + 0.1 * fall, fall + 0.95 * fall, 0.9])
    found = run(times)
    np.testing.assert_allclose(found.q[:, 0], times, atol=1e-14)
    since, up = times[1:3] - fall, 0.5 * G * fall
    np.testing.assert_allclose(found.q[1:3, 1], up * since - G * since**2 / 2, atol=1e-14)
    assert found.q[0, 1] == pytest.approx(0.1 - G * (0.3 * fall) ** 2 / 2, abs=1e-14)
    assert found.q[3, 1] == pytest.approx(0, abs=1e-15)
    assert found.lam.shape == (4, 0)
    assert run(hits[0]).v[1] == pytest.approx(up, abs=1e-13)
    at_records = run(run.t)
    assert at_records.q.tobytes() == run.q.tobytes()
    assert run.sel(time=slice(0, 0.3))(0.2).q.tobytes() == run(0.2).q.tobytes()
    assert run([]).q.shape == (0, 2)


def test_a_file_of_a_run_with_contacts_has_no_dense_output(tmp_path):
    """Its system knows of no modes: between records it would fall through the floor."""
    system = ball()
    run = thrown(system)
    run.save(tmp_path / "run.nc")
    again = lv.load(tmp_path / "run.nc", system=system, method=lv.Spark(2))
    assert again.q.tobytes() == run.q.tobytes()
    with pytest.raises(ValueError, match="dense output needs the states of all steps"):
        again(0.5)


SUFFIXES = ("nc", "zarr", "npz")


def boxed():
    """Return a box on two corners that share its weight, pushed until it slides."""
    slip = {"friction": 0.4, "slip": lambda t, q, v, params: v[0]}
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1] + 2 * t * q[0],
        q=("x", "y", "angle"),
        contacts={
            "left": lv.Contact(lambda t, q, params: q[1] - ca.sin(q[2]), **slip),
            "right": lv.Contact(lambda t, q, params: q[1] + ca.sin(q[2]), **slip),
        },
    )


def pushed(**more):
    start = {"q": [0.0, 0.0, 0.0], "v": [0.0, 0.0, 0.0]}
    return lv.integrate(boxed(), lv.Spark(2), t=(0, 3), h=0.1, **start, **more)


def same(one, other):
    """Whether contacts did the same, bit for bit."""
    return (
        list(one) == list(other)
        and all(
            getattr(one[name], what).tobytes() == getattr(other[name], what).tobytes()
            for name in one
            for what in ("gap", "normal", "friction", "slip")
        )
        and all(
            list(one[name].mode) == list(other[name].mode)
            and one[name].changes == other[name].changes
            for name in one
        )
    )


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_keep_what_contacts_did(tmp_path, suffix):
    for run in (thrown(ball()), pushed(), thrown(ball()).sel(time=slice(0, 0.05))):
        run.save(tmp_path / f"run.{suffix}")
        again = lv.load(tmp_path / f"run.{suffix}")
        assert same(again.contacts, run.contacts)
        assert same(pickle.loads(pickle.dumps(run)).contacts, run.contacts)
        assert repr(again) == repr(run)
    assert any(x.rest is not None for x in thrown(ball()).contacts["floor"].changes)


def test_tables_and_datasets_have_what_contacts_did():
    run = pushed()
    table, data, right = run.to_dataframe(), run.to_xarray(), run.contacts["right"]
    assert list(table["contact_gap[right]"]) == list(right.gap)
    assert list(table["contact_mode[right]"]) == [int(mode) for mode in right.mode]
    assert list(data.contact_normal.sel(contact="right").values) == list(right.normal)
    assert data.contact_mode.attrs["flag_meanings"].split()[4] == "stick"
    mine = data.change_t.values[data.change_contact.values == 1]
    assert list(mine) == [change.t for change in right.changes]
    assert "contact right" in run._repr_html_()


def test_a_file_whose_contacts_are_none_is_refused(tmp_path):
    run = thrown(ball())
    for name, value, words in (
        ("contact_mode", 7, "'contact_mode' of .* must be from 0 to 5"),
        ("change_contact", 1, "'change_contact' of .* must be from 0 to 0"),
        ("change_kind", -1, "'change_kind' of .* must be from 0 to 4"),
    ):
        data = run.to_xarray()
        data[name] = data[name] * 0 + value
        with pytest.raises(ValueError, match=words):
            from_xarray(data, "file")
    data = run.to_xarray()
    order = [x for x in json.loads(data.attrs["order"]) if x != "change_rest"]
    data = data.assign_attrs(order=json.dumps(order))
    with pytest.raises(ValueError, match="has contacts and no 'change_rest'"):
        from_xarray(data, "file")


@pytest.mark.parametrize("call", [thrown, pushed])
def test_given_times_change_no_verdict(call):
    """Their states are those of solution(t), and modes and forces those of the mode then."""
    system = {"system": ball()} if call is thrown else {}
    run = call(**system)
    change = run.contacts[next(iter(run.contacts))].changes[0].t
    times = np.unique([0.0, 0.05, 0.1, change, 0.33, 0.77, 0.9, 1.0])
    at = call(**system, t_eval=times)
    assert (at.t == times).all()
    points = run(times)
    np.testing.assert_allclose(at.q, points.q, atol=1e-15)
    np.testing.assert_allclose(at.v, points.v, atol=1e-14)
    for name, record in at.contacts.items():
        own = run.contacts[name]
        assert record.changes == own.changes
        before = np.searchsorted(run.t, times, side="right") - 1
        assert [*record.mode] == [*own.mode[before]]
        there = np.isin(times, run.t)
        np.testing.assert_allclose(record.normal[there], own.normal[np.isin(run.t, times)])
    assert at.invariants["energy"][0] == run.invariants["energy"][0]
    late = call(**system, t_eval=[0.9])
    assert late.initial["energy"] == run.invariants["energy"][0]
    assert late.contacts[name].normal[0] == pytest.approx(record.normal[times == 0.9][0])


@pytest.mark.parametrize("call", [thrown, pushed])
def test_without_states_and_with_few_of_them_the_verdicts_are_the_same(call):
    system = {"system": ball()} if call is thrown else {}
    run, bare, few = call(**system), call(**system, states=False), call(**system, every=3)
    assert not bare.states
    assert (bare.t == run.t).all()
    assert same(bare.contacts, run.contacts)
    assert bare.invariants["energy"].tobytes() == run.invariants["energy"].tobytes()
    kept = np.isin(run.t, few.t)
    for name, record in few.contacts.items():
        assert record.changes == run.contacts[name].changes
        assert (record.normal == run.contacts[name].normal[kept]).all()


def test_dense_output_that_there_is_not_is_refused_by_the_reason():
    for run in (thrown(ball(), every=2), pickle.loads(pickle.dumps(thrown(ball())))):
        with pytest.raises(ValueError, match="pickles and files of runs with contacts have none"):
            run(0.5)
    with pytest.raises(ValueError, match="without t_eval"):
        thrown(ball(), t_eval=[0.5])(0.5)


def test_controlled_steps_end_at_switches_of_a_system_with_contacts_too():
    width = 1e-3
    edges = {
        f"edge {k}": lambda t, q, v, params, k=k: v[0] - k * width for k in (-8, -3, -1, 1, 3, 8)
    }

    def run(contacts):
        rubbed = lv.Lagrangian(
            lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
            force=lambda t, q, v, params: [-0.3 * ca.tanh(v[0] / width)],
            q=1,
            switches=edges,
            contacts=contacts,
        )
        return lv.integrate(rubbed, lv.Spark(3), t=(0, 10), rtol=1e-6, q=[2.0], v=[0.0])

    with_contact = run({"far": lv.Contact(lambda t, q, params: q[0] + 50)})
    assert with_contact.q.tobytes() == run(None).q.tobytes()


def test_an_elastic_ball_with_friction_is_not_said_to_gain_energy():
    walls = {"left": (1, 0, 0), "right": (-1, 0, -1), "floor": (0, 1, 0)}
    contacts = {
        name: lv.Contact(
            lambda t, q, params, x=x, y=y, off=off: x * q[0] + y * q[1] - off - 0.1,
            restitution=1,
            friction=0.3,
            slip=lambda t, q, v, params, x=x, y=y: y * v[0] - x * v[1] + 0.1 * v[2],
        )
        for name, (x, y, off) in walls.items()
    }
    spun = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + 0.005 * v[2] ** 2) / 2 - G * q[1],
        q=3,
        contacts=contacts,
    )
    run = lv.integrate(spun, lv.Spark(3), t=(0, 5), h=0.02, q=[0.5, 0.5, 0], v=[3, 1, 0])
    assert sum(len(record.changes) for record in run.contacts.values()) > 15
    assert run.message == ""
    assert np.diff(run.invariants["energy"]).max() < 1e-13
