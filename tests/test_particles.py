"""Charged particles: closed forms, orders, what is kept, derivatives, and what is refused."""

import pickle
import re

import casadi as ca
import numpy as np
import pytest
from ordinary import solved

import liouville as lv

V = lv.VolumeSplitting
X = [0.5, 0.1, 0.2, 0.3, 0.6, 0.2]


def bottle(t, x, params):
    """Return a magnetic bottle, without divergence."""
    return [-0.1 * x[0] * x[2], -0.1 * x[1] * x[2], params.b + 0.1 * x[2] ** 2]


def well(t, x, params):
    """Return a potential that is no polynomial, and holds positive charges along z."""
    return 0.05 * (x[2] ** 2 - ca.dot(x[:2], x[:2]) / 2) + 0.05 * ca.exp(-ca.dot(x, x))


def swaying(t, x, params):
    return (1 + 0.3 * ca.sin(t)) * well(t, x, params)


def particles(phi=well, c=None, **more):
    return lv.ChargedParticles(
        B=bottle, phi=phi, c=c, charge=1.5, mass=0.8, params={"b": 1.0}, **more
    )


def rates(system):
    """Return x' of a system as a function of t and x, from its own formula."""
    expressions = system.expressions
    function = ca.Function("f", expressions.symbols.all, [expressions.columns["field"]])
    values = system.values(None)
    return lambda t, x: np.array(function(t, x, values)).ravel()


def by_hand(system, phi, c):
    """Return x' of a system as a function of t and x, in numbers and differences of phi."""
    q, m, b = (system.params[name] for name in ("charge", "mass", "b"))

    def rate(t, state):
        x, u = state[:3], state[3:]
        step, weights = 1e-3 * np.eye(3), ((1, 45), (2, -9), (3, 1))

        def potential(x):
            return float(phi(t, ca.DM(x), None))

        slope = [
            sum(k * (potential(x + j * s) - potential(x - j * s)) for j, k in weights) / 0.06
            for s in step
        ]
        field = np.array([-0.1 * x[0] * x[2], -0.1 * x[1] * x[2], b + 0.1 * x[2] ** 2])
        v = u if c is None else u / np.sqrt(1 + u @ u / c**2)
        return np.concatenate([v, q / m * (-np.array(slope) + np.cross(v, field))])

    return rate


@pytest.mark.parametrize("c", [None, 2.0])
def test_rates_are_those_of_the_equations(c):
    system = particles(swaying, c)
    for t in (0.0, 1.3):
        found = rates(system)(t, X)
        assert np.abs(found - by_hand(system, swaying, c)(t, np.array(X))).max() < 1e-12
        row = system.extended(np.array([X]), t)
        assert np.abs(system.terms.evaluate(row)[0, :6] - found).max() < 1e-14


@pytest.mark.parametrize("c", [None, 2.0])
@pytest.mark.parametrize("phi", [well, swaying])
@pytest.mark.parametrize(
    ("method", "order", "steps"),
    [
        (V(composition="S2"), 2, 200),
        (V(composition="BM4"), 4, 100),
        (V(composition="BM6"), 6, 60),
        (V(composition="SS8s21"), 8, 30),
        (V(turn="boris", composition="S2"), 2, 400),
        (V(turn="boris", composition="SU4"), 4, 100),
        (V(turn="boris", composition="SS6s11"), 6, 100),
    ],
)
def test_steps_have_the_order_of_their_composition(method, order, steps, phi, c):
    system = particles(phi, c)
    run = {"t": (0, 10), "x": X}
    best = lv.integrate(system, V(composition="SS10s35"), steps=200, **run).x[-1]
    ends = [lv.integrate(system, method, steps=steps * k, **run).x[-1] for k in (1, 2)]
    errors = [np.abs(end - best).max() for end in ends]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.15


def test_a_run_follows_the_equations():
    for c in (None, 2.0):
        system = particles(swaying, c)
        exact = solved(rates(system), (0, 10), X)[-1]
        run = lv.integrate(system, V(composition="SS8s21"), t=(0, 10), steps=200, x=X)
        assert np.abs(run.x[-1] - exact).max() < 1e-11
        assert np.abs(run.x[-1] - X).max() > 0.5


