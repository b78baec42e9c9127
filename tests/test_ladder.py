"""The shears for the Schrödinger equation: their errors, their limits, and how they were made.

Everything is computed a second time with mpmath from the coefficients that the core gives out. A
sequence of shears is, on an eigenvector, the matrix K(x), x = step times eigenvalue.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf

from liouville import _core

HERE = Path(__file__).parent
REFERENCE = json.loads((HERE / "data" / "shears_reference.json").read_text(encoding="utf-8"))
LADDER = _core.ladder()
STABILITY = {
    (method["kind"], method["order"], method["stages"]): method for method in _core.stability()
}


@pytest.fixture(autouse=True)
def digits():
    with mp.workdps(50):
        yield


def stability_matrix(coefficients, x):
    a, b, c, d = mpf(1), mpf(0), mpf(0), mpf(1)
    for k, coefficient in enumerate(coefficients):
        step = mpf(coefficient) * x
        if k % 2 == 0:
            a, b = a + step * c, b + step * d
        else:
            c, d = c - step * a, d - step * b
    return mp.matrix([[a, b], [c, d]])


def rotation(x):
    return mp.matrix([[mp.cos(x), mp.sin(x)], [-mp.sin(x), mp.cos(x)]])


def distance(k, x):
    """Return the 2-norm of K - R(x), by its parts that turn and reflect."""
    off = k - rotation(x)
    turned = mp.hypot(off[0, 0] + off[1, 1], off[0, 1] - off[1, 0]) / 2
    return turned + mp.hypot(off[0, 0] - off[1, 1], off[0, 1] + off[1, 0]) / 2


def polynomial(coefficients):
    """Return p(z) by its coefficients, z = x^2, the trace of K halved."""
    rows = [[mpf(1)], [mpf(0)], [mpf(0)], [mpf(1)]]
    for k, c in enumerate(coefficients):
        to, source, sign = (0, 2, 1) if k % 2 == 0 else (2, 0, -1)
        for i in range(2):
            shifted = [mpf(0), *(sign * mpf(c) * y for y in rows[source + i])]
            mine = rows[to + i] + [mpf(0)] * (len(shifted) - len(rows[to + i]))
            shifted += [mpf(0)] * (len(mine) - len(shifted))
            rows[to + i] = [u + v for u, v in zip(mine, shifted, strict=True)]
    longest = max(len(rows[0]), len(rows[3]))
    a, d = (row + [mpf(0)] * (longest - len(row)) for row in (rows[0], rows[3]))
    return [(u + v) / 2 for u, v in zip(a[::2], d[::2], strict=True)]


def bound(method, fraction, steps):
    """Return what the tables promise of so many steps up to this fraction of theta."""
    place = int(np.searchsorted(method["fractions"], fraction))
    err, dphi, kappa = (mpf(float(method[key][place])) for key in ("err", "dphi", "kappa"))
    general = (1 + err) ** steps - 1
    return min(general, steps * dphi + kappa + kappa**2 / 2)


@pytest.mark.parametrize("method", LADDER, ids=lambda method: method["id"])
def test_errors_are_below_what_the_tables_promise(method):
    assert len(method["coefficients"]) == method["n"]
    chance = np.random.default_rng(method["n"])
    fractions = [chance.uniform(), 0.05, 1.0]
    middles = [k * mp.pi / method["theta"] for k in range(1, int(method["theta"] / np.pi) + 1)]
    beside = [middle * (1 + mpf(10) ** -6) for middle in middles[-2:-1]]
    for fraction in [*fractions, *middles[-1:], *beside]:
        x = fraction * mpf(method["theta"])
        k, turn = stability_matrix(method["coefficients"], x), x
        assert abs(k[0, 0] * k[1, 1] - k[0, 1] * k[1, 0] - 1) < mpf(10) ** -35
        for doublings in range(21):
            promised = bound(method, float(fraction), 2**doublings)
            if promised > 1:
                break
            assert distance(k, turn) <= promised, (float(fraction), doublings)
            k, turn = k * k, 2 * turn


def test_tables_are_not_more_careful_than_need_be():
    for method in LADDER[::20]:
        grid = [method["theta"] * mpf(k) / 125 for k in range(1, 126)]
        found = max(distance(stability_matrix(method["coefficients"], x), x) for x in grid)
        assert found > 0.95 * method["err"][-1], method["id"]


def test_stable_methods_stay_stable_for_a_million_steps():
    for method in (method for method in LADDER if method["stable"]):
        x = mpf(float(method["theta"])) * mpf(0.9371)
        k = stability_matrix(method["coefficients"], x)
        for _ in range(20):
            k = k * k
        square = mp.fsum(y**2 for y in k)
        growth = mp.sqrt((square + mp.sqrt(square**2 - 4)) / 2) - 1
        kappa = method["kappa"][-1]
        assert growth <= kappa * (1 + kappa) + 1e-9, method["id"]


@pytest.mark.parametrize(
    ("n", "theta", "is_stable"), [(4, 0.2326, True), (10, 0.2653, False), (24, 3.46, True)]
)
def test_the_generator_makes_what_is_shipped(n, theta, is_stable):
    from ladder import design

    made = design(n, theta, is_stable)
    shipped = next(m for m in LADDER if (m["n"], m["theta"]) == (n, theta))
    assert made.name == shipped["id"]
    mine, theirs = made.coefficients, shipped["coefficients"]
    for x in np.linspace(0.1, 1, 8) * theta:
        k, other = (stability_matrix(c, mpf(float(x))) for c in (mine, theirs))
        assert abs(k[0, 0] + k[1, 1] - other[0, 0] - other[1, 1]) < 1e-12
        assert abs(k[0, 1] - k[1, 0] - other[0, 1] + other[1, 0]) < 1e-12


def test_the_generator_refuses_where_no_shears_exist():
    from ladder import design

    with pytest.raises(ArithmeticError, match="change theta"):
        design(8, 4.0)


def test_shears_go_forwards_in_time():
    for method in STABILITY.values():
        for part in (method["coefficients"][::2], method["coefficients"][1::2]):
            assert abs(mp.fsum(mpf(c) for c in part) - 1) < 1e-14 * method["gain"]


@pytest.mark.parametrize("row", REFERENCE["stability_polynomials"], ids=lambda row: row["limit"])
def test_stability_polynomials_are_those_known(row):
    method = STABILITY["stability", row["order"], row["stages"]]
    assert abs(method["limit"] - mpf(row["limit"])) < 1e-14 * method["limit"]
    p = polynomial(method["coefficients"])
    for found, known in zip(p, row["p"] or [], strict=bool(row["p"])):
        # coefficients of shears are rounded to doubles
        assert abs(found / mpf(known) - 1) < 1e-13 * method["gain"]
    for z in row["touches"] or []:
        value = mp.polyval(p[::-1], mpf(z))
        assert abs(abs(value) - 1) < 1e-14 * method["gain"]


@pytest.mark.parametrize("row", REFERENCE["stability_shears"], ids=lambda row: str(row["stages"]))
def test_known_shears_have_the_same_polynomials(row):
    """The roots may be shared out in another way, which changes shears but not polynomials."""
    method = STABILITY["stability", row["order"], row["stages"]]
    known = [mpf(c) for pair in zip(row["a"], row["b"], strict=True) for c in pair]
    for mine, theirs in zip(polynomial(method["coefficients"]), polynomial(known), strict=True):
        assert abs(mine / theirs - 1) < 1e-13 * method["gain"]


@pytest.mark.parametrize("row", REFERENCE["gray_manolopoulos"], ids=lambda row: str(row["order"]))
def test_methods_of_an_order_have_it(row):
    order = row["order"]
    method = STABILITY["gray-manolopoulos", order, row["stages"]]
    assert abs(method["limit"] - float(row["limit"])) < 1e-12
    assert np.array_equal(method["coefficients"][::2], [float(a) for a in row["a"]])
    known = [mpf(c) for pair in zip(row["a"], row["a"][::-1], strict=True) for c in pair]
    x = mpf(1) / 1000
    near, far = (distance(stability_matrix(known, y), y) for y in (x, 2 * x))
    assert abs(mp.log(far / near, 2) - (order + 1)) < 0.01


def test_stability_polynomials_are_found_again():
    import stability
    from flint import ctx

    ctx.dps = 60
    p, touches = stability.polished(3, 5)
    method = STABILITY["stability", 6, 5]
    assert abs(float(stability.limit(p, touches)) - method["limit"]) < 1e-14
    for mine, theirs in zip(p.coeffs(), polynomial(method["coefficients"]), strict=True):
        assert abs(float(mine) / theirs - 1) < 1e-12
