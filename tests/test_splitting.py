"""Splittings: the pieces sum to the field, and each is what its name says.

What is exact is compared exactly. The reference data hold fields, a splitting that is unique, the
sizes of families of permutations, and steps of canonical splittings. One file, since all pieces are
held against the field by the same helpers.
"""

import json
from fractions import Fraction
from math import comb
from pathlib import Path

import numpy as np
import pytest
from fields import (
    SINE,
    abc_flow,
    lorenz96,
    on_ring,
    random_exact,
    random_normal,
    toda,
    volterra,
)  # fmt: skip
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from liouville._methods.splitting import (
    Affine,
    Exponential,
    Natural,
    Scaling,
    Shear,
    Split,
    Triangular,
    described,
    split,
)  # fmt: skip
from liouville._methods.splitting.directions import along, growth, harmonic, norm, powers
from liouville._methods.splitting.pieces import same_kind
from liouville._systems.fields.terms import Terms, Wave

REFERENCE = json.loads((Path(__file__).parent / "data" / "volume_reference.json").read_text())
FIELDS = {field["name"]: field for field in REFERENCE["fields"]}
GOOD = [name for name, field in FIELDS.items() if field["divergence_free"]]
METHODS = [
    ("exponentials", "natural"), ("exponentials", "triangular"), ("pairs", "natural"),
    ("shears", "natural"), ("shears", "triangular"), ("regular", "natural"),
    ("regular", "triangular"), ("n+d", "natural"),
]  # fmt: skip


def terms_of(name):
    return Terms.of(FIELDS[name]["n"], FIELDS[name]["terms"])


def check_piece(piece):
    """Assert that a piece is of its kind, and without divergence."""
    assert not piece.field().offending(), described(piece)
    match piece:
        case Natural(terms=terms):
            _, read = terms.dependencies()
            assert not np.isin(read, terms.component).any()
        case Shear(direction=a, g=g):
            assert np.count_nonzero(a)
            assert not g.component.any()  # a . grad g = 0 is that a g has no divergence
        case Scaling(rate=rate):
            _, read = rate.dependencies()
            assert not np.isin(read, rate.component).any()
        case Exponential(places=places, rates=rates, monomial=j):
            weighed = [c * (j.count(i) + 1) for i, c in zip(places, rates, strict=True)]
            assert abs(sum(weighed)) <= 1e-14 * sum(map(abs, weighed))
        case Triangular(order=order, terms=terms):
            place = np.full(terms.n, -1)
            place[order] = np.arange(order.size)
            term, read = terms.dependencies()
            assert (place[read] < place[terms.component[term]]).all()
        case Affine(matrix=matrix):
            assert abs(np.trace(matrix)) <= 1e-14 * np.abs(matrix).max()


def check(parts: Split, terms: Terms, tolerance=1e-13):
    """Assert that pieces sum to a field: exactly, if the field is exact and stayed so."""
    for piece in parts.pieces:
        check_piece(piece)
    if terms.is_exact:
        assert parts.field().is_exact
        assert len(parts.field() - terms) == 0
    assert parts.mismatch(terms) <= (0 if terms.is_exact else tolerance)


@examples(40)
@given(
    st.sampled_from(METHODS), st.integers(1, 4), st.integers(3, 10), st.integers(0, 999),
    st.booleans(), st.sampled_from(["split", "exact"]),
)  # fmt: skip
def test_pieces_of_dense_fields_sum_to_them(method, d, n, seed, is_exact, linear):
    d = min(d, 2) if method[0] == "regular" else d
    n = min(n, 12 - 2 * d) if is_exact else n  # fractions take their time
    exact = random_exact(n, d, seed)
    terms = exact if is_exact else exact.to_float()
    check(split(terms, *method, linear=linear), terms)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", GOOD)
def test_pieces_of_reference_fields_sum_to_them(name, method):
    terms = terms_of(name)
    if method[0] == "regular" and terms.diagonal().degree > 2:
        pytest.skip("of degree 2")
    check(split(terms.to_float(), *method), terms.to_float())
    if terms.n <= 12:
        check(split(terms, *method), terms)