@pytest.mark.parametrize("angle", [1e-9, 0.3, 1.0, 2.0, 3.0, 50.0])
def test_the_drift_across_e_and_b_is_exact_at_every_angle(angle):
    """In uniform fields v turns about its drift E x B / B^2, whatever the step."""
    crossed = lv.ChargedParticles(B=(0, 0, 2), E=(0.2, 0, 0))
    run = lv.integrate(crossed, V(), t=(0, 20 * angle / 2), steps=20, x=[0, 0, 0, 1, 0.3, 0.5])
    drift = np.array([0, -0.1])
    turned = np.exp(-2j * run.t) * (1 + 0.4j)
    found = run.x[:, 3] + 1j * (run.x[:, 4] - drift[1])
    assert np.abs(found - turned).max() < 1e-13 * max(1, angle)
    assert np.abs(run.x[:, 5] - 0.5).max() == 0
    drifting = [0, 0, 0, 0, -0.1, 0]
    boris = lv.integrate(crossed, V(turn="boris"), t=(0, 10 * angle), steps=20, x=drifting)
    assert np.abs(boris.x[:, 3:] - drifting[3:]).max() < 1e-13


def test_a_push_along_b_is_exact():
    system = lv.ChargedParticles(B=(0.6, 0, 0.8), E=(0.3, 0, 0.4), charge=-2.0, mass=0.5)
    run = lv.integrate(system, V(), t=(0, 5), h=0.25, x=[0, 0, 0, 0, 0, 0])
    along = run.x[:, 3:] @ [0.6, 0, 0.8]
    assert np.abs(along + 2 * run.t).max() < 1e-12
    assert np.abs(run.x[:, 3:] - np.outer(along, [0.6, 0, 0.8])).max() < 1e-13


def test_plain_cases_are_right():
    x = np.array([1.0, 2.0, 3.0, 0.5, -0.25, 0.125])
    free = lv.ChargedParticles()
    assert free.invariants == ("energy",)
    run = lv.integrate(free, V(), t=(0, 4), h=0.5, x=x)
    assert (run.x[-1] == [3, 1, 3.5, 0.5, -0.25, 0.125]).all()
    still = lv.integrate(
        lv.ChargedParticles(B=(0, 0, 1)), V(), t=(0, 4), h=0.5, x=[*x[:3], 0, 0, 0]
    )
    assert (still.x == [*x[:3], 0, 0, 0]).all()
    falling = lv.integrate(lv.ChargedParticles(E=(0, 0, -2)), V(), t=(0, 4), h=0.5, x=x)
    assert np.abs(falling.x[-1] - [3, 1, 3.5 - 16, 0.5, -0.25, 0.125 - 8]).max() < 1e-14
    for charge in (0.0, 1.0):  # a charge of 0 leaves no force, in either form of the fields
        for phi in (well, lambda t, x, params: x[2] ** 2):
            own = lv.integrate(particles(phi), V(), t=(0, 1), h=0.1, x=x, params={"charge": charge})
            is_free = np.abs(own.x[-1, :3] - x[:3] - x[3:]).max() < 1e-14
            assert is_free == (charge == 0)
    light = lv.ChargedParticles(B=(0, 0, 1), c=1.0)
    run = lv.integrate(light, V(), t=(0, 10), h=0.1, x=[0, 0, 0, 3.0, 0, 0])
    angle = -10 / np.sqrt(10)
    assert np.abs(run.x[-1, 3:] - [3 * np.cos(angle), 3 * np.sin(angle), 0]).max() < 1e-13


@pytest.mark.parametrize("turn", ["exact", "boris"])
@pytest.mark.parametrize("c", [None, 2.0])
def test_a_step_keeps_volume_and_is_undone(c, turn):
    for phi, h in ((well, 0.1), (swaying, 0.1), (well, 1.5)):
        system, method = particles(phi, c), V(turn=turn)
        found = lv.analysis.determinant(
            system, method, t=(0, 100 * h), h=h, every=100, x=X
        ).observed
        assert found["defect"][-1] < 1e-13
        there = lv.integrate(system, method, t=(0, 10 * h), h=h, x=X)
        back = lv.integrate(system, method, t=(10 * h, 0), h=h, x=there.x[-1])
        assert np.abs(back.x[-1] - X).max() < 1e-12


