"""Hits that the core answers by itself obey the laws of those that it does not."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._runs.contacts import run as runs

G = 9.81


def dropped(restitution, **more):
    contact = lv.Contact(lambda t, q, params: q[0], restitution=restitution)
    body = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 - 2 * G * q[0], q=1, contacts={"floor": contact}
    )
    call = {"t": (0, 2), "h": 0.05, "q": [0.1], "v": [0.0]} | more
    return lv.integrate(body, lv.Spark(2), **call)


def boxed(count, until, seed=1, restitution=1.0, **more):
    """Return a run of discs of radius .1 in a box of 2."""
    contacts = {}
    sides = {"left": (1, 0, 0), "right": (-1, 0, 2), "low": (0, 1, 0), "high": (0, -1, 2)}
    for i in range(count):
        for name, (x, y, off) in sides.items():
            contacts[f"{i} {name}"] = lv.Contact(
                lambda t, q, params, i=i, x=x, y=y, off=off: (
                    x * q[2 * i] + y * q[2 * i + 1] + off - 0.1
                ),
                restitution=restitution,
            )
        for j in range(i):
            contacts[f"{i} {j}"] = lv.Contact(
                lambda t, q, params, i=i, j=j: (
                    ca.hypot(q[2 * i] - q[2 * j], q[2 * i + 1] - q[2 * j + 1]) - 0.2
                ),
                restitution=restitution,
            )
    system = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2, q=2 * count, contacts=contacts)
    rng = np.random.default_rng(seed)
    places = np.array([(x, y) for x in (0.3, 1.0, 1.7) for y in (0.4, 1.0, 1.6)])[:count]
    q, v = (
        (places + 0.05 * rng.standard_normal(places.shape)).ravel(),
        rng.standard_normal(2 * count),
    )
    return lv.integrate(system, lv.Spark(2), t=(0, until), h=0.05, q=q, v=v, **more)


def changes(run):
    found = [(c.t, n, c.kind, c.normal) for n, x in run.contacts.items() for c in x.changes]
    return sorted(found)


def by_laws(monkeypatch, make):
    """Return a run whose hits are all answered by the laws of contacts."""
    with monkeypatch.context() as patch:
        patch.setattr(runs.Course, "_has_window", lambda *_: False)
        return make()


@pytest.mark.parametrize("restitution", [0.3, 0.8, 1.0])
def test_bounces_are_those_of_the_laws(monkeypatch, restitution):
    run = dropped(restitution)
    slow = by_laws(monkeypatch, lambda: dropped(restitution))
    assert run.stats["stretches"] < slow.stats["stretches"]
    mine, wanted = changes(run), changes(slow)
    assert [x[1:3] for x in mine] == [x[1:3] for x in wanted]
    np.testing.assert_allclose([x[0] for x in mine], [x[0] for x in wanted], atol=1e-13)
    np.testing.assert_allclose([x[3] for x in mine], [x[3] for x in wanted], atol=1e-12)
    fall = np.sqrt(0.2 / G)
    assert mine[0][3] == pytest.approx((1 + restitution) * 2 * fall * G, rel=1e-13)
    assert run.q[-1, 0] == pytest.approx(slow.q[-1, 0], abs=1e-12)


def test_there_is_a_record_of_each_hit_after_it():
    run = dropped(0.9, observe={"height": lambda t, q, v, params: q[0]})
    hits = [x for x in run.contacts["floor"].changes if x.kind == "hit"]
    assert np.isin([x.t for x in hits], run.t).all()
    assert (np.diff(run.t) > 0).all()
    rows = np.searchsorted(run.t, [x.t for x in hits])
    assert (run.v[rows, 0] > 0).all()
    np.testing.assert_allclose(run.p[:, 0], 2 * run.v[:, 0], atol=1e-15)
    energy = run.v[:, 0] ** 2 + 2 * G * run.q[:, 0]
    np.testing.assert_allclose(run.invariants["energy"], energy, atol=1e-14)
    assert (run.observed["height"] == run.q[:, 0]).all()
    assert (run.contacts["floor"].gap == run.q[:, 0]).all()
    middle = (run.t[:-1] + run.t[1:]) / 2
    back = run.q[1:, 0] - (middle - run.t[1:]) * -run.v[1:, 0] - G * (run.t[1:] - middle) ** 2 / 2
    before_hits = np.isin(run.t[1:], run.t[rows])
    np.testing.assert_allclose(run(middle).q[~before_hits, 0], back[~before_hits], atol=1e-13)


def test_discs_in_a_box_do_as_by_the_laws(monkeypatch):
    run = boxed(5, 5.0)
    slow = by_laws(monkeypatch, lambda: boxed(5, 5.0))
    mine, wanted = changes(run), changes(slow)
    assert len(mine) > 12
    assert [x[1:3] for x in mine] == [x[1:3] for x in wanted]
    np.testing.assert_allclose([x[0] for x in mine], [x[0] for x in wanted], atol=1e-9)
    np.testing.assert_allclose([x[3] for x in mine], [x[3] for x in wanted], atol=1e-8)
    assert np.ptp(run.invariants["energy"]) < 1e-13
    assert lv.analysis.power_balance(boxed(5, 5.0, restitution=0.7)).defect == pytest.approx(
        0, abs=1e-13
    )


def test_two_hits_at_once_are_left_to_the_laws():
    """A ball in a corner, and a cradle: each contact counts, not one after another."""
    corner = {
        name: lv.Contact(lambda t, q, params, k=k: q[k], restitution=0.5)
        for k, name in enumerate("xy")
    }
    body = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 + 0.4 * v[0] * v[1], q=2, contacts=corner
    )
    run = lv.integrate(body, lv.Spark(2), t=(0, 1), h=0.1, q=[0.3, 0.3], v=[-1.0, -1.0])
    assert [x[1] for x in changes(run)] == ["x", "y"]
    assert run.v[-1] == pytest.approx([0.5, 0.5])


def test_an_event_ends_a_run_through_hits_at_its_own_count():
    passing = lv.Event(lambda t, q, v, lam, params: v[0], "down", terminal=4)
    run = dropped(1.0, t=(0, 50), events={"top": passing})
    fall = np.sqrt(0.2 / G)
    assert len(run.events["top"]) == 4
    assert run.t[-1] == pytest.approx(8 * fall)
    assert run.message.startswith("event 'top' at t = ")
    rubbed = lv.Contact(
        lambda t, q, params: q[0], restitution=1.0, friction=0.1, slip=lambda t, q, v, params: v[1]
    )
    body = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[0], q=2, contacts={"floor": rubbed}
    )
    start = {"q": [0.1, 0.0], "v": [0.0, 0.0]}
    run = lv.integrate(body, lv.Spark(2), t=(0, 50), h=0.05, events={"top": passing}, **start)
    assert len(run.events["top"]) == 4


def test_a_pendulum_bounces_on_its_stop_through_its_constraint():
    """The impulse is that along the gap, beside that of the rod."""
    stop = lv.Contact(lambda t, q, params: q[0] + 0.2, restitution=0.6)
    bob = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) - 2 * G * q[1],
        lambda t, q, params: (ca.sumsqr(q) - 1) / 2,
        q=2,
        contacts={"stop": stop},
    )
    start = {"q": [0.6, -0.8], "v": [0.0, 0.0]}
    run = lv.integrate(bob, lv.Spark(3), t=(0, 1.2), h=0.05, **start)
    hit = run.contacts["stop"].changes[0]
    height = np.sqrt(0.96) - 0.8
    speed = np.sqrt(2 * G * height) * np.sqrt(0.96)  # along x
    assert hit.normal == pytest.approx(2 * 1.6 * speed / 0.96)
    row = np.searchsorted(run.t, hit.t)
    assert run.v[row, 0] == pytest.approx(0.6 * speed)
    assert np.abs(run.residuals["hidden"]).max() < 1e-13
    assert run.lam.shape == (len(run.t), 1)
    reaction = run.reaction()[row]
    assert reaction @ run.q[row] < 0


def spun(restitution, friction, static=None, law="poisson", skew=0.0, **more):
    """Return a run of a disc with spin between three walls."""
    walls = {"floor": (0, 1, 0.0), "right": (-1, 0, 1.5), "left": (1, 0, 1.5)}
    contacts = {
        name: lv.Contact(
            lambda t, q, params, x=x, y=y, off=off: x * q[0] + y * q[1] + off - 0.1,
            restitution=restitution,
            friction=friction,
            static_friction=static,
            slip=lambda t, q, v, params, x=x, y=y: y * v[0] - x * v[1] + 0.1 * v[2],
        )
        for name, (x, y, off) in walls.items()
    }

    def kinetic(v):
        return (v[0] ** 2 + v[1] ** 2 + 0.005 * v[2] ** 2) / 2 + skew * v[1] * v[2]

    disc = lv.Lagrangian(
        lambda t, q, v, params: kinetic(v) - G * q[1], q=3, contacts=contacts, impacts=law
    )
    call = {"t": (0, 2.5), "h": 0.05, "q": [0, 0.5, 0], "v": [1.5, 0, 20]} | more
    return lv.integrate(disc, lv.Spark(2), **call)


@pytest.mark.parametrize(
    "laws",
    [(0.8, 0.3), (1.0, 0.1), (0.6, 0.2, 0.5), (0.8, 0.3, None, "newton"), (0.7, 0.8, None)],
)
@pytest.mark.parametrize("skew", [0.0, 0.01])
def test_hits_with_friction_are_those_of_the_laws(monkeypatch, laws, skew):
    """Without skew the mass normal force and friction do not act on each other's rates."""
    run = spun(*laws, skew=skew)
    slow = by_laws(monkeypatch, lambda: spun(*laws, skew=skew))
    assert run.stats["stretches"] < slow.stats["stretches"]
    found = [
        [
            (c.t, n, c.kind, c.normal, c.friction)
            for n, x in each.contacts.items()
            for c in x.changes
        ]
        for each in (run, slow)
    ]
    mine, wanted = found
    assert len(mine) > 4
    assert [x[1:3] for x in mine] == [x[1:3] for x in wanted]
    for place in (0, 3, 4):
        np.testing.assert_allclose([x[place] for x in mine], [x[place] for x in wanted], atol=1e-12)
    np.testing.assert_allclose(run.q[-1], slow.q[-1], atol=1e-12)
    assert any(abs(x[4]) > 0.01 for x in mine)


