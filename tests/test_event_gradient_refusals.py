"""Where events have no derivatives, and which cotangents runs with events take."""

import casadi as ca
import numpy as np
import pytest
from event_cases import ball

import liouville as lv


def test_what_has_no_derivative_is_refused():
    free, *_ = ball()
    fall = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=1,
                         params={"g": 9.81})  # fmt: skip
    ground = {"ground": lv.Event(lambda t, q, v, lam, params: q[0], "down",
                                 reset=lambda t, q, v, lam, params: -v / 2)}  # fmt: skip
    drop = {"t": (0.0, 10.0), "steps": 1000, "events": ground, "q": [1.0], "v": [0.0]}
    accumulate = (
        r"hits of 'ground' accumulate at t = 1.35457, and so near.*\nhint: end the run before"
    )
    with pytest.raises(lv.IntegrationError, match=accumulate):
        lv.integrate(fall, lv.Spark(2), tangents={"params.g": 1.0}, **drop)
    heights = {"q": [[100.0], [1.0]], "v": [0.0]}
    both = lv.ensemble(fall, lv.Spark(2), tangents={"params.g": 1.0}, **(drop | heights))
    assert [*both.failures] == [1]
    assert "hits of 'ground' accumulate at t = 1.35457" in both.failures[1].message
    solution, pullback = lv.vjp(fall, lv.Spark(2), wrt=["v"], **drop)
    assert "accumulate at t = 1.35457" in solution.message
    with pytest.raises(lv.IntegrationError, match=accumulate):
        pullback(q=np.ones_like(solution.q))
    up = {"q": np.array([0.0, 1.0]), "v": np.array([0.0, 2.0])}
    flat, jump = "'top' has no slope along the motion at", "'top' jumps at"
    functions = (
        (lambda t, q, v, lam, params: ca.sign(q[1] - 1.5), jump),
        (lambda t, q, v, lam, params: ca.if_else(q[1] > 1.5, params.g, -1), jump),
        (lambda t, q, v, lam, params: ca.floor(2 * t) - 0.5, jump),
        (lambda t, q, v, lam, params: (t - 0.5) ** 3, flat),
        (touch := lambda t, q, v, lam, params: (q[1] - 1.5) ** 3, flat),
    )
    for function, sentence in functions:
        call = {"t": (0, 1.9), "steps": 7, "events": {"top": function}, **up}
        with pytest.raises(lv.IntegrationError, match=sentence):
            lv.integrate(free, lv.Spark(2), tangents={"params.g": 1.0}, **call)
        solution, pullback = lv.vjp(free, lv.Spark(2), wrt=["params.g"], **call)
        with pytest.raises(lv.IntegrationError, match=sentence):
            pullback(q=np.ones_like(solution.q))
    two = up | {"v": np.array([[0.0, 2.0], [0.0, 0.5]])}
    many = lv.ensemble(free, lv.Spark(2), t=(0, 1.9), steps=7, events={"top": touch},
                       tangents={"params.g": 1.0}, **two)  # fmt: skip
    assert [*many.failures] == [0]
    assert flat in many.failures[0].message
    assert np.isfinite(many.tangents["params.g"].q[:, 1]).all()


TOP = 2 - np.sqrt(3)  # when a ball that is thrown up is at a height of 1.5
SEEN = {
    "two slopes": (lambda t, q, v: ca.if_else(q[1] > 1.5, v[1], -1 - t), "jumps"),
    "a step": (lambda t, q, v: q[1] - 1.5 + ca.sign(q[1] - 1.5) / 1000, "jumps"),
    "two surfaces": (lambda t, q, v: q[1] - 1.5 + ca.fabs(t - TOP) / 3, "bends"),
    "a small bend": (lambda t, q, v: q[1] - 1.5 + 1e-4 * ca.fmax(t - TOP, 0), "bends"),
}


