"""Each field of the library preserves volume, keeps what it says, and reaches its references."""

from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from ordinary import solved

from liouville import problems
from liouville._systems import PolynomialField
from liouville._systems.fields.expand import expand
from liouville._systems.fields.terms import exact
from liouville.problems import euler2d, lorenz96, sabra, toda_lattice, volterra_lattice

FAMILIES = {
    "volterra_lattice of 3": volterra_lattice.build(3),
    "volterra_lattice of 8": volterra_lattice.build(8),
    "toda_lattice of 3": toda_lattice.build(3),
    "toda_lattice of 5": toda_lattice.build(5),
    "lorenz96 of 4": lorenz96.build(4),
    "euler2d up to 1": euler2d.build(1),
    "euler2d up to 3": euler2d.build(3),
    "sabra of 3": sabra.build(3),
    "sabra, other numbers": sabra.build(6).with_params({"eps": 0.25, "ratio": 1.5}),
    "goy": sabra.build(6, "goy"),
    "goy, other numbers": sabra.build(5, "goy").with_params({"eps": 0.75, "ratio": 4.0}),
}
SYSTEMS = {name: problems.load(name).system for name in problems.FIELDS} | FAMILIES

#: The largest error that the independent integrator may leave at a reference.
TOLERANCE = 1e-9


def polynomial(field, name):
    """Return an invariant's monomials and coefficients, with the field's own numbers."""
    observer = field._observer
    if observer._matrices[observer.names.index(name)][1] is not None:  # of Lorenz's model
        return {(i, i): Fraction(1, 2) for i in range(len(field.coordinates))}
    expressions, values = observer.expressions, field.values(None)
    inputs, column = tuple(expressions.symbols.all), expressions.columns[name]
    expansion, (found,) = expand(column, inputs, values, field.coordinates)
    assert expansion.is_exact
    return {monomial: value for monomial, (value, _) in found.items()}


def along(field, invariant):
    """Return the derivative of a polynomial along a field: f . grad I, exactly."""
    terms, rows = field.terms, {}
    coefficients = exact(terms.coefficient)
    for i, c, row in zip(terms.component, coefficients, terms.variables, strict=True):
        rows.setdefault(int(i), []).append((c, row[row >= 0].tolist()))
    found = {}
    for monomial, value in invariant.items():
        for i in set(monomial):
            rest = list(monomial)
            rest.remove(i)
            for c, factors in rows.get(i, []):
                product = tuple(sorted(rest + factors))
                found[product] = found.get(product, 0) + value * monomial.count(i) * c
    return {monomial: value for monomial, value in found.items() if value}


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_divergence_vanishes_exactly(name):
    terms = SYSTEMS[name].terms
    if not terms.functions:
        terms = replace(terms, coefficient=exact(terms.coefficient))
    assert len(terms.divergence()) == 0


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_is_conserved_is_so_exactly_and_no_others(name):
    field = SYSTEMS[name]
    constant = {i for i in field.invariants if not along(field, polynomial(field, i))}
    lost = {"sphere"} if name == "bajer_moffatt" else set()
    assert constant == set(field.invariants) - lost
    if name in problems.FIELDS:
        assert set(problems.load(name).conserved) == constant


def test_the_unit_sphere_is_invariant_in_the_bajer_moffatt_flow():
    field = SYSTEMS["bajer_moffatt"]
    sphere = polynomial(field, "sphere")
    six_y = {tuple(sorted((1, *monomial))): 6 * value for monomial, value in sphere.items()}
    assert along(field, sphere) == six_y


def integrated(field, x, times, params=None):
    """Integrate by an independent method to times after the start."""
    field = field.with_params(params)
    terms = field.terms.to_float()
    start = field.start({"x": x})
    return solved(lambda t, x: terms.evaluate(x), [0.0, *sorted(times)], start)[1:]


def miss(name, params=None):
    """Return the largest error at the references."""
    problem = problems.load(name)
    found = integrated(problem.system, problem.start["x"], problem.reference, params)
    expected = [problem.reference[t]["x"] for t in sorted(problem.reference)]
    assert max(problem.reference) == problem.interval[1]
    return abs(found - np.array(expected)).max()


