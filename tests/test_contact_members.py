"""Ensembles with contacts: each member in modes of its own, and what fails by member."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv

G = 9.81


def block(restitution=0.5):
    floor = lv.Contact(
        lambda t, q, params: q[1],
        restitution=restitution,
        friction=0.3,
        slip=lambda t, q, v, params: v[0] - params.belt,
    )
    press = lv.Contact(lambda t, q, params: params.height - t * params.down - q[1])
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=("x", "y"),
        params={"belt": 0.0, "height": 5.0, "down": 0.0},
        contacts={"floor": floor, "press": press},
    )


STARTS = {"q": [[0, 0.1], [0, 0], [0, 0.5]], "v": [[1.0, 0], [1.0, 0], [0.0, 1.0]]}
CALL = {"t": (0, 1), "h": 0.05}


def alone(system, k, params=None, **more):
    start = {name: x[k] for name, x in STARTS.items()}
    return lv.integrate(system, lv.Spark(2), params=params, **start, **(CALL | more))


@pytest.mark.parametrize("more", [{}, {"every": 3}, {"t_eval": [0.2, 0.33, 1.0]}])
def test_members_do_as_alone(more):
    system = block()
    many = lv.ensemble(system, lv.Spark(2), **STARTS, **CALL, **more)
    assert (many.status, many.members) == ("done", 3)
    assert many.q.shape == (len(many.t), 3, 2)
    times = more.get("t_eval", many.t)
    for k in range(3):
        one, member = alone(system, k, t_eval=times), many.member(k)
        assert member.q.tobytes() == one.q.tobytes()
        assert member.invariants["energy"].tobytes() == one.invariants["energy"].tobytes()
        for name, record in member.contacts.items():
            assert record.changes == one.contacts[name].changes
            assert [*record.mode] == [*one.contacts[name].mode]
            assert (record.normal == one.contacts[name].normal).all()
    kinds = [{x.kind for x in own} for own in many.contacts["floor"].changes]
    assert kinds[0] != kinds[1]
    assert "contact 'floor':" in repr(many)


def test_an_ensemble_says_which_member_has_gained_energy():
    """A rod whose slip comes to rest, by Newton's law: the gain that Kane has found."""
    tip = lv.Contact(
        lambda t, q, params: q[1] - ca.sin(q[2]) / 2,
        restitution=0.9,
        friction=1.5,
        slip=lambda t, q, v, params: v[0] + ca.sin(q[2]) * v[2] / 2,
    )
    rod = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 / 12) / 2 - G * q[1],
        q=("x", "y", "angle"),
        impacts="newton",
        contacts={"tip": tip},
    )
    q, v = [0, np.sin(1) / 2 + 0.02, 1], [[0, 1, 0], [1, -2, 5]]
    one = lv.integrate(rod, lv.Spark(2), t=(0, 0.05), h=0.01, q=q, v=v[1])
    many = lv.ensemble(rod, lv.Spark(2), t=(0, 0.05), h=0.01, q=[q, q], v=v)
    assert "gained energy" in one.message
    assert many.message == f"member 1: {one.message}"


def test_an_ensemble_of_which_no_member_can_start_says_how_many():
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - ca.sqrt(params.weight - t) * q[0],
        q=("y",),
        params={"weight": -1.0},
        contacts={"table": lv.Contact(lambda t, q, params: q[0])},
    )
    with pytest.raises(lv.IntegrationError, match=r"^2 of 2 members .*, member 0: .* finite"):
        lv.ensemble(system, lv.Spark(2), q=[[1.0], [2.0]], v=[0.0], **CALL)


def test_a_member_that_fails_is_put_down_and_the_others_go_on():
    """One is squeezed at t = 0.5, and one goes to the end; an event ends the third."""
    system = block()
    params = {"height": [5.0, 0.5, 5.0], "down": [0.0, 1.0, 0.0]}
    high = lv.Event(lambda t, q, v, lam, params: q[1] - 0.54, "up", terminal=True)
    many = lv.ensemble(system, lv.Spark(2), params=params, events={"h": high}, **STARTS, **CALL)
    assert many.status == "partly failed"
    assert [*many.failures] == [1]
    failure = many.failures[1]
    assert failure.t == pytest.approx(0.5)
    assert "contacts 'floor' and 'press' contradict one another" in failure.message
    failed, ended, whole = many.member(1), many.member(2), many.member(0)
    assert failed.t[-1] == pytest.approx(0.5)
    assert failed.params["down"] == 1.0
    assert len(failed.contacts["floor"].gap) == len(failed.t)
    assert [*many.endings] == [2]
    assert ended.t[-1] < many.events["h"].t[0] < ended.t[-1] + 0.05
    assert len(whole.t) == 21
    assert many.contacts["floor"].mode[-1, 1] is None
    assert np.isnan(many.contacts["floor"].gap[-1, 1])


def test_files_keep_members_with_contacts(tmp_path):
    system = block()
    params = {"height": [5.0, 0.5, 5.0], "down": [0.0, 1.0, 0.0]}
    many = lv.ensemble(system, lv.Spark(2), params=params, **STARTS, **CALL)
    for suffix in ("nc", "zarr", "npz"):
        many.save(tmp_path / f"many.{suffix}")
        again = lv.load(tmp_path / f"many.{suffix}")
        assert repr(again) == repr(many)
        for name, record in many.contacts.items():
            other = again.contacts[name]
            assert other.changes == record.changes
            assert (other.mode == record.mode).all()
            assert other.normal.tobytes() == record.normal.tobytes()
    table = many.to_dataframe()
    assert len(table) == 3 * len(many.t)
    assert table["contact_mode[floor]"].min() == -1
    early = many.sel(time=slice(0, 0.2)).contacts["floor"]
    assert all(x.t <= 0.2 for own in early.changes for x in own)


def test_what_ensembles_with_contacts_go_without_is_said():
    system = block()
    with pytest.raises(ValueError, match="has a row for each member"):
        lv.ensemble(system, lv.Spark(2), q=[0.0, 1.0], v=[0.0, 0.0], **CALL)
    with pytest.raises(ValueError, match=r"^member 1: contact 'floor' penetrates by 0.5 at the"):
        lv.ensemble(system, lv.Spark(2), q=[[0, 1], [0, -0.5]], v=np.zeros((2, 2)), **CALL)
    with pytest.raises(lv.IntegrationError, match="contradict") as caught:
        lv.ensemble(
            system,
            lv.Spark(2),
            params={"height": [0.0, 0.0, 0.0], "down": [1.0, 1.0, 1.0]},
            q=np.zeros((3, 2)),
            v=np.zeros((3, 2)),
            **CALL,
        )
    assert caught.value.t == 0


def test_a_member_that_fails_is_named_where_a_pullback_is_asked_for():
    params = {"height": [5.0, 0.0], "down": [0.0, 1.0]}
    rest = {"q": np.zeros((2, 2)), "v": np.zeros((2, 2))}
    with pytest.raises(lv.IntegrationError, match=r"1 of 2 members failed.* member 1") as caught:
        lv.vjp(block(), lv.Spark(2), wrt=["v"], params=params, **rest, **CALL)
    assert caught.value.solution.members == 2
