"""The planner: what the structure of a field says, and plans that are the same every time."""

import re
from dataclasses import replace
from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest
import sympy
from fields import abc_flow, lorenz96, random_exact, toda, volterra

import liouville as lv
from liouville._methods.planner.fields.structure import affine_part, candidates_of
from liouville._systems import PolynomialField
from liouville._systems.fields.terms import Terms
from liouville.problems import load

V = lv.VolumeSplitting
OPEN = V(composition="BM4")

EXPONENTIALS = ("exponentials", "natural")
NO_DIAGONAL = [EXPONENTIALS, ("exponentials", "triangular")]
DENSE_CUBIC = [
    EXPONENTIALS,
    ("pairs", "natural"),
    ("exponentials", "triangular"),
    ("shears", "natural"),
    ("n+d", "natural"),
]
DENSE_QUADRATIC = [*DENSE_CUBIC, ("regular", "natural")]


def chosen(terms, method=OPEN):
    """Return the candidates for a field as (diagonal, off-diagonal), and why in one text."""
    names = [f"v{i}" for i in range(terms.n)]
    found, reasons = candidates_of(terms, method, names)
    return [(each.diagonal, each.off_diagonal) for each in found], "\n".join(reasons)


def dense(n, d, without=lambda i, factors: False):
    """Return a dense field, but for terms that a symmetry forbids."""
    terms = random_exact(n, d, seed=n + d)
    rows = zip(terms.component.tolist(), terms.variables.tolist(), strict=True)
    keep = [not without(i, [v for v in factors if v >= 0]) for i, factors in rows]
    return balanced(terms.selected(np.array(keep)))


def balanced(terms):
    """Return the nearest field without divergence."""
    return terms.repaired()


def with_plane(n):
    """x_1 = 0 is invariant: each term of its component contains it."""
    return dense(n, 2, lambda i, factors: i == 1 and 1 not in factors)


def with_reflection(n):
    """x_0 -> -x_0 reverses: terms of x_0' are even in it, the others odd."""
    return dense(n, 2, lambda i, factors: factors.count(0) % 2 == (i == 0))


STRUCTURES = [
    ("no diagonal part", lorenz96(12), NO_DIAGONAL, "no diagonal part"),
    ("sparse", volterra(12), [EXPONENTIALS], "sparse: 24 terms of 1092"),
    ("sparse too", toda(8), [EXPONENTIALS], "the field is sparse"),
    ("an invariant plane", with_plane(4), [EXPONENTIALS], "the plane v1 = 0 is invariant"),
    ("a reflection", with_reflection(4), [EXPONENTIALS], "a reflection .* reverses the flow"),
    ("dense", dense(4, 2), DENSE_QUADRATIC, "dense, without invariant planes or reversing"),
    ("dense and cubic", dense(4, 3), DENSE_CUBIC, "dense, without"),
    ("linear", dense(4, 1), [EXPONENTIALS], "the diagonal part is linear"),
    ("waves", abc_flow(1.0, 2.0, 3.0), [EXPONENTIALS], "no diagonal part"),
]


@pytest.mark.parametrize(
    ("terms", "wanted", "why"), [pytest.param(*row, id=name) for name, *row in STRUCTURES]
)
def test_the_structure_says_what_is_tried_and_why(terms, wanted, why):
    found, reasons = chosen(terms)
    assert sorted(found) == sorted(wanted)
    assert found[0] == EXPONENTIALS  # the safest first
    assert re.search(why, reasons)


def test_what_is_fixed_is_not_chosen():
    terms = dense(4, 2)
    found, reasons = chosen(terms, replace(OPEN, diagonal="shears"))
    assert found == [("shears", "natural"), ("shears", "triangular")]
    assert "as asked for" in reasons
    found, _ = chosen(terms, replace(OPEN, off_diagonal="triangular"))
    assert set(found) == {(d, "triangular") for d in ("exponentials", "pairs", "shears", "regular")}