def test_a_hit_with_friction_and_a_constraint_has_its_impulses(monkeypatch):
    """A disc that turns at the end of a rod hits a stop: the rod takes part of the impulse."""
    stop = lv.Contact(
        lambda t, q, params: q[0] + 0.2,
        restitution=0.6,
        friction=0.1,
        slip=lambda t, q, v, params: v[1] + 0.1 * v[2],
    )
    bob = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 + v[1] ** 2 + 0.005 * v[2] ** 2 - 2 * G * q[1],
        lambda t, q, params: (q[0] ** 2 + q[1] ** 2 - 1) / 2,
        q=3,
        contacts={"stop": stop},
    )
    call = {"t": (0, 9), "h": 0.05, "q": [0.6, -0.8, 0.0], "v": [0.0, 0.0, 5.0]}
    run = lv.integrate(bob, lv.Spark(3), **call)
    slow = by_laws(monkeypatch, lambda: lv.integrate(bob, lv.Spark(3), **call))
    assert run.stats["stretches"] < slow.stats["stretches"]
    np.testing.assert_allclose(run.q[-1], slow.q[-1], atol=1e-11)
    both = (x.contacts["stop"].changes for x in (run, slow))
    mine, wanted = ([(x.t, x.normal, x.friction) for x in own] for own in both)
    np.testing.assert_allclose(mine, wanted, atol=1e-10)
    assert abs(mine[0][2]) > 0.01