def test_energy_is_kept_to_roundoff_without_e_and_bounded_in_a_bottle():
    alone = lv.ChargedParticles(B=bottle, params={"b": 1.0})
    run = lv.integrate(alone, V(), t=(0, 5000), h=0.6, every=50, x=X)
    assert run.invariant_drift("energy").max() < 1e-13
    fast = lv.ChargedParticles(B=bottle, params={"b": 1.0}, c=0.7)
    run = lv.integrate(fast, V(), t=(0, 5000), h=0.6, every=50, x=X)
    assert run.invariant_drift("energy").max() < 1e-13
    held = lv.integrate(particles(), V(), t=(0, 5000), h=0.3, every=10, x=X)
    drift = np.abs(held.invariants["energy"] - held.invariants["energy"][0])
    early, late = drift[: len(drift) // 20].max(), drift[-len(drift) // 20 :].max()
    assert 0 < late < 2 * early < 1e-6


def tokamak(t, x, params):
    """Return B of psi = ((R - 1)^2 + Z^2)/4 and R B_phi = 1."""
    r = ca.sqrt(x[0] ** 2 + x[1] ** 2)
    along, out, up = 1 / r, -x[2] / (2 * r), (r - 1) / (2 * r)
    return [(out * x[0] - along * x[1]) / r, (out * x[1] + along * x[0]) / r, up]


def momentum(t, x, params):
    """Return the canonical momentum about the axis."""
    r = ca.sqrt(x[0] ** 2 + x[1] ** 2)
    return x[0] * x[4] - x[1] * x[3] + ((r - 1) ** 2 + x[2] ** 2) / 4


def test_a_banana_orbit_is_one_for_three_hundred_bounces():
    """Ten steps of BM4 a gyration keep the momentum about the axis to 1e-5, without a trend.

    The energy has the random roundings of three million turns.
    """
    ring = lv.ChargedParticles(B=tokamak, invariants={"momentum": momentum})
    start = [1.05, 0, 0, 0, 4.816e-4, -2.059e-3]
    run = lv.integrate(ring, V(), t=(0, 3e5), h=0.6, every=100, x=start)
    assert run.invariant_drift("energy").max() < 5e-13
    apart = np.abs(run.invariants["momentum"] / run.invariants["momentum"][0] - 1)
    tenth = len(apart) // 10
    assert apart[-tenth:].max() < 1.5 * apart[:tenth].max() < 1e-4
    radius, along = np.hypot(run.x[:, 0], run.x[:, 1]), run.x[:, 0] * run.x[:, 4]
    along = (along - run.x[:, 1] * run.x[:, 3]) / radius
    assert 1.0 < radius.min() < 1.02
    assert 1.05 < radius.max() < 1.1
    assert along.min() < -3e-4 < 3e-4 < along.max()  # it turns back


def test_the_drift_of_a_gradient_has_the_order_of_the_step():
    field = lv.ChargedParticles(B=lambda t, x, params: [0, 0, 1 + 0.02 * x[0]])
    start, t = [0.0, 0, 0, 0, 1.0, 0], 200 * np.pi
    best = lv.integrate(field, V(composition="SS8s21"), t=(0, t), h=0.2, x=start).x[-1]
    assert abs(best[1] / t - 0.01) < 1e-3  # v^2 B'/(2 B^2)
    for composition, h, error in (("S2", 0.3, 8e-3), ("BM4", 0.5, 1e-5), ("BM4", 1.0, 1.6e-4)):
        found = lv.integrate(field, V(composition=composition), t=(0, t), h=h, x=start).x[-1]
        assert abs(found[1] / best[1] - 1) < 2 * error


@pytest.mark.parametrize("turn", ["exact", "boris"])
@pytest.mark.parametrize("c", [None, 2.0])
def test_derivatives_are_those_of_the_discrete_run(c, turn):
    wrt = ["x", "params.charge", "params.mass", "params.b", "t0", "t1"]
    wrt += ["params.c"] if c else []
    for phi in (swaying, None):
        found = lv.analysis.check_gradient(
            particles(phi, c), V(turn=turn), wrt=wrt, t=(0.2, 3), steps=15, x=X, seed=1
        )
        assert found.dot < 1e-13
        assert found.differences < 1e-8


@pytest.mark.parametrize("phi", [well, None])
@pytest.mark.parametrize("c", [None, 2.0])
def test_members_have_the_bits_of_runs_of_their_own(c, phi):
    system, starts = particles(phi, c), np.random.default_rng(0).normal(size=(37, 6)) / 2
    for h in (0.2, 6.0):  # of small and of large angles, side by side
        many = lv.ensemble(system, V(), t=(0, 10 * h), h=h, x=starts)
        for member in (0, 17, 36):
            own = lv.integrate(system, V(), t=(0, 10 * h), h=h, x=starts[member])
            assert (own.x == many.x[:, member]).all()
    charges = [1.0, -1.0, 0.0]
    varied = lv.ensemble(system, V(), t=(0, 2), h=0.2, x=starts[:3], params={"charge": charges})
    for member, charge in enumerate(charges):
        start, params = starts[member], {"charge": charge}
        own = lv.integrate(system, V(), t=(0, 2), h=0.2, x=start, params=params)
        assert (own.x == varied.x[:, member]).all()


def test_what_runs_with_a_field_runs_with_particles():
    system = particles()
    run = lv.integrate(system, V(), t=(0, 5), h=0.1, x=X)
    again = pickle.loads(pickle.dumps(system))
    assert (lv.integrate(again, V(), t=(0, 5), h=0.1, x=X).x == run.x).all()
    other = lv.integrate(again, V(), t=(0, 5), h=0.1, x=X, params={"b": 2.0})
    assert (other.x[-1] != run.x[-1]).all()
    plan = lv.plan(system, h=0.1, x=X)
    assert plan.pieces == ("turn and push of vx, vy, vz", "natural shear of x, y, z: 3 terms")
    assert "steps a gyration" in str(plan)
    assert (lv.integrate(system, plan, t=(0, 5), h=0.1, x=X).x == run.x).all()
    exact = lv.integrate(system, V(composition="SS8s21"), t=(0, 5), steps=200, x=X)
    close = lv.integrate(system, V(), t=(0, 5), rtol=1e-8, x=X)
    assert np.abs(close.x[-1] - exact.x[-1]).max() < 1e-7
    cuts = lv.section(system, V(), t=(0, 20), h=0.1, plane="z", x=[X])
    assert len(cuts) == 2
    assert np.abs(cuts.x[:, 2]).max() < 1e-14
    total = lv.analysis.lyapunov(system, V(), t=(0, 20), h=0.1, x=X).exponents.sum()
    assert abs(total) < 1e-12


def test_potentials_are_the_fields_that_they_make():
    def a(t, x, params):
        return [0.1 * x[1] * x[2] ** 2, x[0] * (1 + 0.2 * ca.sin(t)), ca.cos(x[0])]

    def curl(t, x, params):
        return [0, 0.2 * x[1] * x[2] + ca.sin(x[0]), 1 + 0.2 * ca.sin(t) - 0.1 * x[2] ** 2]

    def electric(t, x, params):
        return [-x[0], -0.2 * x[0] * ca.cos(t), 0]

    one = lv.ChargedParticles(A=a, phi=lambda t, x, params: x[0] ** 2 / 2)
    other = lv.ChargedParticles(B=curl, E=electric)
    ends = [lv.integrate(x, V(), t=(0, 5), h=0.1, x=X).x[-1] for x in (one, other)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-13
    assert one.is_driven
    assert one.invariants == other.invariants == ()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"B": (0, 0, 1), "A": lambda t, x, params: x}, "B is given, and A too"),
        ({"E": (0, 0, 1), "phi": lambda t, x, params: x[0]}, "E is given, and phi too"),
        ({"B": (0, 1)}, "B must be a function or three finite numbers, not (0, 1)"),
        ({"E": lambda t, x, params: x[0]}, "E must return 3 values, not 1"),
        ({"mass": 0.0}, "the mass must be positive, not 0"),
        ({"c": -1.0}, "the speed of light c must be positive, not -1"),
        ({"charge": [1.0, 2.0]}, "charge must be a number, not [1.0, 2.0]"),
        ({"params": {"mass": 2.0}}, "'mass' is a parameter already"),
        ({"x": ("x", "y", "z")}, "x must name six coordinates, positions first, not 3"),
    ],
)
def test_what_makes_no_particles_is_refused(given, words):
    with pytest.raises((TypeError, ValueError), match=re.escape(words)):
        lv.ChargedParticles(**given)