def gyration(rate):
    """Return a charge that turns fast in a magnetic field, in a weak force."""
    one = [("x", 1, ("u",)), ("y", 1, ("v",)), ("u", rate, ("v",)), ("v", -rate, ("u",))]
    force = [("u", "-1/8", ("x", "x")), ("v", "-1/8", ("x", "y", "y"))]
    return PolynomialField.from_terms(("x", "y", "u", "v"), [*one, *force])


@pytest.mark.parametrize(("rate", "h", "linear"), [(100, 0.1, "exact"), (1, 0.1, "split")])
def test_a_fast_affine_part_is_taken_exactly(rate, h, linear):
    x = [0.5, 0.3, 0.4, -0.2]
    plan = lv.plan(gyration(rate), h=h, x=x)
    assert plan.method.linear == linear
    assert ("the affine part is fast, |A| h = 10" in str(plan)) == (linear == "exact")
    assert ("affine part, of x, y, u, v: 4 terms" in str(plan)) == (linear == "exact")


def test_a_fast_affine_part_that_is_small_beside_the_rest_is_split():
    terms = gyration(100).terms
    near, far = (np.full((4, 4), size) for size in (1.0, 1e3))
    assert affine_part(terms, V(), 0.1, near)[0] == "exact"
    assert affine_part(terms, V(), 0.1, far)[0] == "split"
    assert affine_part(terms, V(linear="split"), 0.1, near) == ("split", [])


def test_an_affine_field_is_one_exact_flow():
    field = PolynomialField.from_terms(
        ("x", "v"), [("x", 1, ("v",)), ("v", -1, ("x",)), ("v", 2, ())]
    )
    plan = lv.plan(field, h=0.1, x=[1.0, 0.0])
    assert plan.pieces == ("affine part, of x, v: 3 terms",)
    end = lv.integrate(field, V(), t=(0, 10), steps=1, x=[1.0, 0.0]).x[-1]
    np.testing.assert_allclose(end, [2 - np.cos(10), np.sin(10)], rtol=1e-13)


FIELD = load("bajer_moffatt").system
STARTS = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))

CHARGE = load("cubic_charge")
CLOUD = np.random.default_rng(0).normal(CHARGE.start["x"], 0.1, (20, 6))


def test_the_same_seed_gives_the_same_plan():
    first, again = (lv.plan(FIELD, h=0.05, x=STARTS, seed=3) for _ in range(2))
    assert first == again
    assert str(first) == str(again)
    others = [lv.plan(CHARGE.system, h=0.1, x=CLOUD, seed=seed, trials=3) for seed in range(8)]
    assert len({plan.order for plan in others}) > 1


def test_a_plan_is_made_once_for_the_same_call(monkeypatch):
    from liouville._runs.fields import field as runner

    made = []
    plan_field = runner.plan_field

    def counted(terms, method, h, *more, **options):
        made.append((len(terms), method, h))
        return plan_field(terms, method, h, *more, **options)

    monkeypatch.setattr(runner, "plan_field", counted)
    field = lv.PolynomialField(
        lambda t, x, params: [params.a * x[1] * x[2], x[0] * x[2], -x[0] * x[1]],
        x=3, params={"a": 0.5},
    )  # fmt: skip

    def run(x=(1.0, 0.5, 0.2), method=V(), h=0.1, a=0.5):  # noqa: B008
        return lv.integrate(field, method, t=(0, 1), h=h, x=x, params={"a": a})

    closed = V("exponentials", "natural", composition="S2", linear="split")
    first, changed = run(), run(a=0.7)
    for _ in range(2):
        np.testing.assert_array_equal(run().x, first.x)
        run(method=closed)
        run(method=closed, h=0.2, x=(0.2, 0.4, 0.6))
    assert len(made) == 3  # of the start, of other parameters, of the closed method
    other = field.with_params({"a": 0.7})
    again = lv.integrate(other, V(), t=(0, 1), h=0.1, x=(1.0, 0.5, 0.2))
    np.testing.assert_array_equal(again.x, changed.x)
    run(h=0.2)
    run(x=(0.2, 0.4, 0.6))
    assert [h for *_, h in made[-2:]] == [0.2, 0.1]


