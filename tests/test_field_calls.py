"""Runs of polynomial fields: wrong calls are refused before they start, failures say where and why.

One table, one row a mistake; then the runs that fail. None of them returns numbers that are wrong.
"""

import math
import signal
import sys

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._basics import checksum
from liouville._systems import PolynomialField
from liouville.problems import load

MODULE = sys.modules["liouville._runs.execute"]
NAN, INF = math.nan, math.inf

TOP = load("euler_top").system  # m1, m2, m3
VORTEX = load("hill_vortex").system  # of degree 3
ABC = load("abc_flow").system
PENDULUM = load("pendulum")
PLAN = lv.plan(TOP, h=0.1, x=[1.0, 0.5, 0.2])
V = lv.VolumeSplitting
ONE, TWO = [1.0, 0.5, 0.2], [[1.0, 0.5, 0.2], [0.1, 1.0, 0.0]]


def of(function, **usual):
    """Return a function that calls another as usual, with something changed."""

    def call(system=TOP, method=V(composition="S2"), **changes):  # noqa: B008
        return function(system, method, **{**usual, **changes})

    return call


SPAN = {"t": (0.0, 1.0), "h": 0.1}
run, many = of(lv.integrate, **SPAN, x=ONE), of(lv.ensemble, **SPAN, x=TWO)
cut, det = of(lv.section, **SPAN, plane="m1", x=TWO), of(lv.analysis.determinant, **SPAN, x=ONE)
plan = of(lv.plan, h=0.1, x=ONE)


def swing(method, function=lv.integrate, **more):
    return function(PENDULUM.system, method, **SPAN, **PENDULUM.start, **more)


def of_terms(x, *terms):
    """Make a field of terms such as ("x", 1, "yyz") in coordinates such as "xyz"."""
    return PolynomialField.from_terms(tuple(x), [(i, c, tuple(v)) for i, c, v in terms])


SPROTT_A = [("x", 1, "y"), ("y", -1, "x"), ("y", 1, "yz"), ("z", 1, ""), ("z", -1, "yy")]
NOSE_HOOVER = [("x", 1, "y"), ("y", -1, "x"), ("y", -1, "yz"), ("z", 1, "yy"), ("z", -1, "")]

DRIFTING = PolynomialField(
    lambda t, x, params: [params.a * x[0] * x[1], -(x[1] ** 2) / 2], x=("x", "y"), params={"a": 1.0}
)