def test_directions_and_permutations_of_the_user():
    terms = random_exact(4, 2, seed=3)
    b = [[1, 0], [1, 1], [1, 2], [1, 3]]
    with pytest.raises(ValueError, match="general position"):
        split(terms, "shears", directions=b)  # a minor is 0
    b = np.array(b) + 1
    b[:, 0] = 1
    parts = split(terms, "shears", directions=b)
    check(parts, terms)
    assert (parts.pieces[1].direction == b[:, 1]).all()
    orders = [[3, 2, 1, 0], [0, 1, 2, 3], [1, 3, 0, 2], [2, 1, 3, 0], [0, 3, 2, 1]]
    parts = split(terms, "exponentials", "triangular", permutations=orders)
    check(parts, terms)
    with pytest.raises(ValueError, match="no permutation places variable"):
        split(terms, off_diagonal="triangular", permutations=orders[:1])
    turn = [2, 0, 3, 1]
    for word in ("shears", "n+d"):
        turned, straight = split(terms, word, turn=turn), split(terms, word)
        check(turned, terms)
        assert len(turned.fields()[0] - straight.fields()[0])


# How many pieces


@pytest.mark.parametrize(("n", "d"), [(3, 2), (5, 2), (4, 3), (3, 4), (10, 1)])
def test_how_many_pieces_a_dense_field_has(n, d):
    terms = random_exact(n, d, seed=1, homogeneous=True)
    assert len(split(terms, "n+d").pieces) == n + d
    shears = split(terms, "shears", merged=False)
    assert [type(piece) for piece in shears.pieces] == [Shear] * d + [Natural] * n
    pieces = split(terms, "exponentials", merged=False).pieces
    exponentials = [piece for piece in pieces if isinstance(piece, Exponential)]
    assert len(exponentials) == comb(n + d - 2, d - 1)
    with_lower = split(random_exact(n, d, seed=1), "n+d")
    assert len(with_lower.pieces) == n + d


@pytest.mark.parametrize(("n", "d"), [(3, 2), (5, 2), (4, 3), (3, 4)])
def test_pairs_are_two_variables_by_small_roots_whatever_the_coefficients(n, d):
    for seed in range(3):
        terms = random_exact(n, d, seed, homogeneous=True)
        whole = [p for p in split(terms).pieces if isinstance(p, Exponential)]
        pairs = [p for p in split(terms, "pairs").pieces if isinstance(p, Exponential)]
        assert {*(p.monomial for p in pairs)} == {*(p.monomial for p in whole)}
        assert all(p.places.size == 2 and p.root for p in pairs if len({*p.monomial}) == 1)
        assert all(p.root == 1 for p in pairs if d == 2)
        assert any(p.root == 0 for p in whole)


def test_the_best_of_lattices():
    for n in range(6, 24):
        assert len(split(lorenz96(n)).pieces) == (3 if n % 3 == 0 else 4)
        assert [type(p) for p in split(volterra(n)).pieces] == [Scaling] * (2 + n % 2)
    assert len(split(lorenz96(5)).pieces) == 5
    assert [type(piece) for piece in split(toda(6)).pieces] == [Scaling, Natural]
    assert len(split(on_ring(1000, (1, (1, 31)), (-1, (-1, -31)))).pieces) == 2  # all odd
    assert len(split(on_ring(1000, (1, (1, 30)), (-1, (-1, -30)))).pieces) == 3