def test_a_run_does_as_the_plan_says_on_any_number_of_threads():
    span = {"t": (0, 2), "h": 0.05}
    plan = lv.plan(FIELD, **span, x=STARTS[0])
    single = lv.integrate(FIELD, V(), **span, x=STARTS[0])
    assert single.method == repr(plan.method)
    np.testing.assert_array_equal(lv.integrate(FIELD, plan, **span, x=STARTS[0]).x, single.x)
    runs = [lv.ensemble(FIELD, V(), **span, x=STARTS, threads=threads).x for threads in (1, 2)]
    np.testing.assert_array_equal(*runs)
    forced = lv.ensemble(FIELD, lv.plan(FIELD, **span, x=STARTS), **span, x=STARTS)
    np.testing.assert_array_equal(forced.x, runs[0])


@pytest.mark.parametrize("method", [V(), V("shears"), V("n+d"), V("exponentials", "triangular")])
def test_a_plan_comes_back_from_its_file(tmp_path, method):
    plan = lv.plan(FIELD, method, h=0.05, x=STARTS, trials=10)
    plan.save(tmp_path / "plan.json")
    loaded = lv.Plan.load(tmp_path / "plan.json")
    assert loaded == plan
    span = {"t": (0, 1), "h": 0.05, "x": STARTS[0]}
    one, other = (lv.integrate(FIELD, each, **span) for each in (plan, loaded))
    np.testing.assert_array_equal(one.x, other.x)


def test_a_plan_is_forced_on_a_run_and_keeps_its_own_order():
    plan = lv.plan(FIELD, V("exponentials", "natural", "S2", "split"), h=0.05, x=STARTS)
    turned = replace(plan, order=plan.order[1:] + plan.order[:1])
    span = {"t": (0, 1), "h": 0.05, "x": STARTS[0]}
    one, other = (lv.integrate(FIELD, each, **span) for each in (plan, turned))
    assert one.stats["pieces"] == other.stats["pieces"] == 4
    assert 1e-12 < np.abs(one.x - other.x).max() < 0.1
    changed = lv.integrate(FIELD, plan, **span, params={"alpha": 2.0})
    assert changed.params["alpha"] == 2.0
    with pytest.raises(ValueError, match=r"3 variables and 10 terms, not 3 and 8\nhint: make one"):
        lv.integrate(FIELD, plan, **span, params={"alpha": 0.0})


def test_a_plan_says_which_pieces_why_and_what_they_cost():
    plan = lv.plan(FIELD, V(composition="BM6"), h=0.05, x=STARTS)
    head, *lines = str(plan).splitlines()
    assert head == f"BM6 of {len(plan.order)} pieces: pairs, natural"
    assert lines[0].startswith("  3 variables, 10 terms, h = 0.05; a step takes about ")
    assert f"{plan.cost:.3g} operations" in lines[0]
    assert "the field is dense" in "\n".join(plan.reasons)
    assert "6 candidates on 32 states, then 50 orders" in "\n".join(plan.reasons)
    assert set(plan.pieces) == {
        "exponential of x, y by y",
        "exponential of y, z by y",
        "natural shear of x: 1 term",
        "natural shear of y: 4 terms",
        "natural shear of z: 2 terms",
    }
    assert {line.strip() for line in lines} >= {*plan.pieces, *plan.reasons}
    scores = [trial.score for trial in plan.trials]
    assert scores == sorted(scores)
    assert plan.cost <= plan.trials[0].cost  # the costliest first and last, or what is better