# id, the call, the exception, the message
ROWS = [
    # a method for the system, a system for the method
    ("Spark", lambda: run(method=lv.Spark()), TypeError, "Spark.*polynomial fields; .*: Volume"),
    ("HHT", lambda: many(method=lv.HHT()), TypeError, "HHT.*does not step polynomial fields"),
    ("cut Spark", lambda: cut(method=lv.Spark()), TypeError, "does not step polynomial fields"),
    ("det Spark", lambda: det(method=lv.Spark()), TypeError, "does not step polynomial fields"),
    ("plan Spark", lambda: plan(method=lv.Spark()), TypeError, "Spark.* is a VolumeSplitting"),
    (
        "Composition",
        lambda: run(method=lv.Composition(lv.Spark(1))),
        TypeError,
        "Composition.*does not step polynomial fields; methods that do: VolumeSplitting, a plan",
    ),
    ("a name", lambda: run(method="BM4"), TypeError, "method must be .*, not 'BM4'"),
    (
        "a pendulum",
        lambda: swing(V()),
        TypeError,
        r"VolumeSplitting\(\) does not step mechanical systems; methods that do: Spark, Lobatto",
    ),
    ("plan of it", lambda: swing(PLAN), TypeError, "<FieldPlan of 3 pieces.*mechanical systems"),
    ("pendulums", lambda: swing(V(), lv.ensemble), TypeError, "does not step mechanical systems"),
    (
        "cut one",
        lambda: cut(PENDULUM.system),
        TypeError,
        "without divergence, not of Lagr",
    ),
    (
        "det one",
        lambda: det(PENDULUM.system),
        TypeError,
        "without divergence, not of Lagr",
    ),
    (
        "plan one",
        lambda: plan(PENDULUM.system),
        TypeError,
        "a plan must be for a field or a Schrodinger equation, not Lagrangian",
    ),
    # the method alone
    ("scheme", lambda: V(composition="BM5"), ValueError, r"'BM5'.*\nhint: did you mean 'BM6'\?"),
    ("no scheme", lambda: V(composition=4), TypeError, "the name of a scheme, not 4"),
    ("diagonal", lambda: V("shear"), ValueError, r"shears, exp.*, regular, n\+d, not 'shear'"),
    ("off", lambda: V(off_diagonal="x"), ValueError, "off_diagonal must be one of auto.*not 'x'"),
    ("linear", lambda: V(linear=True), ValueError, "auto, split, exact, not True"),
    ("RK", lambda: V(runge_kutta="rk5"), ValueError, "euler.*rk4, not 'rk5'"),
    ("compensated", lambda: V(compensated=1), TypeError, "True or False, not 1"),
    ("n+d and c", lambda: V("n+d", "triangular"), ValueError, "the whole field.*'n.d'.*'triang"),
    (
        "regular cubic",
        lambda: run(VORTEX, V("regular")),
        ValueError,
        "for a diagonal part of degree 2, not 3\nhint: take diagonal='exponentials' or 'shears'",
    ),
    (
        "n+d waves",
        lambda: run(ABC, V("n+d")),
        ValueError,
        r"has functions\nhint: take diagonal='exp",
    ),
    # steps
    (
        "rtol",
        lambda: run(h=None, rtol=2.0),
        ValueError,
        "rtol must be from 1e-12 to below 1, not 2",
    ),
    ("rtol and steps", lambda: run(h=None, steps=4, rtol=1e-3), TypeError, "either steps, which"),
    ("atol", lambda: run(atol=1e-3), TypeError, "equal steps and no atol without rtol"),
    ("control", lambda: run(control=lv.Adaptive()), TypeError, "equal steps and no control"),
    ("many rtol", lambda: many(rtol=1e-3), TypeError, r"no rtol=\nhint: its members take equal"),
    ("h zero", lambda: run(h=0), ValueError, "h must be positive and finite, not 0"),
    ("h negative", lambda: run(h=-0.1), ValueError, r"(?s)not -0\.1.*hint: .*t=\(end, start\)"),
    ("h NaN", lambda: run(h=NAN), ValueError, "h must be positive and finite, not nan"),
    ("many h", lambda: many(h=0), ValueError, "h must be positive and finite, not 0"),
    ("cut h", lambda: cut(h=-1), ValueError, "h must be positive and finite, not -1"),
    ("det h", lambda: det(h=0), ValueError, "h must be positive and finite, not 0"),
    ("plan h", lambda: plan(h=0), ValueError, "h must be positive and finite, not 0"),
    ("plan -h", lambda: plan(h=-0.1), ValueError, "h must be positive and finite, not -0.1"),
    ("plan h NaN", lambda: plan(h=NAN), ValueError, "h must be positive and finite, not nan"),
    ("plan h word", lambda: plan(h="0.1"), TypeError, "h must be a number, not '0.1'"),
    ("no h", lambda: run(h=None), TypeError, "give either h or steps"),
    ("h and steps", lambda: cut(steps=3), TypeError, "a section takes either h or steps$"),
    ("class", lambda: run(method=lv.VolumeSplitting), TypeError, r"write lv\.VolumeSplitting\(\)$"),
    ("times between", lambda: run()(0.1), ValueError, "in t_eval=$"),
    ("times", lambda: run(t=[0, 1, 2]), TypeError, r"not 3 times\nhint: .*t_eval="),
    ("no h of a section", lambda: cut(h=None), TypeError, "a section takes either h or steps$"),
    ("no time", lambda: det(t=(1, 1)), ValueError, "must end at another time"),
    ("too much", lambda: many(h=1e-12), MemoryError, r"(?s)states takes .* GiB.*hint: .*every="),
    # starts
    ("x long", lambda: run(x=[1, 2, 3, 4]), ValueError, r"shape \(3,\), not \(4,\)"),
    ("x many", lambda: run(x=TWO), ValueError, r"\(3,\), not \(2, 3\)\nhint: lv.ensemble"),
    ("x one", lambda: many(x=ONE), ValueError, r"shape \(P, 3\).*\nhint: give a row"),
    ("x deep", lambda: many(x=[TWO]), ValueError, r"\(P, 3\) for P members, not \(1, 2, 3\)$"),
    (
        "x none",
        lambda: many(x=np.empty((0, 3))),
        ValueError,
        r"\(P, 3\) for P members, not \(0, 3\)",
    ),
    ("x NaN", lambda: run(x=[1, NAN, 0]), ValueError, "x of 'm2' must be finite, not nan"),
    ("x infinite", lambda: det(x=[1, 0, -INF]), ValueError, "'m3' must be finite, not -inf"),
    (
        "x NaN of one",
        lambda: many(x=[ONE, [1, 2, NAN]]),
        ValueError,
        "'m3' of member 1 must be finite",
    ),
    (
        "cut NaN",
        lambda: cut(x=[ONE, [1, 2, NAN]]),
        ValueError,
        "x of 'm3' of member 1 must be finite",
    ),
    ("plan NaN", lambda: plan(x=[ONE, [NAN, 2, 1]]), ValueError, "'m1' of member 1 must be finite"),
    ("plan x", lambda: plan(x=[1, 2]), ValueError, r"shape \(3,\), not \(2,\)"),
    ("q", lambda: run(q=[1]), TypeError, "'q' is no start value of this system, which takes x="),
    ("no x", lambda: lv.integrate(TOP, V(), **SPAN), TypeError, "'x' is missing: .* takes x="),
    # plans
    ("other plan", lambda: run(VORTEX, PLAN), ValueError, "3 variables and 3 terms, not 3 and 14"),
    ("replan", lambda: plan(method=PLAN), TypeError, "Plan of 3.*method is a VolumeSplitting"),
    ("trials", lambda: plan(trials=0), ValueError, "trials must be at least 1, not 0"),
    ("seed", lambda: plan(seed=-1), ValueError, "seed must be an integer from 0 on, not -1"),
    ("plan t", lambda: plan(t=INF), ValueError, "t must be finite, not inf"),
    ("plan params", lambda: plan(params={"b": 1}), ValueError, "no parameter 'b'.*: a"),
    # planes
    ("plane of time", lambda: cut(plane="t"), ValueError, r"period= is missing: .*\nhint: "),
    ("times up", lambda: cut(plane="t", period=1, direction="up"), ValueError, "no direction"),
    (
        "parameter of each",
        lambda: many(DRIFTING, x=[[1.0, 0.5]] * 2, params={"a": [1.0, 2.0, 3.0]}),
        ValueError,
        "parameter 'a' must have 2 members as x has, not 3",
    ),
    ("plane", lambda: cut(plane="w"), ValueError, "no coordinate 'w': the system has m1, m2, m3"),
    ("plane 2", lambda: cut(plane=[0, 1]), ValueError, r"plane must have shape \(3,\), not \(2,\)"),
    ("plane zero", lambda: cut(plane=[0, 0, 0]), ValueError, "must be finite and not zero"),
    ("plane NaN", lambda: cut(plane=[0, NAN, 0]), ValueError, "must be finite and not zero"),
    (
        "plane None",
        lambda: cut(plane=None),
        TypeError,
        "a function or an array of numbers, not None",
    ),
    ("offset", lambda: cut(offset=NAN), ValueError, "offset must be finite, not nan"),
    ("offset word", lambda: cut(offset="1"), TypeError, "offset must be a number, not '1'"),
    ("period", lambda: cut(period=0), ValueError, "period must be positive and finite, not 0"),
    ("direction", lambda: cut(direction="left"), ValueError, "both, up, down, not 'left'"),
    # what else a run takes
    ("threads", lambda: run(threads=0), ValueError, "threads must be at least 1, not 0"),
    ("many threads", lambda: many(threads=-2), ValueError, "threads must be at least 1, not -2"),
    ("cut threads", lambda: cut(threads=0), ValueError, "threads must be at least 1, not 0"),
    ("half a thread", lambda: run(threads=1.5), TypeError, "threads must be an integer, not 1.5"),
    ("pendulum's", lambda: swing(lv.Spark(), threads=0), ValueError, "threads must be at least 1"),
    ("every", lambda: many(every=0), ValueError, "every must be at least 1, not 0"),
    ("states", lambda: run(states=1), TypeError, "states must be True or False, not 1"),
    ("progress", lambda: cut(progress=3), TypeError, "progress must be a function, not 3"),
    ("det progress", lambda: det(progress=3), TypeError, "progress must be a function, not 3"),
    ("observe", lambda: run(observe={"r": 3}), TypeError, "'r' must be a function, not 3"),
    ("params", lambda: many(params={"b": 1}), ValueError, "no parameter 'b'.*: a"),
    ("params NaN", lambda: run(params={"a": [1, 2, NAN]}), ValueError, "must be finite, not nan"),
    # fields with a divergence
    ("Sprott A", lambda: of_terms("xyz", *SPROTT_A), ValueError, r"div f contains 1 \* z\nhint"),
    (
        "Nose-Hoover",
        lambda: of_terms("xyz", *NOSE_HOOVER),
        ValueError,
        r"div f contains -1 \* z\nhint",
    ),
    (
        "by a parameter",
        lambda: run(DRIFTING, x=[1, 1], params={"a": 3.0}),
        ValueError,
        r"div f contains 2 \* y\nhint",
    ),
]


