"""Contacts that contradict one another, that are one twice, and that hold from rest."""

import casadi as ca
import numpy as np
import pytest
from scipy import optimize

import liouville as lv
from liouville._runs.contacts import Mode, law, margin
from liouville._runs.contacts import run as _run
from liouville._runs.contacts.switching import Switching
from liouville.bodies import Assembly, Polygon

G = 9.81


def point(contacts, force=0.0):
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1] + force * q[0],
        q=("x", "y"),
        contacts=contacts,
    )


def gap(x, y, off, friction=0.0, restitution=0.0):
    """Return a contact with gap x q0 + y q1 + off(t)."""
    return lv.Contact(
        lambda t, q, params: x * q[0] + y * q[1] + off(t),
        restitution=restitution,
        friction=friction,
        slip=lambda t, q, v, params: y * v[0] - x * v[1],
    )


def thrown(system, until=2.0, v=(0.0, 0.0)):
    return lv.integrate(system, lv.Spark(2), t=(0, until), h=0.05, q=[0.0, 0.0], v=list(v))


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_walls_that_squeeze_a_point_are_named(restitution, friction):
    laws = {"friction": friction, "restitution": restitution}
    squeezed = point(
        {
            "floor": gap(0, 1, lambda t: 0, **laws),
            "press": gap(0, -1, lambda t: 1 - t, **laws),
            "far": gap(1, 0, lambda t: 1, **laws),
        }
    )
    words = "at t = 1 contacts 'floor' and 'press' contradict one another\n"
    with pytest.raises(lv.IntegrationError, match=words) as caught:
        thrown(squeezed)
    assert caught.value.solution.t[-1] == pytest.approx(1)
    assert caught.value.solution.q[-1] == pytest.approx([0, 0], abs=1e-14)


def test_walls_that_squeeze_by_their_accelerations_are_named():
    squeezed = point({"floor": gap(0, 1, lambda t: 0), "press": gap(0, -1, lambda t: -(t**2) / 2)})
    with pytest.raises(lv.IntegrationError, match="'floor' and 'press' contradict one another\n"):
        thrown(squeezed)


def wedged(friction):
    """Return a point between a floor and a slope of .1 that comes down."""
    n = np.array([0.1, -1]) / np.hypot(0.1, 1)
    laws = {"friction": friction}
    return point(
        {
            "floor": gap(0, 1, lambda t: 0, **laws),
            "slope": gap(*n, lambda t: 0.5 - t, **laws),
        }
    )


def test_a_wedge_throws_out_what_friction_does_not_hold():
    """Friction holds it where the angle of friction is half the wedge's."""
    run = thrown(wedged(0.0), 1.0)
    assert run.v[-1] == pytest.approx([10 * np.hypot(0.1, 1), 0])
    assert thrown(wedged(0.049), 0.51).v[-1, 0] > 0
    words = "'floor' and 'slope' contradict one another, wedged in by their friction"
    with pytest.raises(lv.IntegrationError, match=words):
        thrown(wedged(0.051), 0.51)


