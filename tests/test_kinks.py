"""Where functions by cases leave a run without a derivative, and where they do not."""

import pickle
from functools import partial

import casadi as ca
import numpy as np
import pytest
import sympy

import liouville as lv
from liouville._systems.mechanics.branches import branches

BOTH = ["tangents", "pullback"]


def oscillator(force=None, potential=lambda q, p: p.k * q[0] ** 2 / 2, **more):
    """Return a mass on a spring with another force."""
    forces = {} if force is None else {"force": lambda t, q, v, p: force(t, q[0], v[0], p)}
    return lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - potential(q, p), q=1, params={"k": 1.0, "c": 0.2},
        **forces, **more,
    )  # fmt: skip


def differentiate(which, system, method, wrt, **run):
    """Return the derivative of the last position by each name."""
    run = {"q": [1.0], "v": [0.1]} | run
    if which == "tangents":
        sizes = {name: 1.0 if "." in name or name in ("t0", "t1") else [1.0] for name in wrt}
        found = lv.integrate(system, method, tangents=sizes, **run).tangents
        return {name: float(found[name].q[-1, 0]) for name in wrt}
    solution, pullback = lv.vjp(system, method, wrt=wrt, **run)
    cotangent = np.zeros_like(solution.q)
    cotangent[-1] = 1
    return {name: float(np.squeeze(x)) for name, x in pullback(q=cotangent).items()}