@pytest.mark.parametrize(
    ("call", "error", "message"), [pytest.param(*row, id=name) for name, *row in ROWS]
)
def test_a_bad_call_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_the_right_calls_are_taken():
    assert run().status == many().status == det().status == cut().status == "done"
    assert run(method=PLAN).status == many(method=plan()).status == "done"
    assert run(DRIFTING, x=[1, 1]).status == "done"


SPLIT = "volume-splitting"
PLANS = {
    "nothing": ("", "Expecting value"),
    "no dict": ("[1]", "it holds a list"),
    "empty": ("{}", "is damaged"),
    "form": ({"form": "tree"}, "form must be field or wave, not 'tree'"),
    "wave": ({"form": "wave"}, "."),
    "trials": (
        checksum.signed({"form": "field", "method": {"name": "volume-splitting"}}),
        "'trials'",
    ),
    "open": ({"method": {"name": SPLIT, "diagonal": "auto"}}, "leaves something to choose"),
    "word": ({"method": {"name": SPLIT, "diagonal": "all"}}, "diagonal must be one of"),
    "method": ({"method": {"name": "spark", "stages": 2}}, r"its method is Spark"),
    "no method": ({"method": {"name": "sparks"}}, "'sparks' is missing"),
    "order": ({"order": [0, 0, 1]}, "order is no permutation"),
    "directions": ({"directions": [5]}, "directions is no permutation"),
    "size": ({"n": "three"}, "n must be .* not 'three'"),
    "cost": ({"cost": "much"}, "cost must be a number, not 'much'"),
    "more": ({"colour": "red"}, "'colour'"),
}