def test_windows_without_hits_do_not_outgrow_the_run():
    """Each flight from a table that shakes off a body, under a lid, doubled the next window."""
    table = lv.Contact(lambda t, q, params: q[0] - 0.5 * ca.sin(2 * np.pi * t))
    lid = lv.Contact(lambda t, q, params: 100 - q[0], restitution=1.0)
    body = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - G * q[0], q=1, contacts={"table": table, "lid": lid}
    )
    run = lv.integrate(body, lv.Spark(2), t=(0, 70), h=0.05, q=[0.0], v=[np.pi])
    assert sum(change.kind == "hit" for change in run.contacts["table"].changes) >= 65


def test_of_many_contacts_the_first_that_changed_are_shown_by_name():
    few, many = boxed(2, 0.5), boxed(9, 2.0)
    shown = repr(few).splitlines()
    hits = sum(bool(x.changes) for x in few.contacts.values())
    assert len([line for line in shown if "contact '" in line]) == hits
    assert f"{9 - hits} " in shown[-1]
    assert shown[-1].endswith("contacts: no changes>")
    *named, rest = [line for line in repr(many).splitlines() if " contact" in line]
    assert len(named) == 8
    counts = [int(line.split(": ")[1].split()[0]) for line in (*named, rest)]
    assert rest.startswith(" 64 other contacts: ")
    assert sum(counts) == sum(len(x.changes) for x in many.contacts.values())