@pytest.mark.parametrize("sites", [100_001, pytest.param(1_000_001, marks=pytest.mark.slow)])
def test_very_many_sites(sites):
    terms = lorenz96(sites)
    parts = split(terms)
    assert [np.unique(p.terms.component).size for p in parts.pieces][:3] == [sites // 3] * 3
    assert len(parts.pieces) == 4
    assert parts.mismatch(terms) == 0


def test_regular_exponentials_never_blow_up():
    for terms in (random_exact(4, 2, 0), terms_of("bajer_moffatt"), terms_of("lv3_square")):
        parts = split(terms, "regular")
        assert not any(isinstance(piece, Exponential) for piece in parts.pieces)
    assert any(isinstance(p, Exponential) for p in split(terms, "exponentials").pieces)
    sparse = on_ring(30, (1, (0, 0)), (-2, (0, 1)))  # x_i' = x_i^2 - 2 x_i x_(i+1) ...
    sparse = sparse.joined(on_ring(30, (0, (0, 0)))).repaired()
    parts = split(sparse, "regular")
    check(parts, sparse)
    assert max(np.count_nonzero(p.direction) for p in parts.pieces if isinstance(p, Shear)) <= 5


def test_sparse_fields_of_high_degree_have_few_permutations():
    rng = np.random.default_rng(0)
    rows = np.array([rng.choice(40, 4, replace=False) for _ in range(60)])
    terms = Terms(40, rows[:, 0], rng.normal(size=60), rows[:, 1:])
    parts = split(terms, off_diagonal="triangular")
    check(parts, terms)
    assert len(parts.pieces) <= 3 < len(split(terms).pieces)


# The unique splitting, and directions

UNIQUE = REFERENCE["unique_nplusd_splittings"][0]


def scalar(n, rows):
    return Terms.of(n, [(0, c, factors) for c, factors in rows])


def test_the_unique_splitting_is_reproduced_exactly():
    terms = terms_of(UNIQUE["field"])
    parts = split(terms, "shears", directions=powers(5, 2), merged=False)
    shears, natural = parts.pieces[:2], parts.pieces[2:]
    for piece, rows in zip(shears, UNIQUE["g_diagonal"], strict=True):
        assert len(piece.g - scalar(5, rows)) == 0
    for i, (piece, rows) in enumerate(zip(natural, UNIQUE["natural"], strict=True)):
        assert len(piece.terms - Terms.of(5, [(i, c, factors) for c, factors in rows])) == 0


def test_the_unique_splitting_along_the_harmonic_frame():
    terms = terms_of(UNIQUE["field"]).to_float()
    parts = split(terms, "n+d")
    norms = sorted(norm(field) for field in parts.fields())
    assert norm(terms) == pytest.approx(UNIQUE["bombieri_norm_field"], rel=1e-14)
    assert norms == pytest.approx(UNIQUE["harmonic_frame_piece_bombieri_norms_sorted"], rel=1e-11)
    frame = harmonic(5, 2)
    for field in parts.fields():  # each is along one of the vectors of the frame
        values = field.evaluate(np.random.default_rng(0).normal(size=(20, 5)))
        u, s, _ = np.linalg.svd(values.T)
        assert s[1] < 1e-12 * s[0]
        assert np.abs(u[:, 0] @ (frame / np.linalg.norm(frame, axis=0))).max() > 1 - 1e-12


def test_the_splitting_of_degree_two_is_the_explicit_one():
    terms = random_exact(5, 2, seed=9, homogeneous=True)
    b = same_kind(along(5, 2), terms)
    g1, g2 = (piece.g for piece in split(terms, "shears", directions=b).pieces[:2])
    c = {(i, tuple(row)): value for i, value, row in zip(
        terms.component.tolist(), terms.coefficient, terms.variables.tolist(), strict=True,
    )}  # fmt: skip
    for i in range(5):
        for k in range(i):
            d = b[k, 0] * b[i, 1] - b[i, 0] * b[k, 1]
            first, second = c.get((k, (k, i)), 0), c.get((i, (k, i)), 0)
            here = [part.coefficient[(part.variables == [k, i]).all(axis=1)] for part in (g1, g2)]
            assert here[0] == (first * b[i, 1] - second * b[k, 1]) / d
            assert here[1] == (second * b[k, 0] - first * b[i, 0]) / d


@pytest.mark.parametrize(("n", "d"), [(3, 1), (4, 2), (7, 2), (5, 3), (4, 4), (9, 3)])
def test_directions_are_in_general_position(n, d):
    for is_exact in (False, True):
        both = np.concatenate([np.eye(n), along(n, d, is_exact).astype(float)], axis=1)
        for frame in (both, harmonic(n, d, is_exact).astype(float)):
            rng = np.random.default_rng(0)
            for _ in range(200):
                minor = frame[:, rng.choice(n + d, n, replace=False)]
                assert abs(np.linalg.det(minor)) > 1e-7


@pytest.mark.parametrize(
    ("n", "d", "method", "measured", "within"),
    [
        (10, 2, ("exponentials", "natural"), 4.1, 0.05),
        (10, 2, ("exponentials", "triangular"), 3.0, 0.05),
        (32, 2, ("exponentials", "natural"), 6.8, 0.03),
        (32, 2, ("exponentials", "triangular"), 3.4, 0.03),
        (32, 2, ("n+d", "natural"), 28, 0.05),
        (32, 2, ("shears", "natural"), 38, 0.2),  # 34: another order of the angles
        (10, 2, ("n+d", "natural"), 7.6, 0.35),  # small fields differ among themselves
        (10, 2, ("shears", "natural"), 13, 0.35),
        (10, 3, ("exponentials", "natural"), 6.0, 0.05),
        (10, 3, ("n+d", "natural"), 22, 0.35),
        (10, 3, ("shears", "natural"), 61, 0.5),
    ],
)
def test_growth_of_dense_fields(n, d, method, measured, within):
    seeds = range(2 if n < 32 else 1)  # large fields are all alike
    found = [growth(split(random_normal(n, d, seed), *method, merged=False)) for seed in seeds]
    assert np.mean(found) == pytest.approx(measured, rel=within)


def test_bad_directions_make_large_pieces():
    terms = random_normal(10, 3, 0)
    bad = growth(split(terms, "shears", directions=powers(10, 3).astype(float)))
    assert bad > 10 * growth(split(terms, "shears"))


# Affine parts, waves, time


def test_the_affine_part_is_one_piece_without_trace():
    terms = terms_of("random_d2_n3")
    first, *others = split(terms, linear="exact").pieces
    assert isinstance(first, Affine)
    low = terms.selected(terms.degrees <= 1)
    assert len(first.field() - low) == 0
    assert all((piece.field().degrees == 2).all() for piece in others)
    rotated = split(terms.to_float(), "n+d", linear="exact")
    assert isinstance(rotated.pieces[0], Affine)
    check(rotated, terms.to_float())


def test_waves_that_do_not_move_themselves_are_natural():
    flow = abc_flow(1, "1/2", 3)
    parts = split(flow)
    assert [type(piece) for piece in parts.pieces] == [Natural] * 3
    check(parts, flow)
    assert len(split(flow, off_diagonal="triangular").pieces) == 3


def cells(*extra):
    """Return cells (sin x cos y, -cos x sin y), and shears of z and x by other waves."""
    one = [Wave((v,), (1.0,), phase) for v in (0, 1) for phase in (SINE, 0.0)]
    rows = [(0, 1.0, (3, 6)), (1, -1.0, (4, 5)), (2, 0.5, (3,)), (0, 0.25, (2,)), *extra]
    return Terms.of(3, rows, tuple(one))


def test_waves_at_right_angles_to_their_amplitude_are_shears():
    parts = split(cells())
    shears = [piece for piece in parts.pieces if isinstance(piece, Shear)]
    assert len(shears) == 2
    check(parts, cells())
    with_factor = cells((0, 2.0, (2, 2, 3, 6)), (1, -2.0, (2, 2, 4, 5)))  # times z^2
    check(split(with_factor), with_factor)
    assert len([p for p in split(with_factor).pieces if isinstance(p, Shear)]) == 2


def test_other_waves_are_refused_by_name():
    sin_y, cos_y = Wave((1,), (1.0,), SINE), Wave((1,), (1.0,))
    terms = Terms.of(2, [(0, 1.0, (0, 3)), (1, -1.0, (2,))], (sin_y, cos_y))
    with pytest.raises(ValueError, match=r"terms sin\(v\) in v' are neither off-diagonal nor"):
        split(terms, names=["u", "v"])
    with pytest.raises(ValueError, match="the field has functions"):
        split(abc_flow(1, 1, 1), "n+d")


def test_time_is_a_variable_like_others():
    terms = Terms.of(3, [(0, 1, [1, 2]), (1, -1, [0, 2, 2]), (2, 1, [])])
    parts = split(terms)
    check(parts, terms)
    assert len(parts.pieces) == 3


# Refusals


def test_fields_with_a_divergence_are_refused_by_monomial():
    bad = [name for name in FIELDS if name not in GOOD]
    assert bad
    for name in bad:
        with pytest.raises(ValueError, match=r"the divergence of the field is not zero but 1 \* w"):
            split(terms_of(name), names=["u", "v", "w"])


@pytest.mark.parametrize(
    ("word", "options"),
    [
        ("diagonal must be one of", {"diagonal": "shear"}),
        ("off_diagonal must be one of", {"off_diagonal": "triangle"}),
        ("linear must be one of", {"linear": "both"}),
        ("runge_kutta must be one of", {"off_diagonal": "triangular", "runge_kutta": "gauss"}),
        (
            r"directions must have shape .*, not \(3, 1\)",
            {"diagonal": "shears", "directions": np.ones((3, 1))},
        ),
        (r"directions must have shape", {"diagonal": "n+d", "directions": np.ones((3, 4))}),
        ("not in general position", {"diagonal": "n+d", "directions": np.ones((3, 5))}),
        ("turn must be a permutation", {"diagonal": "shears", "turn": [0, 1]}),
        ("permutations must be rows", {"off_diagonal": "triangular", "permutations": [[0, 1]]}),
        (
            "not strictly lower",
            {"off_diagonal": "triangular", "runge_kutta": ([[1.0]], [1.0])},
        ),
        ("weights b sum to 2", {"off_diagonal": "triangular", "runge_kutta": ([[0]], [2])}),
    ],
)
def test_wrong_calls_are_refused(word, options):
    for terms in (terms_of("random_d2_n3"), terms_of("random_d2_n3").to_float()):
        with pytest.raises(ValueError, match=word):
            split(terms, **options)


def test_what_a_method_cannot_do_is_said():
    with pytest.raises(ValueError, match="degree 2, not 3"):
        split(terms_of("random_d3_n3"), "regular")
    planar = Terms.of(2, [(0, 1, [0, 0]), (1, -2, [0, 1])])
    with pytest.raises(ValueError, match="want 3 variables"):
        split(planar, "regular")
    with pytest.raises(ValueError, match="keeps a sparse field sparse"):
        split(volterra(20_000), "shears")
    with pytest.raises(ValueError, match="is too large"):
        split(volterra(20_000), "n+d")
    with pytest.raises(ValueError, match="linear='split'"):
        split(on_ring(20_000, (1, (1,))), linear="exact")


def test_a_field_of_nothing_has_no_pieces():
    for method in METHODS:
        parts = split(Terms.none(3), *method)
        assert parts.pieces == ()
        assert parts.mismatch(Terms.none(3)) == 0


def test_pieces_say_what_they_are():
    terms = terms_of("random_d2_n3")
    words = {
        described(piece, "xyz") for method in METHODS for piece in split(terms, *method).pieces
    }
    assert {"natural shear of x: 6 terms", "exponential of x, y, z by y"} <= words
    assert {each.split(" of ")[0].split(" in ")[0].split(" along ")[0] for each in words} == {
        "natural shear", "exponential", "scaling", "triangular", "shear",
    }  # fmt: skip
    assert all(piece.operations > 0 for piece in split(terms, "regular", "triangular").pieces)
    assert split(terms).pieces[0].functions == Fraction(3)


@pytest.mark.parametrize("method", ["shears", "n+d", "regular"])
def test_rounding_decides_nothing(method):
    """Terms that cancel are in no piece, however sums are rounded: BLAS differs by processor."""
    a, b = 0.8, -0.3
    rows = [(0, a, [0, 1]), (1, -a / 2, [1, 1]), (1, b, [0, 2]), (0, 1.0, [1]), (2, -a, [0])]
    field = Terms.of(3, [*rows, (2, 0.5, [0, 0, 1]), (0, 0.5, [2, 2])])
    forms = []
    for factor in np.random.default_rng(0).uniform(0.1, 10, 20):
        parts = split(field.scaled(factor), diagonal=method)
        forms.append([(p.field().component.tolist(), p.field().variables.tolist())
                      for p in parts.pieces])  # fmt: skip
        sizes = np.concatenate([np.abs(p.field().coefficient) for p in parts.pieces])
        assert sizes.min() > 1e-6 * sizes.max()
        assert parts.mismatch(field.scaled(factor)) < 1e-14
    assert all(form == forms[0] for form in forms)
