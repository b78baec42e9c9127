"""Plain models in other units and at other times, given as users give numbers, by every method.

Each motion is a polynomial of degree two in time, which all methods have exactly: masses of 1e-6
and 1e6, lengths of 1e-9 and 1e9, whole turns, runs from t = 1e6 and backwards, steps that do not
divide the run.
"""

import casadi as ca
import numpy as np
import pytest
from test_plain_models import ALL, SYMMETRIC, G, half, is_deserved, model, weighs

import liouville as lv

TWO = (0, 2)
NANO, GIGA = 1e-9, 1e9


def rolls(t, q):
    return q[0] - q[1]


def rod(length):
    return lambda t, q: (ca.sumsqr(q) - length**2) / 2


def scaled(mass):
    return model(
        lambda q, g: mass * g * q[0], None, [0], end=falls, kinetic=lambda v: mass * half(v)
    )


def falls(g):
    return [-2 * g]


def drives(g):
    return [2, -2 * g]


#: The model, and from when to when it runs.
PAGE = {
    "a mass of 1e-6 falls": (scaled(1e-6), TWO),
    "a mass of 1e6 falls": (scaled(1e6), TWO),
    "masses of 1e-6 and 1e6 on a rope": (
        model(
            lambda q, g: g * (1e-6 * q[0] + 1e6 * q[1]),
            lambda t, q: q[0] + q[1],
            [0, 0],
            end=lambda g: 2 * g * (1e6 - 1e-6) / (1e6 + 1e-6) * np.array([1, -1]),
            kinetic=lambda v: (1e-6 * v[0] ** 2 + 1e6 * v[1] ** 2) / 2,
        ),
        TWO,
    ),
    "a block of nanometres slides": (
        model(
            lambda q, g: NANO * g * q[1],
            lambda t, q: q[1] - NANO,
            [NANO, NANO],
            [NANO, 0],
            lambda g: [3 * NANO, NANO],
        ),
        TWO,
    ),
    "a pendulum of a nanometre hangs": (model(weighs(1), rod(NANO), [0, -NANO]), (0, 1e-4)),
    "a pendulum of a million kilometres hangs": (
        model(weighs(1), rod(GIGA), [0, -GIGA]),
        (0, 1e5),
    ),
    "an angle of pi stands": (model(lambda q, g: -g * ca.cos(q[0]), None, [np.pi]), (0, 0.5)),
    "an angle of -2 pi hangs": (model(lambda q, g: -g * ca.cos(q[0]), None, [-2 * np.pi]), TWO),
    "an angle goes on over a turn": (
        model(
            lambda q, g: -g * q[0],
            None,
            [np.pi / 2],
            [np.pi],
            lambda g: [np.pi / 2 + 2 * np.pi + 2 * g],
        ),
        TWO,
    ),
    "backwards to 0": (model(weighs(0), None, [0], end=falls), (2, 0)),
    "backwards from 0": (
        model(weighs(1), lambda t, q: q[0] - t, [0, 0], [1, 0], lambda g: [-2, -2 * g]),
        (0, -2),
    ),
    "from t = 10": (
        model(weighs(1), lambda t, q: q[0] - t + 10, [0, 0], [1, 0], drives),
        (10, 12),
    ),
    "from t = 1e6": (
        model(weighs(1), lambda t, q: q[0] - t, [1e6, 0], [1, 0], lambda g: [1e6 + 2, -2 * g]),
        (1e6, 1e6 + 2),
    ),
    "through t = 0": (
        model(weighs(1), lambda t, q: q[0] - t**2, [1, 0], [-2, 0], lambda g: [1, -2 * g]),
        (-1, 1),
    ),
    "a nanosecond": (
        model(weighs(0), None, [0], [1], lambda g: [NANO - NANO**2 / 2 * g]),
        (0, NANO),
    ),
    "a constraint in units of 1e-6": (
        model(weighs(1), lambda t, q: 1e6 * rod(1)(t, q), [0, -1]),
        TWO,
    ),
    "a constraint in units of 1e6": (
        model(weighs(1), lambda t, q: 1e-6 * rod(1)(t, q), [0, -1]),
        TWO,
    ),
    "a force of zero": (
        model(weighs(0), None, [0], end=falls, force=lambda t, q, v, p: [0]),
        TWO,
    ),
    "a force, no potential": (
        model(lambda q, g: 0, None, [0], end=falls, force=lambda t, q, v, p: [-p.g]),
        TWO,
    ),
    "one falls beside one that rests": (
        model(lambda q, g: g * q[0] + 50 * q[1] ** 2, None, [0, 0], end=lambda g: [-2 * g, 0]),
        TWO,
    ),
    "a wheel rolls": (
        model(
            lambda q, g: -g * q[0],
            rolls,
            [0, 0],
            [1, 1],
            lambda g: (2 + 4 * g / 3) * np.ones(2),
            kinetic=lambda v: v[0] ** 2 / 2 + v[1] ** 2 / 4,
        ),
        TWO,
    ),
    "two pins of millimetres": (
        model(weighs(1), lambda t, q: [q[0] - 1e-3, q[1] + 1e-3], [1e-3, -1e-3]),
        TWO,
    ),
    "falls from afar": (model(weighs(0), None, [1e8], end=lambda g: [1e8 - 2 * g]), TWO),
}


def forms(start):
    """Return a start as NumPy scalars, and as float32 and whole numbers if they hold it."""
    yield {k: [np.float64(x) for x in values] for k, values in start.items()}
    for kind in (np.float32, int):
        if all(np.array_equal(values.astype(kind), values) for values in start.values()):
            yield {k: values.astype(kind) for k, values in start.items()}


def ways(method, span):
    """Return the arguments of all kinds of runs."""
    yield {"h": 0.3 * abs(span)}
    yield {"rtol": 1e-6}
    yield {"steps": 8}
    if method in SYMMETRIC:
        yield {"h": abs(span) / 8, "control": lv.Reversible()}


@pytest.mark.parametrize("name", PAGE)
def test_a_model_in_other_units_moves_as_its_closed_form(name):
    of, t = PAGE[name]
    span, wrong = t[1] - t[0], []
    end, other = (np.asarray(of.end(g), float) for g in (G, G + 1))
    size = max(np.abs(end).max(), np.abs(of.start["q"]).max())
    for method in ALL:
        for steps in ways(method, span):
            call = {"t": t, "tangents": {"params.g": 1.0}, **steps}
            run = lv.integrate(of.system, method, **of.start, **call)
            off = np.abs(run.q[-1] - end).max() / size
            tangent = run.tangents["params.g"].q[-1]
            off_tangent = np.abs(tangent - (other - end)).max() / max(size, np.abs(other).max())
            words = [x for x in run.message.split("; ") if x and not is_deserved(x)]
            if not max(off, off_tangent) < 1e-9 or words or run.t[-1] != t[1]:
                wrong.append(f"{method} by {steps}: {off:.1e}, {off_tangent:.1e}, {words}")
        plain = lv.integrate(of.system, method, t=t, steps=8, **of.start).q
        for start in forms(of.start):
            given = lv.integrate(of.system, method, t=[np.float64(x) for x in t], steps=8, **start)
            assert given.q.tobytes() == plain.tobytes()
    assert not wrong, "\n".join(wrong)