@pytest.mark.parametrize("name", SEEN)
@pytest.mark.parametrize("method", [lv.Spark(2), lv.HHT(), lv.LobattoPair(3)], ids=str)
def test_jumps_and_bends_are_refused_where_they_are(method, name):
    """With a sentence, wherever derivatives are asked for; other runs go on."""
    system, _, _, directions = ball()
    function, what = SEEN[name]
    up = {"q": np.array([0.0, 1.0]), "v": np.array([0.0, 2.0])}
    events = {"top": lv.Event(lambda t, q, v, lam, params: function(t, q, v), terminal=True)}
    run = {"t": (0, 1.9), "events": events}
    sentence = rf"'top' {what} at t = 0\.267949, .*\nhint: write "
    for steps in ({"steps": 7}, {"rtol": 1e-8}):
        if isinstance(method, lv.LobattoPair) and "rtol" in steps:
            continue
        with pytest.raises(lv.IntegrationError, match=sentence):
            lv.integrate(system, method, tangents=directions, **run, **steps, **up)
        solution, pullback = lv.vjp(system, method, wrt=["q"], **run, **steps, **up)
        assert solution.events["top"].t == pytest.approx(TOP, abs=1e-6)
        with pytest.raises(lv.IntegrationError, match=sentence):
            pullback(events={"top": {"t": [1.0]}})
    many = {"v": np.array([[0.0, 2.0], [0.0, 0.5]]), "q": up["q"]}
    found = lv.ensemble(system, method, steps=7, tangents=directions, **run, **many)
    assert [*found.failures] == [0]
    assert f"'top' {what} at t = 0.267949" in found.failures[0].message