@pytest.mark.parametrize(
    ("force", "static", "sticks"),
    [(0, None, True), (4.9, None, True), (-0.5 * G, None, True), (5, None, False), (5, 0.6, True)],
)
def test_friction_sticks_from_rest(force, static, sticks):
    floor = lv.Contact(
        lambda t, q, params: q[1],
        friction=0.5,
        static_friction=static,
        slip=lambda t, q, v, params: v[0],
    )
    run = thrown(point({"floor": floor}, force))
    assert {mode.name for mode in run.contacts["floor"].mode} == {"STICK" if sticks else "SLIP_UP"}
    wanted = 0 if sticks else (force - 0.5 * G) * 2
    assert run.q[-1] == pytest.approx([wanted, 0], abs=1e-14)
    assert run.contacts["floor"].friction == pytest.approx(-(force if sticks else 0.5 * G))


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("rate", [-5e-13, -1e-12])
def test_a_rate_that_is_roundoff_beside_a_fast_contact_is_no_hit(rate, friction):
    """No impulse changes it: the laws hold to roundoff of the largest rate."""
    laws = {"friction": friction, "restitution": 0.5}
    both = {"floor": gap(0, 1, lambda t: 0, **laws), "wall": gap(1, -0.5, lambda t: 0, **laws)}
    run = thrown(point(both), 0.1, (0.5 + rate, 1.0))
    assert run.contacts["floor"].mode[0] is Mode.OPEN
    assert run.contacts["wall"].gap.min() > -1e-14


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_corner_on_a_corner_is_one_impact(restitution):
    """Each corner meets the outline of the other: two contacts, of which one bears."""
    m = Assembly()
    square = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    bodies = [m.planar_body(f"{k}", mass=1.0 + k, inertia=0.5, at=(2.5 * k, 0)) for k in range(2)]
    for body in bodies:
        m.free(f"flight {body.name}", body)
    shapes = [Polygon(x, square + np.array([2.5 * k, 0]), 0.1) for k, x in enumerate(bodies)]
    m.contact("pair", *shapes, restitution=restitution)
    start = {"v": [1.0, 0, 0, 0, 0, 0]}
    run = lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.1, **(m.start() | start))
    impulse = 2 / 3 * (1 + restitution)
    wanted = [1 - impulse, 0, 0, impulse / 2, 0, 0]
    assert run.v[-1] == pytest.approx(wanted, abs=1e-13)
    hits = [x for own in run.contacts.values() for x in own.changes if x.kind == "hit"]
    assert [x.normal for x in hits] == pytest.approx([impulse])


def test_an_interrupt_between_stretches_keeps_what_was_done():
    def stop(done, total):
        if done > 0.5 * total:
            raise KeyboardInterrupt

    elastic = point({"floor": gap(0, 1, lambda t: 0, restitution=1.0)})
    call = {"t": (0, 10), "h": 0.1, "q": [0.0, 0.1], "v": [0.0, 0.0]}
    run = lv.integrate(elastic, lv.Spark(2), progress=stop, **call)
    whole = lv.integrate(elastic, lv.Spark(2), **call)
    assert run.status == "interrupted"
    assert run.message == f"interrupted at t = {run.t[-1]:g}"
    assert 4 < run.t[-1] < 6
    assert run.q[:-1].tobytes() == whole.q[: len(run.t) - 1].tobytes()


def test_a_single_rough_contact_has_the_forces_of_lemkes_method(monkeypatch):
    rng, one = np.random.default_rng(0), np.array([0])
    problems = []
    for mu in (0.1, 0.5, 1.0) * 200:
        X = rng.normal(size=(2, 3))
        borne = np.array([max(rng.normal(), 0.0)])
        problems.append((X @ X.T, rng.normal(size=2), np.array([mu]), borne))

    def forces():
        found = [
            law.solve(A, b, one == 0, np.zeros(1), mu, one, borne) for A, b, mu, borne in problems
        ]
        return [np.append(x.normal, x.friction) for x in found]

    quick = forces()
    none = np.zeros(1)
    monkeypatch.setattr(law, "_alone", lambda *args: (none > 0, none, none))
    for own, wanted in zip(quick, forces(), strict=True):
        assert own == pytest.approx(wanted, abs=1e-10 * max(1, np.abs(wanted).max()))


@pytest.mark.parametrize("frequency", np.linspace(25, 80, 12))
def test_a_block_leaves_a_plate_that_falls_faster_than_it(frequency):
    """There its normal force is roundoff, of either sign."""
    plate = lv.Contact(lambda t, q, params: q[0] - 0.02 * ca.sin(frequency * t))
    block = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - G * q[0], q=1, contacts={"plate": plate}
    )
    start = {"q": [0.0], "v": [0.02 * frequency]}
    run = lv.integrate(block, lv.Spark(2), t=(0, 0.07), h=2e-3, **start)
    kinds = [x.kind for x in run.contacts["plate"].changes]
    assert kinds[:2] == ["close", "leave"]
    wanted = np.arcsin(G / (0.02 * frequency**2)) / frequency
    assert run.contacts["plate"].changes[1].t == pytest.approx(wanted, abs=1e-14)
    assert run.contacts["plate"].normal.min() > -1e-12