SMOOTH = {
    "drag through zero": (lambda t, q, v, p: -p.c * ca.fabs(v) * v, {}),
    "drag from rest": (lambda t, q, v, p: -p.c * ca.fabs(v) * v, {"v": [0.0]}),
    "a cubic of two cases": (lambda t, q, v, p: ca.if_else(q > 0.5, -p.c * (q - 0.5) ** 3, 0), {}),
    "a stop": (lambda t, q, v, p: p.c * ca.fmax(0, 0.3 - q) ** 2, {}),
    "nested": (lambda t, q, v, p: -p.c * ca.fabs(ca.fabs(v)) * ca.fmin(v, 9), {"v": [0.0]}),
    "a period": (lambda t, q, v, p: p.c * ca.sin(2 * np.pi * ca.fmod(q + 7, 1)), {"q": [0.97]}),
    "an angle": (lambda t, q, v, p: p.c * ca.sin(ca.atan2(v - 0.05, q - 0.5)), {}),
    "a quotient": (lambda t, q, v, p: p.c * ca.if_else(q == 0, 1, ca.sin(q) / q), {}),
    "a push until a time": (lambda t, q, v, p: ca.if_else(t < 1.3, p.c, -p.c) * (1 + q), {}),
    "one that ends with a step": (lambda t, q, v, p: ca.if_else(t < 1.5, p.c, -p.c * q), {}),
    "a bend": (lambda t, q, v, p: -p.c * ca.fabs(v), {}),
    "a jump not met": (lambda t, q, v, p: p.c * ca.sign(q + 3), {}),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_what_is_smooth_along_the_motion_has_derivatives(name):
    """Also where a step crosses a kink, or begins at one that both sides leave alike."""
    force, start = SMOOTH[name]
    run = {"t": (0, 4), "steps": 40, "q": [1.0], "v": [0.1]} | start
    system = oscillator(force)
    assert branches(system) is not None
    wrt = ["q", "v", "params.k", "params.c"]
    each = [differentiate(which, system, lv.Spark(2), wrt, **run) for which in BOTH]
    assert each[0] == pytest.approx(each[1], rel=1e-11, abs=1e-12)
    found = lv.analysis.check_gradient(system, lv.Spark(2), wrt=wrt, size=1e-5, **run)
    assert found.differences < 1e-8


def test_a_potential_that_bends_away_from_its_kink():
    """An oscillator in |q| falls as a stone does: q = 1 + v t - k t^2 / 2."""
    system = oscillator(potential=lambda q, p: p.k * ca.fabs(q[0]))
    for which in BOTH:
        by = differentiate(which, system, lv.Spark(2), ["params.k", "v"], t=(0, 1), steps=7)
        assert by == pytest.approx({"params.k": -0.5, "v": 1.0}, abs=1e-14)


AT = {
    "sign": (lambda t, q, v, p: -p.c * ca.sign(v), {"v": [0.0]}, r"sign\(v\[0\]\)"),
    "fabs": (lambda t, q, v, p: -p.c * ca.fabs(v), {"v": [0.0]}, r"fabs\(v\[0\]\)"),
    "roundoff": (lambda t, q, v, p: -p.c * ca.fabs(v), {"v": [1e-17]}, r"fabs\(v\[0\]\)"),
    "fmax": (lambda t, q, v, p: ca.fmax(p.c, q), {"q": [0.2]}, r"fmax\(params.c, q\[0\]\)"),
    "if_else": (lambda t, q, v, p: ca.if_else(q < 0.3, 0.3 - q, 0), {"q": [0.3]}, r"q\[0\] < 0.3"),
    "floor": (lambda t, q, v, p: p.c * ca.floor(3 * q), {}, r"floor\(3\*q\[0\]\)"),
    "potential": (None, {"q": [0.0]}, r"sign\(q\[0\]\)"),
}


@pytest.mark.parametrize("which", BOTH)
@pytest.mark.parametrize("name", AT)
def test_a_start_at_a_kink_is_refused(name, which):
    force, start, text = AT[name]
    bent = {"potential": lambda q, p: p.k * ca.fabs(q[0])} if force is None else {}
    sentence = rf"the start at t = 0 has no derivative: .* kink of '{text}'.*\nhint: start beside"
    with pytest.raises(lv.IntegrationError, match=sentence) as caught:
        differentiate(
            which, oscillator(force, **bent), lv.Spark(2), ["q", "v"], t=(0, 1), steps=9, **start
        )
    assert (caught.value.step, caught.value.t) == (0, 0.0)


def test_what_does_not_move_the_start_off_a_kink_has_a_derivative():
    """The force of |q| at q = 0 has one by its size, but not by q."""
    system = oscillator(lambda t, q, v, p: p.c * (1 + ca.fabs(q)), lambda q, p: 0)
    run = {"t": (0, 1), "steps": 9, "q": [0.0]}
    for which in BOTH:
        by = differentiate(which, system, lv.Spark(2), ["params.c"], **run)
        assert 0.5 < by["params.c"] < 0.7
        with pytest.raises(lv.IntegrationError, match="the start at t = 0 has no derivative"):
            differentiate(which, system, lv.Spark(2), ["q"], **run)


@pytest.mark.parametrize("which", BOTH)
def test_a_release_from_rest_with_dry_friction_has_a_derivative(which):
    """The block is on one side of the edge at once: x = c/k + (1 - c/k) cos(sqrt(k) t)."""
    system = oscillator(lambda t, q, v, p: -p.c * ca.sign(v))
    run = {"t": (0.0, 2.0), "steps": 20, "q": [1.0], "v": [0.0], "params": {"k": 2.0}}
    by = differentiate(which, system, lv.Spark(5), ["params.c", "params.k", "q", "t0"], **run)
    k, c, w = 2.0, 0.2, np.sqrt(2.0)
    cos, sin = np.cos(2 * w), np.sin(2 * w)
    wanted = {
        "params.c": (1 - cos) / k, "params.k": -c / k**2 * (1 - cos) - (1 - c / k) * sin / w,
        "q": cos, "t0": (1 - c / k) * w * sin,
    }  # fmt: skip
    assert by == pytest.approx(wanted, abs=1e-8)
    with pytest.raises(lv.IntegrationError, match="the start at t = 0 has no derivative"):
        differentiate(which, system, lv.Spark(5), ["v"], **run)
    for method in (lv.LobattoPair(3), lv.HHT()):  # a force at the start itself is on neither side
        with pytest.raises(lv.IntegrationError, match="the equations jump"):
            differentiate(which, system, method, ["params.c"], **run)


JUMPS = {
    "dry friction": (lambda t, q, v, p: -p.c * ca.sign(v), 0.083126, ["q"]),
    "steps of a force": (lambda t, q, v, p: p.c * ca.floor(3 * q), 1.271246, ["v"]),
    "a comparison": (lambda t, q, v, p: ca.if_else(q < 0.5, p.c, 0), 1.146941, ["v", "params.k"]),
    "a time that is a parameter": (lambda t, q, v, p: ca.if_else(t < p.c + 0.01, 1, -1), 0.21,
                                   ["params.c"]),
    "steps that are moved": (lambda t, q, v, p: ca.if_else(t < 0.33, 1, -1), 0.33, ["t1"]),
}  # fmt: skip


@pytest.mark.parametrize("kept", [{}, {"every": 60}, {"t_eval": [0.01, 2.0]}], ids=str)
@pytest.mark.parametrize("which", BOTH)
@pytest.mark.parametrize("name", JUMPS)
def test_a_jump_that_a_step_passes_over_is_refused(name, which, kept):
    """Wherever states are kept; its time is found within the step."""
    force, t, wrt = JUMPS[name]
    start = {"q": [0.98]} if "steps of" in name else {}
    with pytest.raises(
        lv.IntegrationError, match=r"the equations jump with .*\nhint: end"
    ) as found:
        differentiate(
            which, oscillator(force), lv.Spark(2), wrt, t=(0, 2), steps=60, **start, **kept
        )
    assert found.value.step == int(found.value.t * 30)
    assert found.value.t == pytest.approx(t, abs=0.02)
    assert f"step {found.value.step} has no derivative: at t = {found.value.t:.6g} " in str(
        found.value
    )


def fallen(c, v, at, end):
    """Return where a force of -c, and of c beyond the place `at`, brings a mass from one."""
    fast = np.sqrt(v**2 + 2 * c * (1 - at))
    rest = end - (fast + v) / c
    return at - fast * rest + c * rest**2 / 2


@pytest.mark.parametrize("which", BOTH)
def test_steps_that_end_at_a_jump_have_the_derivative_of_the_motion(which):
    """By an event that changes nothing, and stages on one side of it alone."""
    method = lv.Spark(2)
    system = oscillator(lambda t, q, v, p: -p.c * ca.sign(q - p.k), lambda q, p: 0)
    run = {"t": (0, 1.4), "steps": 14, "params": {"c": 0.8, "k": 0.3}, "v": [-0.2]}
    wrt = ["params.c", "params.k", "v"]
    values, size = np.array([0.8, 0.3, -0.2]), 1e-5
    wanted = {}
    for name, move in zip(wrt, np.eye(3) * size, strict=True):
        (c, at, v), (d, to, w) = values + move, values - move
        wanted[name] = (fallen(c, v, at, 1.4) - fallen(d, w, to, 1.4)) / (2 * size)
    same = lv.Event(lambda t, q, v, lam, p: q[0] - p.k, reset=lambda t, q, v, lam, p: v)
    found = differentiate(which, system, method, wrt, events={"side": same}, **run)
    assert found == pytest.approx(wanted, abs=1e-8)
    plain = {"side": lambda t, q, v, lam, p: q[0] - p.k}
    radau = lv.Spark(3, points="radau")
    composed = lv.Composition(lv.Spark(1), "Y4")  # its parts go beyond the end of a step
    refused = [(method, {}), (method, plain), *((x, {"side": same}) for x in (radau, composed))]
    for by, events in refused:
        with pytest.raises(lv.IntegrationError, match="the equations jump with"):
            differentiate(which, system, by, wrt, events=events, **run)


def test_cotangents_before_a_jump_are_pulled_back():
    system = oscillator(lambda t, q, v, p: -p.c * ca.sign(q - 0.3))
    run = {"t": (0, 2), "steps": 40, "q": [1.0], "v": [0.0]}
    solution, pullback = lv.vjp(system, lv.Spark(2), wrt=["q"], **run)
    row = int(np.argmax(solution.q[:, 0] < 0.3))
    cotangents = np.eye(len(solution.t))[:, :, None]
    assert pullback(q=cotangents[row - 1])["q"] == pytest.approx(np.cos(solution.t[row - 1]))
    with pytest.raises(lv.IntegrationError, match=f"step {row - 1} has no derivative"):
        pullback(q=cotangents[row])


@pytest.mark.parametrize("which", BOTH)
def test_members_are_named(which):
    system = oscillator(lambda t, q, v, p: -p.c * ca.sign(q - 0.3))
    run = {"t": (0, 1), "steps": 9, "q": [[5.0], [0.5]], "v": [-0.4]}
    if which == "tangents":
        call = partial(lv.ensemble, system, lv.Spark(2), tangents={"q": [1.0]}, **run)
    else:
        solution, pullback = lv.vjp(system, lv.Spark(2), wrt=["q"], **run)
        call = partial(pullback, q=np.ones_like(solution.q))
    with pytest.raises(lv.IntegrationError, match="member 1: step 3 has no derivative") as caught:
        call()
    assert caught.value.member == 1


@pytest.mark.parametrize("which", BOTH)
def test_a_switch_that_equal_steps_pass_over_is_refused(which):
    """Steps by rtol end there, and have the derivative."""
    system = oscillator(
        lambda t, q, v, p: -p.c * ca.sign(q - p.k),
        lambda q, p: 0,
        switches={"side": lambda t, q, v, p: q[0] - p.k},
    )
    run = {"t": (0, 1.4), "params": {"c": 0.8, "k": 0.3}, "v": [-0.2]}
    size = 1e-5
    ends = [fallen(0.8, -0.2, 0.3 + way * size, 1.4) for way in (1, -1)]
    found = differentiate(which, system, lv.Spark(2), ["params.k"], rtol=1e-9, **run)
    assert found["params.k"] == pytest.approx((ends[0] - ends[1]) / (2 * size), abs=1e-8)
    for method in (lv.Spark(2), lv.HHT()):
        with pytest.raises(lv.IntegrationError, match=r"the equations jump with .*\n.* with rtol="):
            differentiate(which, system, method, ["params.k"], steps=14, **run)


@pytest.mark.parametrize("which", BOTH)
def test_a_semi_explicit_system_with_a_jump(which):
    system = lv.SemiExplicit(
        field=lambda t, y, z, p: [y[2], z[0], -p.c * ca.sign(y[0] - 0.5)],
        constraint=lambda t, y, p: {"same": y[1] - y[0]},
        y=3, z=1, params={"c": 1.0},
    )  # fmt: skip
    run = {"t": (0, 2), "steps": 20, "y": [0.0, 0.0, 1.0]}
    if which == "tangents":
        call = partial(lv.integrate, system, lv.Spark(2), tangents={"params.c": 1.0}, **run)
    else:
        solution, pullback = lv.vjp(system, lv.Spark(2), wrt=["params.c"], **run)
        call = partial(pullback, y=np.ones_like(solution.y))
    with pytest.raises(lv.IntegrationError, match=r"jump with 'sign\(y\[0\]-0.5\)'.*\n.*y unch"):
        call()


def shear(rate, kind="polynomial"):
    """Return x' = rate(t, y), y' = 1, where y comes from -0.513 to 1.487 until t = 2."""
    params = {"c": 1.0, "k": 0.3}  # one takes functions by cases along as they are
    if kind == "polynomial":
        field = lambda t, x, p: [rate(t, x[1], p), 1]  # noqa: E731
        return lv.PolynomialField(field, x=("x", "y"), params=params)
    # the stream function of the rate times y
    stream = lambda t, x, p: rate(t, x[1], p) * x[1] - x[0]  # noqa: E731
    return lv.PotentialField(stream, x=("x", "y"), params=params)


def of_field(which, system, wrt, **run):
    """Return the derivatives of the last x by each name, of a start by y alone."""
    run = {"t": (0, 2), "steps": 50, "x": [0.0, -0.513]} | run
    if which == "tangents":
        sizes = {name: [0.0, 1.0] if name == "x" else 1.0 for name in wrt}
        found = lv.integrate(system, lv.VolumeSplitting(), tangents=sizes, **run).tangents
        return {name: float(found[name].x[-1, 0]) for name in wrt}
    solution, pullback = lv.vjp(system, lv.VolumeSplitting(), wrt=wrt, **run)
    cotangent = np.zeros_like(solution.x)
    cotangent[-1, 0] = 1
    return {name: float(np.ravel(x)[-1]) for name, x in pullback(x=cotangent).items()}


def between(whole):
    """Return x at a time from the integral of the rate over y."""
    return lambda y, c, t: c * (whole(y + t) - whole(y))


#: Rates, and x by the start of y, by c and by the end.
SMOOTH_RATES = {
    "two parabolas": (lambda t, y, p: p.c * (ca.fabs(y) * y), between(lambda y: abs(y) ** 3 / 3)),
    "a bend": (lambda t, y, p: p.c * ca.fabs(y), between(lambda y: abs(y) * y / 2)),
    "a stop": (lambda t, y, p: p.c * ca.fmax(0, y) ** 2, between(lambda y: max(0, y) ** 3 / 3)),
    "a period": (
        lambda t, y, p: p.c * ca.cos(2 * np.pi * ca.fmod(y + 7, 1)),
        between(lambda y: np.sin(2 * np.pi * y) / (2 * np.pi)),
    ),
    "a jump at a time": (
        lambda t, y, p: p.c * ca.if_else(t < 0.73, 1, -1) * y,
        lambda y, c, t: c * ((y + 0.73) ** 2 - y**2 / 2 - (y + t) ** 2 / 2),
    ),
}


@pytest.mark.parametrize("which", BOTH)
@pytest.mark.parametrize("name", SMOOTH_RATES)
def test_fields_that_stay_continuous_have_derivatives(name, which):
    rate, exact = SMOOTH_RATES[name]
    system, at, size = shear(rate), np.array([-0.513, 1.0, 2.0]), 1e-6
    assert branches(system) is not None
    moves = np.eye(3) * size
    wanted = [(exact(*(at + x)) - exact(*(at - x))) / (2 * size) for x in moves]
    by = dict(zip(["x", "params.c", "t1"], wanted, strict=True))
    if name == "a jump at a time":
        del by["t1"]
        with pytest.raises(lv.IntegrationError, match=r"the equations jump with 't < 0\.73'"):
            of_field(which, system, ["t1"])
    assert of_field(which, system, [*by], steps=200) == pytest.approx(by, abs=1e-2)


RATES = {
    "sign": (lambda t, y, p: p.c * ca.sign(y), 0.513, "x"),
    "floor": (lambda t, y, p: p.c * ca.floor(2 * y), 0.013, "x"),
    "a place": (lambda t, y, p: p.c * ca.if_else(y < p.k, 1, 0), 0.813, "params.k"),
    "a time": (lambda t, y, p: p.c * ca.if_else(t < p.k, 1, 0) * y, 0.3, "params.k"),
    "steps that are moved": (lambda t, y, p: p.c * ca.if_else(t < 0.33, 1, 0) * y, 0.33, "t1"),
}


@pytest.mark.parametrize("kept", [{}, {"every": 50}, {"steps": None, "rtol": 1e-3}], ids=str)
@pytest.mark.parametrize("which", BOTH)
@pytest.mark.parametrize("name", RATES)
def test_fields_that_jump_within_a_step_are_refused(name, which, kept):
    """In whose derivative the jump is 0, as of every step."""
    rate, t, by = RATES[name]
    for kind in ("polynomial", "potential"):
        if kind == "potential" and ("rtol" in kept or name in ("sign", "floor")):
            continue
        with pytest.raises(
            lv.IntegrationError, match=r"the equations jump with .*\nhint: write a smooth"
        ) as found:
            of_field(which, shear(rate, kind), [by], **kept)
        assert found.value.t == pytest.approx(t, abs=0.02)
        if "rtol" not in kept:
            assert found.value.step == int(found.value.t * 25 + 1e-9)
        assert f"step {found.value.step} has no derivative" in str(found.value)
    assert np.isfinite(of_field(which, shear(rate), ["params.c"], **kept)["params.c"])


@pytest.mark.parametrize("which", BOTH)
def test_fields_that_begin_at_a_kink(which):
    start = {"x": [0.0, 0.0]}
    bent, flat = shear(lambda t, y, p: p.c * ca.fabs(y)), shear(lambda t, y, p: ca.fabs(y) * y)
    with pytest.raises(
        lv.IntegrationError, match=r"the start at t = 0 .* kink of 'fabs\(x\[1\]\)'"
    ):
        of_field(which, bent, ["x"], **start)
    assert of_field(which, bent, ["params.c"], **start)["params.c"] == pytest.approx(2, abs=1e-3)
    assert of_field(which, flat, ["x"], **start)["x"] == pytest.approx(4, abs=2e-3)
    stream = shear(lambda t, y, p: p.c * ca.fabs(y), "potential")  # whose velocity bends
    with pytest.raises(lv.IntegrationError, match="the start at t = 0 has no derivative"):
        of_field(which, stream, ["x"], **start)


@pytest.mark.parametrize("which", BOTH)
def test_one_field_until_a_jump_and_another_from_it_have_its_derivative(which):
    """The force c, and from t = k on -c: the last place is 2 c (2 - k) by k."""
    first, then = (
        lv.PolynomialField(
            lambda t, x, p, way=way: [x[1], way * p.c], x=("x", "y"), params={"c": 0.5}
        )
        for way in (1, -1)
    )
    method, at = lv.VolumeSplitting(), 0.73
    run = {"steps": 20, "x": [0.0, -0.513]}
    one = lv.integrate(first, method, t=(0, at), tangents={"t1": 1.0}, **run)
    run["x"] = one.x[-1]
    if which == "tangents":
        moved = {"t0": 1.0, "x": one.tangents["t1"].x[-1]}
        other = lv.integrate(then, method, t=(at, 2), tangents=moved, **run)
        found = sum(other.tangents[name].x[-1, 0] for name in moved)
    else:
        solution, pullback = lv.vjp(then, method, t=(at, 2), wrt=["t0", "x"], **run)
        cotangent = np.zeros_like(solution.x)
        cotangent[-1, 0] = 1
        by = pullback(x=cotangent)
        found = by["t0"] + by["x"] @ one.tangents["t1"].x[-1]
    assert found == pytest.approx(2 * 0.5 * (2 - at), abs=1e-12)


@pytest.mark.parametrize("params", [None, {"c": [0.5, 0.6]}], ids=["alike", "own"])
@pytest.mark.parametrize("which", BOTH)
def test_members_of_fields_are_named(which, params):
    system = shear(lambda t, y, p: p.c * ca.sign(y))
    run = {"t": (0, 2), "steps": 50, "x": [[0.0, 3.0], [0.0, -0.513]], "params": params}
    if which == "tangents":
        call = partial(lv.ensemble, system, lv.VolumeSplitting(), tangents={"x": [0, 1]}, **run)
    else:
        solution, pullback = lv.vjp(system, lv.VolumeSplitting(), wrt=["x"], **run)
        call = partial(pullback, x=np.ones_like(solution.x))
    with pytest.raises(lv.IntegrationError, match="member 1: step 12 has no derivative") as found:
        call()
    assert (found.value.member, found.value.step) == (1, 12)


def test_cotangents_of_a_field_before_its_jump_are_pulled_back():
    system = shear(lambda t, y, p: p.c * ca.sign(y) + y)
    run = {"t": (0, 2), "steps": 50, "every": 5, "x": [0.0, -0.513]}
    solution, pullback = lv.vjp(system, lv.VolumeSplitting(), wrt=["x"], **run)
    cotangents = np.eye(len(solution.t))[:, :, None] * [1.0, 0.0]
    assert pullback(x=cotangents[2])["x"] == pytest.approx([1, solution.t[2]])
    with pytest.raises(lv.IntegrationError, match="step 12 has no derivative"):
        pullback(x=cotangents[3])


@pytest.mark.parametrize("kind", ["polynomial", "sympy", "potential"])
def test_pickled_fields_are_looked_at(kind):
    """Of one without parameters terms are pickled, and its functions as they stand."""
    if kind == "sympy":
        x, y = sympy.symbols("x y")
        system = lv.PolynomialField.from_sympy([sympy.sign(y) + abs(y), sympy.Integer(1)], [x, y])
    elif kind == "polynomial":
        system = lv.PolynomialField(lambda t, x, p: [ca.sign(x[1]), 1], x=("x", "y"))
    else:
        system = shear(lambda t, y, p: ca.sign(y), "potential")
    for each in (system, pickle.loads(pickle.dumps(system))):
        with pytest.raises(lv.IntegrationError, match=r"jump with 'sign\(x\[1\]\)'"):
            of_field("tangents", each, ["x"])


SWAP = np.array([[0.0, 1.0], [1.0, 0.0]])


def driven(drive, **more):
    """Return H = (1 + f) X, of which psi is exp(-i X F) psi_0 with the integral F."""
    return lv.Schrodinger(SWAP, drive=[(drive, SWAP)], params={"a": 1.5, "at": 0.733}, **more)


def of_wave(which, system, method, by, **run):
    """Return the derivative of the real part of the last psi_0 by a parameter."""
    run = {"t": (0, 2), "psi": [1.0, 0.0]} | run
    if which == "tangents":
        call = lv.ensemble if "params" in run else lv.integrate
        return call(system, method, tangents={by: 1.0}, **run).tangents[by].psi[-1, ..., 0].real
    solution, pullback = lv.vjp(system, method, wrt=[by], **run)
    cotangent = np.zeros_like(solution.psi)
    cotangent[-1, ..., 0] = 1
    return pullback(psi=cotangent)[by]


WAVES = [(lv.Magnus(), {"h": 0.01}), (lv.Chebyshev(), {})]


@pytest.mark.parametrize("method", WAVES, ids=str)
@pytest.mark.parametrize("which", BOTH)
def test_drives_that_jump_at_a_time_that_is_a_parameter_are_refused(which, method):
    """In whose derivative the jump is 0."""
    method, run = method
    for drive in (
        lambda t, p: p.a * ca.if_else(t < p.at, 1, 0),
        lambda t, p: p.a * ca.if_else(ca.fabs(t - p.at) < 0.05, 1, 0),
    ):
        with pytest.raises(lv.IntegrationError, match=r"the equations jump with .*\nhint: write"):
            of_wave(which, driven(drive), method, "params.at", **run)
    held = driven(lambda t, p: p.a * ca.if_else(t < 0.733, 1, 0))
    assert of_wave(which, held, method, "params.at", **run) == 0


@pytest.mark.parametrize("which", BOTH)
def test_drives_that_bend_or_jump_at_times_that_are_held(which):
    run = {"h": 0.01}
    held = driven(lambda t, p: p.a * ca.if_else(t < 0.73, 1, 0))
    bent = driven(lambda t, p: p.a * ca.fabs(t - p.at))
    angles = 2 + 1.5 * 0.73, 2 + 1.5 * (0.733**2 + 1.267**2) / 2
    by_a = of_wave(which, held, lv.Magnus(), "params.a", **run)
    assert by_a == pytest.approx(-0.73 * np.sin(angles[0]), abs=1e-7)
    by_at = of_wave(which, bent, lv.Magnus(), "params.at", **run)
    assert by_at == pytest.approx(1.5 * (2 - 2 * 0.733) * np.sin(angles[1]), abs=1e-3)


@pytest.mark.parametrize("which", BOTH)
def test_members_of_waves_are_named(which):
    system = driven(lambda t, p: p.a * ca.if_else(t < p.at, 1, 0))
    run = {"h": 0.01, "params": {"at": [5.0, 0.733]}}
    with pytest.raises(lv.IntegrationError, match="member 1: step 73 has no derivative"):
        of_wave(which, system, lv.Magnus(), "params.at", **run)


WELLS = {
    "the time it comes": (lambda t, x, p: p.a * ca.if_else(x[0] < p.at * t, 1, 0), "at a time"),
    "a place": (lambda t, x, p: p.a * ca.if_else(x[0] < p.at, 1, 0), "at a place"),
}


@pytest.mark.parametrize("which", BOTH)
@pytest.mark.parametrize("name", WELLS)
def test_potentials_that_jump_at_the_points_of_a_grid_or_between_them(name, which):
    """A wall that moves passes every point at a time of its own."""
    potential, text = WELLS[name]
    wall = lv.Grid((0, 0), (2, 1), (16, 4), potential=potential)
    system = lv.Schrodinger(wall, params={"a": 1.5, "at": 0.733})
    run = {"h": 0.02} if system.is_driven else {}
    run |= {"t": (0, 1), "psi": np.ones(64) / 8}
    method = lv.Magnus() if system.is_driven else lv.Chebyshev()
    with pytest.raises(lv.IntegrationError, match=rf"jump with 'x\[0\] < .*', {text} that moves"):
        of_wave(which, system, method, "params.at", **run)
    assert np.isfinite(of_wave(which, system, method, "params.a", **run))
    bent = lv.Grid(0, 2, 16, potential=lambda t, x, p: p.a * ca.fabs(x[0] - p.at))
    smooth = lv.Schrodinger(bent, params={"a": 1.5, "at": 0.733})
    run = {"t": (0, 1), "psi": np.cos(np.arange(16)) / 4}
    by, size = of_wave(which, smooth, lv.Chebyshev(1e-11), "params.at", **run), 1e-4
    ends = [
        lv.integrate(smooth, lv.Chebyshev(1e-11), params={"at": 0.733 + x}, **run).psi[-1, 0].real
        for x in (size, -size)
    ]
    assert by == pytest.approx((ends[0] - ends[1]) / (2 * size), abs=1e-7)


def test_systems_without_cases_are_not_looked_at():
    smooth = oscillator(lambda t, q, v, p: lv.table([0, 1, 2], [0, 1, 4])(q) - ca.tanh(v / 1e-3))
    assert branches(smooth) is None
    assert branches(shear(lambda t, y, p: lv.table([0, 1, 2], [0, 1, 4])(y) + ca.tanh(t))) is None


def test_quadratic_drag_from_rest_is_refused_with_the_form_that_is_smooth():
    """The length of a velocity has no derivative at zero, and one with a small e has."""

    def falling(speed):
        return lv.Lagrangian(
            lambda t, q, v, p: ca.dot(v, v) / 2 - 9.81 * q[1],
            force=lambda t, q, v, p: -p.c * speed(v) * v, q=2, params={"c": 0.1},
        )  # fmt: skip

    run = {"t": (0, 1), "steps": 20, "q": [0.0, 0.0], "v": [0.0, 0.0]}
    with pytest.raises(lv.IntegrationError, match=r"ca\.sqrt\(ca\.dot\(v, v\) \+ e\*\*2\)"):
        lv.integrate(falling(ca.norm_2), lv.Spark(2), tangents={"params.c": 1.0}, **run)
    smooth = falling(lambda v: ca.sqrt(ca.dot(v, v) + 1e-12))
    ends = [
        lv.integrate(smooth, lv.Spark(2), params={"c": c}, **run).q[-1, 1]
        for c in (0.1 - 1e-5, 0.1 + 1e-5)
    ]
    found = lv.integrate(smooth, lv.Spark(2), tangents={"params.c": 1.0}, **run)
    wanted = (ends[1] - ends[0]) / 2e-5
    assert found.tangents["params.c"].q[-1, 1] == pytest.approx(wanted, rel=1e-6)


def test_a_jump_in_a_fit_is_refused_with_what_ends_steps_there():
    rubbed = oscillator(lambda t, q, v, p: -p.c * ca.sign(v))
    t = np.linspace(0, 5, 51)
    data = {"t": t, "q": np.cos(t)}
    with pytest.raises(lv.IntegrationError, match=r"jump.*\nhint: .* by an event") as caught:
        lv.fit(rubbed, lv.Spark(2), data, h=0.05, params=["c"], q=[1.0], v=[0.1])
    assert "with rtol=" in str(caught.value)
