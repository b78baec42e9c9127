"""Contacts: events with resets on which a motion begins, rests or is thrown by another."""

import casadi as ca
import numpy as np
import pytest
from test_resets import CONTROLS, drop, ground, height

import liouville as lv


@pytest.mark.parametrize("kind", ["equal", "rattle", "controlled", "alpha"])
def test_balls_that_touch_pass_a_blow_on(kind):
    """Newton's cradle, in contact to roundoff: the last ball leaves with the speed of the first."""
    method, more = CONTROLS[kind]
    row = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2, q=5)
    gap = lambda k: lambda t, q, v, lam, params: q[k + 1] - q[k] - 1  # noqa: E731
    contacts = {f"{k}": lv.Event(gap(k), "down", reset=lv.Impact(1.0)) for k in range(4)}
    start = {"q": np.array([-2.0, 0, 1, 2, 3]) + 0.3, "v": [1.0, 0, 0, 0, 0]}
    run = lv.integrate(row, method, t=(0, 2), events=contacts, **start, **({"h": 0.1} | more))
    np.testing.assert_allclose(run.v[-1], [0, 0, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(run.q[-1] - 0.3, [-1, 0, 1, 2, 4], atol=1e-12)
    assert [len(run.events[name]) for name in contacts] == [1, 1, 1, 1]


def test_starts_on_the_ground():
    """A ball thrown at it bounces, one laid on it stays, one lifted from it has met nothing."""

    def moved(v, events):
        return drop(lv.Spark(2), (0, 0.5), events, q=[0.0], v=[v])

    np.testing.assert_allclose(moved(-1.0, ground(0.8)).q[-1], 0.4 - 0.125, atol=1e-13)
    assert "accumulate at t = 0" in moved(0.0, ground(0.8)).message
    assert len(moved(1.0, ground(0.8)).events["ground"]) == 0
    slower = {"ground": lv.Event(height, "down", reset=lambda t, q, v, lam, params: v / 2)}
    np.testing.assert_allclose(moved(-1.0, slower).v[-1], -1.5, atol=1e-12)