def test_the_pieces_are_named_in_the_order_of_the_second_half_of_a_step():
    """Against a step of Strang's splitting in rational numbers."""
    names = ("a", "b", "c")
    field = PolynomialField(
        lambda t, x, params: [x[1] ** 2 - x[2], x[0] * x[2], x[0] ** 2 * x[1]], x=names
    )
    rates = [lambda s: s[1] ** 2 - s[2], lambda s: s[0] * s[2], lambda s: s[0] ** 2 * s[1]]
    plan = lv.plan(field, V(composition="S2"), h=1 / 64, x=[0.5, 0.25, -0.5])
    text = str(plan).split("pieces, in the order of the second half of a step\n")[1]
    said = [names.index(line.split()[3][0]) for line in text.splitlines()[:3]]
    end = lv.integrate(field, plan, t=(0, 1 / 64), steps=1, x=[0.5, 0.25, -0.5]).x[-1]
    ends = []
    for second in (said, said[::-1]):
        state = [Fraction(1, 2), Fraction(1, 4), Fraction(-1, 2)]
        for i in (*second[::-1], *second):
            state[i] += Fraction(1, 128) * rates[i](state)
        ends.append(np.array(state, dtype=float))
    assert (end == ends[0]).all()
    assert np.abs(end - ends[1]).max() > 1e-8


def test_the_order_that_is_taken_is_better_than_most():
    span = {"t": (0, 2), "x": CLOUD}
    exact = lv.ensemble(CHARGE.system, V(composition="SS10s35"), steps=80, every=80, **span).x[-1]
    plan = lv.plan(CHARGE.system, h=0.1, x=CLOUD)

    def error(order):
        end = lv.ensemble(CHARGE.system, replace(plan, order=order), steps=20, every=20, **span).x[
            -1
        ]
        return np.sqrt(np.mean((end - exact) ** 2))

    errors = [error(order) for order in permutations(range(4))]
    assert error(plan.order) < np.median(errors) / 2
    assert error(plan.order) < max(errors) / 4


def test_a_huge_field_is_planned_by_its_structure_alone():
    lorenz = load("lorenz96")
    plan = lv.plan(lorenz.build(30_000), h=0.05, x=lorenz.start_for(30_000)["x"])
    assert plan.trials == ()
    assert plan.pieces[0] == "natural shear of x1, x4, x7 and 9997 more: 20000 terms"
    assert sorted(plan.order) == [0, 1, 2]


def test_where_no_candidate_comes_through_the_plan_says_so():
    plan = lv.plan(FIELD, h=0.5, x=[[40.0, 30.0, 20.0]] * 3)
    assert "h may be too large" in str(plan)
    assert "failed" in str(plan)
    assert "nan" not in str(plan)
    assert "inf" not in str(plan)


def test_time_is_a_variable_of_a_driven_field():
    driven = PolynomialField(
        lambda t, x, params: [x[1] + t, -x[0] * t**2 - x[0] ** 3], x=("q", "p")
    )
    span = {"t": (1, 2), "h": 0.1, "x": [1.0, 0.0]}
    plan = lv.plan(driven, **span)
    assert plan.n == 3
    assert any(" t" in piece for piece in plan.pieces)
    run = lv.integrate(driven, plan, **span)
    np.testing.assert_array_equal(run.x, lv.integrate(driven, V(), **span).x)


def test_a_field_of_nothing_but_time_is_no_trouble():
    assert chosen(Terms.of(2, [(0, 1, ())]))[0] == NO_DIAGONAL


def on_spheres(seed, degree):
    """Return a random field tangent to spheres, x cross grad H, and a start on the unit one."""
    rng, x = np.random.default_rng(seed), sympy.symbols("x y z")
    powers = [
        (i, j, k) for d in range(1, degree + 1) for i in range(d, -1, -1)
        for j in range(d - i, -1, -1) for k in (d - i - j,)
    ]  # fmt: skip
    h = sum(
        sympy.Rational(int(rng.integers(-4, 5)), 4) * x[0] ** i * x[1] ** j * x[2] ** k
        for i, j, k in powers
    )
    gradient = sympy.Matrix([h.diff(v) for v in x])
    field = PolynomialField.from_sympy(sympy.Matrix(x).cross(gradient), x)
    start = rng.standard_normal(3)
    return field, start / np.linalg.norm(start)