def test_methods_that_are_for_other_fields_are_refused():
    run = {"t": (0, 1), "h": 0.1, "x": X}
    for method, words in (
        (V(turn="boris", composition="BM4"), "Boris's turn must be composed by a scheme of sym"),
        (V(diagonal="shears"), "diagonal= is for polynomial fields"),
    ):
        with pytest.raises((TypeError, ValueError), match=words):
            lv.integrate(particles(), method, **run)
    rotor = lv.PolynomialField(lambda t, x, params: [x[1], -x[0]], x=2)
    with pytest.raises(TypeError, match="turn= is for charged particles"):
        lv.integrate(rotor, V(turn="boris"), t=(0, 1), h=0.1, x=[1, 0])
    plan = lv.plan(rotor, h=0.1, x=[1, 0])
    with pytest.raises(ValueError, match="the plan must be for charged particles"):
        lv.integrate(particles(), plan, **run)
    with pytest.raises(ValueError, match="the plan must be for a field"):
        lv.integrate(rotor, lv.plan(particles(), h=0.1, x=X), t=(0, 1), h=0.1, x=[1, 0])


def test_a_field_that_is_singular_ends_the_run_by_name():
    system = lv.ChargedParticles(E=lambda t, x, params: [1 / x[0], 0, 0])
    with pytest.raises(lv.IntegrationError, match="E") as error:
        lv.integrate(system, V(), t=(0, 1), h=0.1, x=[0, 0, 0, 0, 0, 0])
    assert error.value.step == 0