def test_a_contact_that_pulls_is_refused(monkeypatch):
    """As it would where the end of its force is missed: beside one whose pull is roundoff."""
    masses, heights = (1e10, 1.0), (G * (1 + 1e-9) / 50**2, 0.02)
    plates = {
        name: lv.Contact(lambda t, q, params, k=k: q[k] - heights[k] * ca.sin(50 * t))
        for k, name in enumerate(("heavy", "light"))
    }
    blocks = lv.Lagrangian(
        lambda t, q, v, params: sum(m * (v[k] ** 2 / 2 - G * q[k]) for k, m in enumerate(masses)),
        q=2,
        contacts=plates,
    )
    monkeypatch.setattr(_run, "endings", lambda *args: {})
    start = {"q": [0.0, 0.0], "v": [50 * height for height in heights]}
    with pytest.raises(lv.IntegrationError, match=r"contact 'light' pulls with .* may only"):
        lv.integrate(blocks, lv.Spark(2), t=(0, np.pi / 100), h=np.pi / 1000, **start)


@pytest.mark.parametrize(("system", "partner"), [(lv.Lagrangian, "v"), (lv.Hamiltonian, "p")])
def test_a_foot_that_is_closed_does_not_push_another_into_the_floor(system, partner):
    """The left foot of a beam is 8e-13 high and at rest, while the right one rises."""
    masses = np.array([2.0, 8.0])
    feet = {
        name: lv.Contact(lambda t, q, params, way=way: q[0] - 1 + way * q[1])
        for name, way in (("left", -1), ("right", 1))
    }

    def function(t, q, moving, params):
        if partner == "v":
            return ca.dot(masses, moving**2) / 2 - 20 * q[0]
        return ca.dot(1 / masses, moving**2) / 2 + 20 * q[0]

    beam = system(function, q=("height", "angle"), contacts=feet)
    start = {"q": [1 + 4e-13, -4e-13], partner: 0.5 * masses ** (partner == "p")}
    run = lv.integrate(beam, lv.Spark(2), t=(0, 0.02), h=0.01, **start)
    assert {mode.name for mode in run.contacts["left"].mode} == {"CLOSED"}
    for record in run.contacts.values():
        assert record.gap.min() > -1e-15


def test_forces_of_one_unknown_have_the_margin_of_the_linear_program():
    rng = np.random.default_rng(0)
    for kind in (1, -1, 0) * 50:
        n = int(rng.integers(1, 7))
        a, slopes = rng.normal(size=(2, n)) * (rng.random((2, n)) > [[0], [0.2]])
        slopes = kind * np.abs(slopes) if kind else slopes
        (w,), found = margin._best_of_one(a, slopes)
        rows = np.column_stack([-slopes, np.ones(n)])
        best = optimize.linprog([0, -1], rows, a, bounds=[(None, None), (None, margin.LARGEST)])
        assert found == pytest.approx(-best.fun, abs=1e-12)
        assert (a + slopes * w).min() >= found - 1e-12


def test_a_slip_that_stops_as_a_low_flight_ends_goes_on_as_that_moves_it():
    """A box pushed by F > mu m g stops sliding back, on one corner; the other flies 1e-16 high."""
    corners = {
        name: lv.Contact(
            lambda t, q, params, side=side: q[1] + side / 2 * ca.sin(q[2]) - ca.cos(q[2]) / 4,
            friction=0.3,
            slip=lambda t, q, v, params: v[0] + v[2] / 4,
        )
        for name, side in (("back", -1), ("front", 1))
    }
    box = lv.Lagrangian(
        lambda t, q, v, params: (ca.sumsqr(v[:2]) + 0.1 * v[2] ** 2) / 2 - G * q[1] + 20 * q[0],
        q=("x", "y", "angle"),
        contacts=corners,
    )
    now = Switching(box.contacts, 0.0, 0.02, box.values(None))
    now.modes = Mode.SLIP_DOWN, Mode.OPEN
    turns = 1e-7
    y, z = np.array([0, 0.25, 0]), np.array([-turns / 4, turns / 2, turns])
    y, z = now.settle(y, z, {0})
    np.testing.assert_allclose(now.at(0.0, y, z).slip, -turns / 4, rtol=1e-9)
    assert now.modes == (Mode.SLIP_DOWN, Mode.SLIP_DOWN)