@pytest.mark.parametrize(("change", "message"), PLANS.values(), ids=PLANS)
def test_a_file_that_is_no_plan_is_refused(tmp_path, change, message):
    path = tmp_path / "plan.json"
    if isinstance(change, dict):
        PLAN.save(path)
        change = checksum.signed({**checksum.verified(path), **change})
    path.write_text(change)
    with pytest.raises(ValueError, match=rf"no plan that liouville saved: .*{message}.*\nhint: "):
        lv.Plan.load(path)


def test_a_plan_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no plan file '.*mine\.json'"):
        lv.Plan.load(tmp_path / "mine.json")


# --- runs that fail ------------------------------------------------------------------------------

# x' = x^2, y' = -2 x y: a trajectory from x = 1 is at infinity at t = 1
BURSTING = of_terms("xy", ("x", 1, "xx"), ("y", -2, "xy"))
# the same without a diagonal part: x'' = 2 x^3, at infinity at t = 1 from x = x' = 1
FALLING = of_terms("xv", ("x", 1, "v"), ("v", 2, "xxx"))
H = 1 / 64  # times are exact

# id, system, method, start, last step that is good, what fails and what is said of it
FAILURES = [
    ("shears", BURSTING, V("shears"), [1, 1], 63, "x", "'x' is not finite after it"),
    ("natural shears", FALLING, V(), [1, 1], 63, "v", "'v' is not finite after it"),
    ("n + d shears", BURSTING, V("n+d"), [1, 1], 63, "x", "'x' is not finite after it"),
    (
        "an exponential",
        BURSTING,
        V("exponentials", composition="S2"),
        [1, 1],
        62,
        "exponential of x, y by x",
        "flow of a piece reaches infinity within the step: exponential of x, y by x",
    ),
]