def test_gyrations_of_too_few_steps_are_said():
    """B grows along z to four times that of the start."""
    system = lv.ChargedParticles(
        A=lambda t, x, params: [-x[1] / 2 * (1 + x[2] ** 2), x[0] / 2 * (1 + x[2] ** 2), 0]
    )
    start = [0, 0, 0, 0.01, 0, 1]
    run = {"t": (0, 1.8), "x": start}
    assert lv.integrate(system, V(), h=0.3, **run).message == ""
    said = lv.integrate(system, V(), h=0.6, **run).message
    assert re.match(r"a gyration has 2\.\d+ steps at t = 1.8, and orbits want 4 at least", said)
    longest = float(said.rsplit(" ", 1)[1])
    assert longest == pytest.approx(2 * np.pi / 4 / (1 + 1.8**2), rel=0.02)
    many = lv.ensemble(
        system, V(), t=(0, 0.6), h=0.6, x=start, params={"mass": [1.0, 0.2], "charge": 1.0}
    )
    assert "a gyration of member 1 has" in many.message


def test_fields_on_grids_are_those_of_their_potentials():
    """A tokamak's flux, an electric potential and a field in time, by tables against formulas."""
    r, z = np.linspace(0.6, 1.4, 33), np.linspace(-0.4, 0.4, 33)

    def shape(r, z, exp):
        return ((r - 1) ** 2 + z**2) / 4 * exp(-z)

    grids = np.meshgrid(r, z, indexing="ij")
    flux = lv.table((r, z), shape(*grids, np.exp), "not-a-knot")
    volts = lv.table((r, z), 1e-7 * np.cos(3 * grids[0]) * grids[1], "not-a-knot")

    def particles(flux, volts):
        def potential(t, x, params):
            r = ca.sqrt(x[0] ** 2 + x[1] ** 2)
            around = flux(r, x[2]) / r
            return [-around * x[1] / r, around * x[0] / r, -ca.log(r)]

        def electric(t, x, params):
            return volts(ca.sqrt(x[0] ** 2 + x[1] ** 2), x[2])

        return lv.ChargedParticles(A=potential, phi=electric)

    on_grid = particles(flux, volts)
    by_formula = particles(lambda r, z: shape(r, z, ca.exp), lambda r, z: 1e-7 * ca.cos(3 * r) * z)
    start = [[1.05, 0, 0, 0, 4e-4, 3e-4], [0.9, 0, 0.1, 2e-4, 0, 4e-4]]
    runs = [
        lv.ensemble(system, V(composition="BM4"), t=(0, 1200), h=0.6, every=100, x=start)
        for system in (on_grid, by_formula)
    ]
    moved = np.abs(runs[1].x[-1] - runs[1].x[0])[:, :3].max()
    assert moved > 0.1
    assert np.abs(runs[0].x - runs[1].x)[..., :3].max() < 1e-4 * moved
    # the energy of the spline's own field is bounded, and volume is kept
    assert runs[0].invariant_drift("energy").max() < 1e-6
    defect = lv.analysis.determinant(on_grid, V(), t=(0, 60), h=0.6, x=start[0]).observed["defect"]
    assert defect.max() < 1e-13


def test_a_particle_that_leaves_its_grid_is_told_so():
    x = np.linspace(-1, 1, 9)
    one = lv.table((x, x), np.ones((9, 9)), "natural")
    system = lv.ChargedParticles(B=lambda t, x, params: [0, 0, one(x[0], x[1])])
    run = lv.integrate(system, V(), t=(0, 3), h=0.1, x=[0, 0, 0, 0.5, 0, 0])
    assert run.x[-1, :2] == pytest.approx([0.5 * np.sin(3), 0.5 * (np.cos(3) - 1)], abs=1e-7)
    with pytest.raises(lv.IntegrationError, match=r"B is not finite(.|\n)*end of a table"):
        lv.integrate(system, V(), t=(0, 3), h=0.1, x=[0, 0, 0, 2.0, 0, 0])