def test_a_jump_of_the_multipliers_is_none_of_the_time():
    """The force jumps, and with it a function of the multiplier that is smooth."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[1],
        lambda t, q, params: ca.dot(q, q) - params.l**2,
        force=lambda t, q, v, params: ca.vertcat(0, ca.if_else(t > 0.45, -1, 0)),
        q=2, params={"l": 1.0},
    )  # fmt: skip
    run = {"t": (0, 0.8), "steps": 8, "q": [0.0, -1.0], "v": [0.1, 0.0]}
    pull = {"pull": lambda t, q, v, lam, params: lam[0] - 0.76}
    assert len(lv.integrate(system, lv.Spark(2), events=pull, **run).events["pull"]) == 1
    with pytest.raises(lv.IntegrationError, match=r"'pull' jumps at t = 0\.45,"):
        lv.integrate(system, lv.Spark(2), events=pull, tangents={"params.l": 1.0}, **run)


@pytest.mark.parametrize("method", [lv.Spark(2), lv.HHT()], ids=str)
def test_a_function_that_bends_where_its_zeros_are_the_same_has_a_derivative(method):
    """Whatever its slopes are, one surface has one time."""
    system, _, _, directions = ball()
    up = {"q": np.array([0.0, 1.0]), "v": np.array([0.0, 2.0])}
    functions = {
        "smooth": lambda t, q, v, lam, params: q[1] - params.e,
        "bent": lambda t, q, v, lam, params: (q[1] - params.e) * ca.if_else(q[1] > params.e, 9, 1),
        "steep": lambda t, q, v, lam, params: ca.tanh(1e6 * (q[1] - params.e)),
        "elsewhere": lambda t, q, v, lam, params: q[1] - params.e + ca.fmax(t - 0.05, 0) ** 2 * 0,
    }
    run = {"t": (0, 1.9), "steps": 7, "params": {"e": 1.5}, "events": functions, **up}
    tangents = lv.integrate(system, method, tangents=directions, **run).tangents
    for x, tangent in tangents.items():
        for event in functions:
            own, wanted = tangent.events[event].t, tangent.events["smooth"].t
            np.testing.assert_allclose(own, wanted, rtol=1e-9, atol=1e-12, err_msg=f"{x} {event}")


@pytest.mark.parametrize("method", [lv.Spark(2), lv.HHT(), lv.Spark(4)], ids=str)
@pytest.mark.parametrize(
    "kept",
    [{}, {"every": 2}, {"t_eval": np.linspace(0, 1.4, 29)}],
    ids=["steps", "every", "t_eval"],
)
def test_cotangents_before_hits_accumulate(method, kept):
    """They are those of a run that ends before, to the bit."""
    fall = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - 9.81 * q[0], q=1,
                         params={"e": 0.5})  # fmt: skip
    loss = lv.Impact(lambda t, q, v, lam, params: params.e)

    def ground(hits):
        return {
            "ground": lv.Event(lambda t, q, v, lam, params: q[0], "down", terminal=hits, reset=loss)
        }

    run = {"wrt": ["q", "params.e"], "t": (0, 6), "steps": 60, **kept}
    one = {"q": [1.0], "v": [0.0]}
    solution, pullback = lv.vjp(fall, method, **run, events=ground(False), **one)
    assert "accumulate at t = 1.35457" in solution.message
    short, before = lv.vjp(fall, method, **run, events=ground(2), **one)  # at t = 0.903
    for count, hits in ((0, 0), (1, 0), (len(short.t) - 1, 0), (3, 1), (len(short.t) - 1, 2)):
        cotangents, times = np.zeros_like(solution.q), np.zeros(len(solution.events["ground"]))
        cotangents[:count], times[:hits] = 1.0, 1.0
        found = pullback(q=cotangents, events={"ground": {"t": times}})
        wanted = before(q=cotangents[: len(short.t)], events={"ground": {"t": times[:2]}})
        assert found == wanted
    if "t_eval" in kept:
        return
    rows = {"q": [[1.0], [100.0]], "v": [0.0]}
    both, pulled = lv.vjp(fall, method, **run, events=ground(False), **rows)
    cotangents = np.zeros_like(both.q)
    cotangents[2, 0], cotangents[-1, 1] = 1.0, 1.0
    found = pulled(q=cotangents)["q"][:, 0]
    alone = lv.vjp(fall, method, **run, events=ground(False), q=[100.0], v=[0.0])[1]
    np.testing.assert_array_equal(found, [1.0, alone(q=cotangents[:, 1])["q"][0]])


@pytest.mark.parametrize("times", [[0.1, 0.2, 0.9], [0.8, 0.9]], ids=str)
def test_given_times_behind_the_end_of_a_run_have_no_cotangents(times):
    fall = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=1,
                         params={"g": 9.81})  # fmt: skip
    ground = lv.Event(lambda t, q, v, lam, params: q[0], "down", terminal=True)
    run = {"t": (0, 1), "steps": 10, "t_eval": times, "events": {"ground": ground}}
    solution, pullback = lv.vjp(fall, lv.Spark(4), wrt=["q"], **run, q=[1.0], v=[0.0])
    hit = pullback(events={"ground": {"t": [1.0]}})["q"]
    np.testing.assert_allclose(hit, solution.events["ground"].t / 2, rtol=1e-12)
    np.testing.assert_allclose(pullback(q=np.ones_like(solution.q))["q"], len(solution.t))


def test_cotangents_of_events_have_their_names_and_shapes():
    system, events, start, _ = ball()
    run = {"wrt": ["params.g"], "t": (0, 2.2), "steps": 9, "events": events}
    solution, pullback = lv.vjp(system, lv.Spark(2), **run, **start)
    hits = len(solution.events["ground"])
    with pytest.raises(TypeError, match=r"no cotangent of 'events\.wall\.t'"):
        pullback(events={"wall": {"t": [1.0]}})
    with pytest.raises(ValueError, match=rf"must have shape \({hits},\), not \({hits + 1},\)"):
        pullback(events={"ground": {"t": np.ones(hits + 1)}})
    with pytest.raises(TypeError, match="are mappings of their states"):
        pullback(events=[1.0])


def test_hits_that_accumulate_on_a_curved_moving_floor_are_named_as_what_they_are():
    """Beside one of them lie others, and what is seen there is no kink of the floor."""
    ball = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2 - p.g * q[1], q=("x", "y"), params={"g": 9.81}
    )
    floor = lv.Event(
        lambda t, q, v, lam, p: q[1] - 0.1 * ca.sin(4 * t) - 0.1 * ca.sin(2 * q[0]), "down",
        reset=lv.Impact(lambda t, q, v, lam, p: 0.8 * ca.exp(-0.1 * ca.dot(v, v))),
    )  # fmt: skip
    run = {"t": (0.1, 1.3), "steps": 34, "events": {"floor": floor}, "q": [0, 1], "v": [1, 0.2]}
    plain = lv.integrate(ball, lv.Spark(2), **run)
    assert "the hits of 'floor' accumulate at t = " in plain.message
    with pytest.raises(lv.IntegrationError, match="the hits of 'floor' accumulate at t = "):
        lv.integrate(ball, lv.Spark(2), tangents={"params.g": 1.0}, **run)