def finite(solution):
    groups = solution.states, solution.invariants, solution.observed
    return all(np.isfinite(values).all() for group in groups for values in group.values())


@pytest.mark.parametrize(
    ("system", "method", "x", "near", "quantity", "message"),
    [pytest.param(*row, id=name) for name, *row in FAILURES],
)
def test_a_trajectory_to_infinity_ends_with_where_and_what(
    system, method, x, near, quantity, message
):
    with pytest.raises(lv.IntegrationError, match=message) as caught:
        lv.integrate(system, method, t=(0, 2), h=H, x=x)
    error, solution = caught.value, caught.value.solution
    assert near <= error.step <= near + 20  # an approximation goes on for a while
    assert (error.quantity, error.member) == (quantity, None)
    assert error.t == error.step * H == solution.t[-1]
    assert f"step {error.step} of 128 at t = {error.t:.6g} failed" in str(error)
    assert "\nhint: a trajectory " in str(error)
    assert (solution.status, solution.message) == ("failed", str(error))
    assert finite(solution)
    plan = lv.plan(system, method, h=H, x=x)
    until = lv.integrate(system, plan, t=(0, error.t), steps=error.step, x=x)
    assert np.array_equal(solution.x, until.x)


@pytest.mark.parametrize("diagonal", ["shears", "exponentials"])
def test_a_member_that_fails_does_not_end_the_others(diagonal):
    method = V(diagonal, "natural", "BM4", "split")
    x = np.stack([np.linspace(-1, -0.1, 200), np.ones(200)], axis=1)
    x[137, 0] = x[150, 0] = 1.0
    solution = lv.ensemble(BURSTING, method, t=(0, 2), h=H, every=3, x=x)
    with pytest.raises(lv.IntegrationError) as alone:
        lv.integrate(BURSTING, method, t=(0, 2), h=H, every=3, x=x[137])
    assert solution.status == "partly failed"
    assert [*solution.failures] == [137, 150]
    failure = solution.failures[137]
    assert (failure.step, failure.t) == (alone.value.step, alone.value.t)
    assert failure.message == str(alone.value)
    expected = f"2 of 200 members failed (137 and 150); the first, member 137: {failure.message}"
    assert solution.message == expected
    k = -(-failure.step // 3) + 1 - bool(failure.step % 3)  # records up to the failure
    for member in (137, 150):
        assert np.array_equal(solution.x[:k, member], alone.value.solution.x[:k])
        assert np.isnan(solution.x[k:, member]).all()
    others = np.delete(np.arange(200), [137, 150])
    without = lv.ensemble(BURSTING, method, t=(0, 2), h=H, every=3, x=x[others])
    assert np.array_equal(solution.x[:, others], without.x)
    assert np.isfinite(without.x).all()
    assert "nan" not in repr(solution)


def test_failures_do_not_depend_on_threads():
    x = np.stack([np.linspace(0.1, 2, 300), np.ones(300)], axis=1)
    found = [
        lv.ensemble(BURSTING, V("shears"), t=(0, 2), h=H, x=x, threads=threads)
        for threads in (1, 2, 3)
    ]
    assert 0 < len(found[0].failures) < 300
    for other in found[1:]:
        assert other.failures == found[0].failures
        assert np.array_equal(other.x, found[0].x, equal_nan=True)


def test_a_section_goes_on_without_members_that_fail():
    x = [[0.1, 1.0], [1.0, 1.0], [0.4, 1.0]]
    found = lv.section(BURSTING, V("shears"), t=(0, 2), h=H, plane="x", offset=0.5, x=x)
    assert found.status == "done"
    assert [*found.failures] == [1]
    assert found.member.tolist() == [2]
    np.testing.assert_allclose(found.t, 0.5, atol=1e-6)  # 1 / (5/2 - t) = 1/2
    with pytest.raises(lv.IntegrationError, match="failed") as caught:
        lv.section(BURSTING, V("shears"), t=(0, 2), h=H, plane="x", offset=0.5, x=x[1:2])
    assert caught.value.section.status == "failed"


def test_a_failed_determinant_keeps_what_it_has():
    with pytest.raises(lv.IntegrationError, match="'x' is not finite after it") as caught:
        lv.analysis.determinant(BURSTING, V("shears"), t=(0, 2), h=H, x=[1, 1])
    assert finite(caught.value.solution)
    assert len(caught.value.solution.t) == caught.value.step + 1


@pytest.mark.parametrize("diagonal", ["shears", "exponentials", "n+d"])
@pytest.mark.parametrize("size", [1e150, 1e308])
def test_starts_next_to_infinity_fail_and_give_no_numbers(diagonal, size):
    with pytest.raises(lv.IntegrationError, match="step 0 of 128 at t = 0 failed") as caught:
        lv.integrate(BURSTING, V(diagonal), t=(0, 2), h=H, x=[size, size])
    assert finite(caught.value.solution)


def test_what_is_observed_of_a_member_may_fail():
    sliding = of_terms("x", ("x", 1, ""))
    depth = {"depth": lambda t, x, params: ca.log(1.5 - x[0])}
    found = lv.ensemble(sliding, V(), t=(0, 2), h=H, x=[[-5.0], [0.5]], observe=depth)
    assert [*found.failures] == [1]
    assert found.failures[1].step == 63
    assert "observed 'depth' is not finite at t = 1\n" in found.failures[1].message
    assert np.isfinite(found.x[:, 0]).all()
    x = np.full((200, 1), -5.0)
    x[150] = 1.5
    found = lv.ensemble(sliding, V(), t=(0, 2), h=H, x=x, observe=depth)
    assert "the start at t = 0 cannot" in found.failures[150].message
    assert np.isnan(found.x[:, 150]).all()
    assert np.isfinite(np.delete(found.x, 150, axis=1)).all()
    with pytest.raises(lv.IntegrationError, match=r"2 of 2 members failed.*cannot be taken") as no:
        lv.ensemble(sliding, V(), t=(0, 2), h=H, x=x[[150, 150]], observe=depth)
    assert (no.value.member, no.value.solution.x.shape) == (0, (0, 2, 1))


def test_an_affine_field_far_out_overflows_at_a_named_coordinate():
    saddle = of_terms("xy", ("x", 1, "x"), ("y", -1, "y"))
    with pytest.raises(lv.IntegrationError, match="'x' is not finite after it") as caught:
        lv.integrate(saddle, V(linear="exact"), t=(0, 1000), h=1.0, x=[1, 1])
    assert caught.value.step == 709  # exp(710) is too large
    np.testing.assert_allclose(caught.value.solution.x[-1, 0], np.exp(709.0), rtol=1e-12)


# --- Ctrl-C --------------------------------------------------------------------------------------


def interrupt(steps):
    """Return a progress function that is interrupted after so many steps."""
    seen = []

    def look(done, total):
        seen.append(done)
        assert seen == sorted(seen)
        assert done < total
        if done >= steps:
            signal.raise_signal(signal.SIGINT)

    return look


@pytest.mark.parametrize("kind", ["one", "determinant"])
def test_an_interrupt_returns_what_was_done(kind, monkeypatch):
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a step, or a turn of one block
    function, x = {
        "one": (lv.integrate, ONE),
        "determinant": (lv.analysis.determinant, ONE),
    }[kind]
    span = {"t": (0, 2.0**24), "h": H, "every": 256}
    solution = function(TOP, PLAN, **span, x=x, progress=interrupt(1000))
    steps = solution.stats["steps"]
    assert (solution.status, steps) == ("interrupted", 1000)
    assert solution.message == f"interrupted after {steps} of {2**30} steps"
    assert finite(solution)
    kept = steps // 256
    until = function(TOP, PLAN, **{**span, "t": (0, max(1, 4.0 * kept))}, x=x)
    assert np.array_equal(solution.x[: kept + 1], until.x[: kept + 1])


def test_an_interrupted_ensemble_has_the_members_it_came_to(monkeypatch):
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a step, or a turn of one block
    span = {"t": (0, 64.0), "h": H, "every": 256, "threads": 1}
    x = np.repeat(np.array(TWO), 5000, axis=0)
    found = lv.ensemble(TOP, PLAN, **span, x=x, progress=interrupt(1000))
    assert found.status == "interrupted"
    is_over = np.isfinite(found.x[-1]).all(axis=-1)
    assert 0 < is_over.sum() < 10_000
    assert found.message == f"interrupted when {is_over.sum()} of 10000 members were over"
    whole = lv.ensemble(TOP, PLAN, **span, x=TWO)
    is_there = np.isfinite(found.x)
    same = np.repeat(whole.x, 5000, axis=1)
    assert np.array_equal(found.x[is_there], same[is_there])


def test_an_interrupted_section_has_what_was_found(monkeypatch):
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a step, or a turn of one block
    # h is a power of two: both runs then have the same steps, to the bit
    span = {"h": 0.125, "plane": "m1", "x": [[0.1, 1.0, 0.3], [0.2, 1.0, -0.3]]}
    found = lv.section(TOP, PLAN, t=(0, 2.0**26), **span, progress=interrupt(3000))
    assert found.status == "interrupted"
    assert len(found) > 50
    assert set(found.member) == {0, 1}
    whole = lv.section(TOP, PLAN, t=(0, 0.125 * math.ceil(found.t.max() / 0.125)), **span)
    for member in range(2):
        mine, theirs = found.x[found.member == member], whole.x[whole.member == member]
        assert np.array_equal(mine, theirs[: len(mine)])


def test_a_strobe_map_says_who_failed():
    """By steps counted from the start; without a member that is left it is an error."""
    strobe = {"t": (0, 2), "h": 0.05, "plane": "t", "period": 0.1, "offset": 0.03}
    calm, burst = [0.1, 0.1, 0.1], [5.0, 5.0, 5.0]
    field = lv.PolynomialField(
        lambda t, x, params: [x[1] ** 2, x[2] ** 2, x[0] ** 2], x=("x", "y", "z")
    )
    plan = lv.plan(field, V("shears"), h=0.05, x=[calm, burst])
    found = lv.section(field, plan, x=[calm, burst], **strobe)
    assert "trajectories, 1 failed" in repr(found)
    step = found.failures[1].step
    assert f"step {step} of 39 at t = {found.failures[1].t:g} failed" in found.failures[1].message
    assert found.failures[1].t == pytest.approx(0.03 + (step - 1) * 0.05)
    with pytest.raises(lv.IntegrationError, match="1 of 1 members failed") as caught:
        lv.section(field, plan, x=[burst], **strobe)
    np.testing.assert_array_equal(caught.value.section.x, found.x[found.member == 1])
