"""Tangents of runs with contacts go through hits, and through all changes of mode."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv

G = 9.81


def belt():
    """Return a block on a spring that a belt drags along, until it slips back."""
    contact = lv.Contact(
        lambda t, q, params: q[1],
        friction=0.3,
        static_friction=0.5,
        slip=lambda t, q, v, params: v[0] - params.belt,
    )
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1] - params.k * q[0] ** 2 / 2,
        q=("x", "y"),
        params={"belt": 0.8, "k": 9.0},
        contacts={"belt": contact},
    )


def ball():
    """Return a ball with spin that falls on a floor with friction, beside a wall."""
    walls = {"floor": (0, 1, 0.0), "wall": (-1, 0, 1.5)}
    contacts = {
        name: lv.Contact(
            lambda t, q, params, x=x, y=y, off=off: x * q[0] + y * q[1] + off - params.r,
            restitution=0.6,
            friction=0.2,
            slip=lambda t, q, v, params, x=x, y=y: y * v[0] - x * v[1] + params.r * v[2],
        )
        for name, (x, y, off) in walls.items()
    }
    return lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + 0.004 * v[2] ** 2) / 2 - params.g * q[1],
        q=3,
        params={"r": 0.1, "g": G},
        contacts=contacts,
    )


def stopped():
    """Return a pendulum of constant length between a stop and a soft spring."""
    stop = lv.Contact(lambda t, q, params: q[0] + params.at, restitution=0.6)
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        lambda t, q, params: (ca.sumsqr(q) - 1) / 2,
        q=2,
        params={"at": 0.2},
        contacts={"stop": stop},
    )


def puck():
    """Return a puck that falls on a slope, stops on a curved way, and is torn off across it."""
    contact = lv.Contact(
        lambda t, q, params: q[2],
        friction=lambda params: params.mu,
        static_friction=lambda params: params.more * params.mu,
        slip=lambda t, q, v, params: [v[0], v[1]],
    )
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 + params.down * q[0] - 9.5 * q[2] + t**2 * q[1],
        q=("x", "y", "z"),
        params={"mu": 0.4, "more": 1.2, "down": 2.4},
        contacts={"slope": contact},
    )


def bowled():
    """Return a ball with spin that hits a lane twice, slides on it and rolls."""
    contact = lv.Contact(
        lambda t, q, params: q[2] - params.r,
        restitution=lambda params: params.e,
        friction=0.2,
        slip=lambda t, q, v, params: [v[0] - params.r * v[4], v[1] + params.r * v[3]],
    )
    return lv.Lagrangian(
        lambda t, q, v, params: (
            ca.sumsqr(v[:3]) / 2 + params.r**2 * ca.sumsqr(v[3:]) / 5 - G * q[2]
        ),
        q=6,
        params={"r": 0.11, "e": 0.2},
        contacts={"lane": contact},
    )


BOWLED = {"q": [0.0, 0.0, 0.2, 0.0, 0.0, 0.0], "v": [2.4, 3.2, 0.0, 1.0, -5.0, 1.0]}

CASES = {
    "belt": (belt, {"q": [0.0, 0.0], "v": [0.0, 0.0]}, 12.0, 10),
    "ball": (ball, {"q": [0.0, 0.5, 0.0], "v": [1.5, 0.0, 20.0]}, 1.6, 5),
    "puck": (puck, {"q": [0.0, 0.0, 0.1], "v": [0.5, 2.0, 0.0]}, 2.6, 3),
    "bowled": (bowled, BOWLED, 1.6, 8),
    "stopped": (stopped, {"q": [0.6, -0.8], "v": [0.0, 0.0]}, 3.0, 2),
}
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


def run_of(system, start, until, **more):
    call = {"t": (0, until), "h": 0.02} | more
    return lv.integrate(system, lv.Spark(3), **start, **call)


@pytest.mark.parametrize("name", CASES)
def test_tangents_are_those_of_differences_through_all_changes(name):
    make, start, until, changes = CASES[name]
    system = make()
    defaults = system.params
    directions = {f"params.{x}": 1.0 for x in defaults}
    if name == "ball":
        directions |= {"q": np.eye(3)[:2], "v": np.array([0.3, -0.1, 1.0])}
    run = run_of(system, start, until, tangents=directions)
    plain = run_of(system, start, until)
    assert sum(len(x.changes) for x in run.contacts.values()) >= changes
    assert run.contacts.keys() == plain.contacts.keys()

    def moved(direction, row, size):
        params, own = dict(defaults), {k: np.array(x, dtype=float) for k, x in start.items()}
        if direction.startswith("params."):
            params[direction[7:]] += size
        else:
            own[direction] += size * row
        return run_of(system, own, until, params=params)

    for direction, value in directions.items():
        tangent = run.tangents[direction]
        rows = np.atleast_2d(value)
        for k, row in enumerate(rows):
            parts = [(w, moved(direction, row, x * 1e-4)) for x, w in STENCIL]
            for state in ("q", "v"):
                found = getattr(tangent, state)
                found = found[:, k] if found.ndim == 3 else found
                wanted = sum(w * getattr(x, state)[-1] for w, x in parts) / 1e-4
                scale = max(1.0, np.abs(wanted).max())
                np.testing.assert_allclose(found[-1], wanted, atol=1e-7 * scale)


def test_tangents_at_given_times_and_of_few_records():
    make, start, until, _ = CASES["ball"]
    whole = run_of(make(), start, until, tangents={"params.g": 1.0})
    times = [0.2, 0.9, until]
    given = run_of(make(), start, until, tangents={"params.g": 1.0}, t_eval=times)
    few = run_of(make(), start, until, tangents={"params.g": 1.0}, every=7)
    assert given.tangents["params.g"].q.shape == (3, 3)
    np.testing.assert_allclose(
        given.tangents["params.g"].q[-1], whole.tangents["params.g"].q[-1], rtol=1e-12
    )
    assert few.tangents["params.g"].q.shape == few.q.shape
    kept = np.isin(whole.t, few.t)
    np.testing.assert_allclose(few.tangents["params.g"].v, whole.tangents["params.g"].v[kept])


def test_a_stop_in_space_forgets_the_speed_and_what_is_across():
    """A block that stops at v |v| / (2 mu g): dq = (v dv . v / |v| + |v| dv) / (2 mu g)."""
    floor = lv.Contact(
        lambda t, q, params: q[2], friction=0.3, slip=lambda t, q, v, params: [v[0], v[1]]
    )
    block = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[2], q=3, contacts={"floor": floor}
    )
    start = {"q": [0.0, 0.0, 0.0], "v": [1.5, 2.0, 0.0]}
    run = run_of(block, start, 2.0, h=0.1, tangents={"v": np.eye(3)[:2]})
    v = np.array([1.5, 2.0])
    wanted = (np.outer(v, v) / 2.5 + 2.5 * np.eye(2)) / (0.6 * G)
    np.testing.assert_allclose(run.tangents["v"].q[-1, :, :2], wanted, atol=1e-8)
    np.testing.assert_allclose(run.tangents["v"].v[-1], 0, atol=1e-14)


def test_two_stops_in_space_at_one_time_have_no_derivative():
    pair = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        q=4,
        contacts={
            f"pad {k}": lv.Contact(
                load=1.0, friction=0.5, slip=lambda t, q, v, params, k=k: [v[k], v[k + 1]]
            )
            for k in (0, 2)
        },
    )
    start = {"q": [0.0] * 4, "v": [0.6, 0.8, 0.8, 0.6]}
    with pytest.raises(lv.IntegrationError, match="'pad 0' and 'pad 2' come to rest at one time"):
        run_of(pair, start, 3.0, h=0.1, tangents={"v": [1.0, 0, 0, 0]})


def test_where_there_is_no_derivative_the_run_ends_by_name():
    corner = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        q=2,
        contacts={
            name: lv.Contact(lambda t, q, params, k=k: q[k], restitution=0.5)
            for k, name in enumerate("xy")
        },
    )
    start = {"q": [0.3, 0.3], "v": [-1.0, -1.0]}
    with pytest.raises(lv.IntegrationError, match=r"'x: hit' and 'y: hit' are at one time"):
        run_of(corner, start, 1.0, tangents={"q": [1.0, 0.0]})
    make, start, until, _ = CASES["ball"]
    for wrong, words in (
        ({"tangents": {"t0": 1.0}}, "go without directions 't0' and 't1'"),
        ({"tangents": {"q": np.eye(3)}, "h": None, "rtol": 1e-6}, "want equal steps"),
    ):
        with pytest.raises(TypeError, match=words):
            run_of(make(), start, until, **wrong)
    with pytest.raises(ValueError, match="leave out states=False"):
        run_of(make(), start, until, tangents={"q": np.eye(3)}, states=False)
    graze = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
        q=1,
        contacts={"floor": lv.Contact(lambda t, q, params: q[0] + 1 - 1e-15, restitution=0.5)},
    )
    with pytest.raises(lv.IntegrationError, match=r"contact 'floor' is grazed at t = 3\.14"):
        run_of(graze, {"q": [1.0], "v": [0.0]}, 5.0, h=0.1, tangents={"q": [1.0]})