@pytest.mark.parametrize("name", problems.FIELDS)
def test_an_independent_integrator_reaches_the_references(name):
    assert miss(name) < TOLERANCE


@pytest.mark.parametrize("name", problems.FIELDS)
def test_the_references_see_every_parameter(name):
    for parameter, value in problems.load(name).system.params.items():
        assert miss(name, {parameter: np.asarray(value) * (1 + 1e-5)}) > 1e3 * TOLERANCE


def test_references_of_a_ring_hold_for_its_repetition():
    field, start = lorenz96.build(72), lorenz96.start_for(72)
    found = integrated(field, start["x"], [1.0])[0]
    np.testing.assert_allclose(found, np.tile(lorenz96.reference[1.0]["x"], 2), rtol=0, atol=1e-10)


@pytest.mark.parametrize("n", [5, 24])
@pytest.mark.parametrize("name", ["volterra_lattice", "toda_lattice", "lorenz96", "sabra"])
def test_families_have_any_number_of_coordinates(name, n):
    problem = problems.load(name)
    field, start = problem.build(n), problem.start_for(n)
    assert field.start(start).shape == (len(field.coordinates),)
    with pytest.raises(ValueError, match="at least"):
        problem.build(2)


def test_modes_of_the_plane_are_half_of_all():
    for largest in (1, 2, 5):
        field, start = euler2d.build(largest), euler2d.start_for(largest)
        assert len(field.coordinates) == 4 * largest * (largest + 1)
        assert field.start(start).shape == (len(field.coordinates),)
    assert SYSTEMS["euler2d"].coordinates[:4] == ("a(1,0)", "b(1,0)", "a(2,0)", "b(2,0)")


def test_the_truncated_flow_is_that_of_the_vorticity():
    # the convolution against products in physical space, on a grid that resolves them
    largest, n = 2, 16
    field, rng = euler2d.build(largest), np.random.default_rng(2)
    x = rng.normal(size=len(field.coordinates))
    kept = euler2d.modes(largest)
    k = np.fft.fftfreq(n, 1 / n)
    k1, k2 = np.meshgrid(k, k, indexing="ij")
    omega = np.zeros((n, n), dtype=complex)
    for (a, b), z in zip(kept, x[::2] + 1j * x[1::2], strict=True):
        omega[a, b], omega[-a, -b] = z, z.conjugate()
    psi = -omega / np.where((k1 == 0) & (k2 == 0), 1, k1**2 + k2**2)

    def grid(spectrum):
        return np.fft.ifft2(spectrum).real * n**2

    advection = grid(-1j * k2 * psi) * grid(1j * k1 * omega)
    advection += grid(1j * k1 * psi) * grid(1j * k2 * omega)
    growth = -np.fft.fft2(advection) / n**2
    expected = np.array([growth[a, b] for a, b in kept])
    np.testing.assert_allclose(
        field.terms.to_float().evaluate(x),
        np.column_stack([expected.real, expected.imag]).ravel(),
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["lorenz96", "euler2d", "sabra", "euler_top"])
def test_no_variable_drives_itself(name):
    assert len(SYSTEMS[name].terms.diagonal()) == 0


def test_open_lattices_expand():
    n = 4

    def volterra(t, x, params):
        ends = ca.vertcat(0, x, 0)
        return x * (ends[2:] - ends[:-2])

    with pytest.raises(ValueError, match=r"div f contains -1 \* x0, 1 \* x3\n"):
        PolynomialField(volterra, x=n)

    def toda(t, x, params):
        a, b = ca.vertcat(0, x[: n - 1], 0), x[n - 1 :]
        return ca.vertcat(a[1:-1] * (b[1:] - b[:-1]), 2 * (a[1:] ** 2 - a[:-1] ** 2))

    with pytest.raises(ValueError, match=r"div f contains -1 \* x3, 1 \* x6\n"):
        PolynomialField(toda, x=2 * n - 1)


def test_an_unknown_shell_model_is_refused():
    with pytest.raises(ValueError, match="model must be 'sabra' or 'goy', not 'gledzer'"):
        sabra.build(8, "gledzer")
