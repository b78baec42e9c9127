"""Where events have no derivatives, and which cotangents runs with events take."""

import casadi as ca
import numpy as np
import pytest
from event_cases import ball, pendulum

import liouville as lv


def test_what_has_no_derivative_is_refused():
    system, start, _ = pendulum()
    call = {"system": system, "method": lv.Spark(2), "t": (0.1, 3), "steps": 60, **start,
            "tangents": {"params.l": 1.0}}  # fmt: skip
    beside = lv.Event(lambda t, q, v, lam, params: q[0] + 0.3,
                      reset=lambda t, q, v, lam, params: {"q": 1.001 * q, "v": -v})  # fmt: skip
    with pytest.raises(lv.IntegrationError, match="leads beside the constraints"):
        lv.integrate(**call, events={"wall": beside})
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
    with pytest.raises(ValueError, match=rf"has shape \({hits + 1},\), wanted \({hits},\)"):
        pullback(events={"ground": {"t": np.ones(hits + 1)}})
    with pytest.raises(TypeError, match="are mappings of their states"):
        pullback(events=[1.0])