@pytest.mark.parametrize(("seed", "degree"), [(8, 4), (1033, 2), (1010, 3)])
def test_the_error_falls_where_the_step_is_halved(seed, degree):
    """With what is chosen by itself: of these fields errors grew by up to 19 times."""
    field, x = on_spheres(seed, degree)
    run = {"t": (0, 8), "x": x}
    exact = lv.integrate(
        field, V("exponentials", "natural", composition="SS10s35"), steps=1600, every=1600, **run
    ).x[-1]
    errors = [
        np.abs(lv.integrate(field, V(), steps=n, every=n, **run).x[-1] - exact).max()
        for n in (100, 200, 400)
    ]
    ratios = np.divide(errors[:-1], errors[1:])
    assert ratios.min() > 4, errors


def test_a_run_is_planned_as_long_as_it_is():
    """Not by what follows: this path is at infinity before t = 4, and the run ends at t = 1."""
    field = PolynomialField(lambda t, x, params: [x[0] ** 2 + x[1], -2 * x[0] * x[1]], x=2)
    for h in (0.25, 0.05):
        plan = lv.plan(field, h=h, t=(0, 1), x=[0.4, 0.5])
        assert np.isfinite([trial.error for trial in plan.trials]).any()
        assert "too large" not in str(plan)
        back = lv.plan(field, h=h, t=(1, 0), x=[0.4, 0.5])
        assert back.h == -plan.h
        run = lv.integrate(field, V(), t=(0, 1), h=h, x=[0.4, 0.5])
        assert (lv.integrate(field, plan, t=(0, 1), h=h, x=[0.4, 0.5]).x == run.x).all()
    wrong = (
        ((0, 0), "must end at another time"),
        ((0, 1, 2), "pair"),
        ("now", "t must be a number"),
    )
    for t, sentence in wrong:
        with pytest.raises((TypeError, ValueError), match=sentence):
            lv.plan(field, h=0.1, t=t, x=[0.4, 0.5])


@pytest.mark.parametrize("d", [2, 3, 8])
@pytest.mark.parametrize("c", ["1", "1/3", "0.1"])
def test_a_field_that_is_one_shear_is_found_to_be_one(d, c):
    x = sympy.symbols("x y z")
    g = sympy.expand(sympy.sympify(c) * sum(x) ** d)
    field = PolynomialField.from_sympy([g, -g, 0 * x[0]], x)
    start = np.array([0.3, 0.2, 0.4])
    plan = lv.plan(field, h=2.0, t=(0, 2), x=start)
    assert plan.pieces == (f"shear along x, y: {len(g.as_ordered_terms())} terms",)
    end = lv.integrate(field, V(), t=(0, 2), steps=1, x=start).x[-1]
    moved = 2 * float(sympy.sympify(c)) * 0.9**d
    assert end == pytest.approx(start + moved * np.array([1, -1, 0]), abs=1e-14)
    # a little more of the same degree makes it another field
    other = PolynomialField.from_sympy([g + x[2] ** d * sympy.Rational(1, 10**9), -g, x[0] ** d], x)
    assert len(lv.plan(other, h=0.1, x=start).order) > 1


def test_shears_that_commute_are_exact_together_with_a_fast_linear_part():
    x, y, z, w = sympy.symbols("x y z w")
    one, two = sympy.expand((x + y) ** 2 + 40 * z), sympy.expand((x + y) * z)
    field = PolynomialField.from_sympy([one, -one, 0 * z, two], [x, y, z, w])
    start = np.array([0.3, 0.2, 0.4, 0.1])
    run = lv.integrate(field, V(), t=(0, 2), steps=1, x=start)
    assert run.stats["pieces"] == 2
    moved = np.array([16.25, -16.25, 0, 0.2])
    assert run.x[-1] == pytest.approx(start + 2 * moved, abs=1e-12)
    # natural shears stay natural
    natural = PolynomialField.from_sympy([z**2, z**3, 0 * z, z * w - z * w + z], [x, y, z, w])
    assert "natural shear" in lv.plan(natural, h=0.1, x=start).pieces[0]
