"""Fields by their vector potential: volume, orders, derivatives, and what is refused."""

import pickle

import casadi as ca
import numpy as np
import pytest
import xarray
from ordinary import solved

import liouville as lv

V = lv.VolumeSplitting
X = [0.3, 0.2, -0.4]


def in_space(t, x, params):
    """Return a potential that is no sum of waves, with time and parameters."""
    x, y, z = ca.vertsplit(x)
    return [
        params.a * ca.sin(y + z) / (2 + ca.cos(x) * ca.sin(z)),
        ca.tanh(ca.sin(x - z)) / (1.5 + ca.cos(y)),
        ca.log(2 + ca.cos(x) * params.b[0] * ca.sin(y)) * (1 + params.b[1] * ca.cos(t)),
    ]


def space():
    return lv.PotentialField(in_space, x=("x", "y", "z"), params={"a": 1.0, "b": [0.9, 0.3]})


def plane():
    """Return a steady flow whose stream function is no product."""

    def psi(t, x, params):
        return ca.log(1 + x[0] ** 2 + 2 * x[1] ** 2 + x[0] * x[1] ** 2)

    return lv.PotentialField(psi, x=("x", "y"), invariants={"psi": psi})


def test_the_velocity_is_the_curl_and_a_run_follows_it():
    field, d = space(), 1e-3
    point, t = np.array(X), 0.7

    def slope(j):
        step = d * np.eye(3)[j]
        ends = [field.potential(point + k * step, t) - field.potential(point - k * step, t)
                for k in (1, 2, 3)]  # fmt: skip
        return (45 * ends[0] - 9 * ends[1] + ends[2]) / (60 * d)

    by = np.array([slope(j) for j in range(3)])  # by[j, k] = dA_k/dx_j
    curl = [by[1, 2] - by[2, 1], by[2, 0] - by[0, 2], by[0, 1] - by[1, 0]]
    assert np.abs(field.velocity(point, t) - curl).max() < 1e-12
    run = lv.integrate(field, V(composition="BM6"), t=(0, 4), steps=400, x=X)
    exact = solved(lambda t, x: field.velocity(x, t), (0, 4), X)[-1]
    assert np.abs(run.x[-1] - exact).max() < 1e-12
    assert np.abs(run.x[-1] - X).max() > 1


@pytest.mark.parametrize(("name", "order"), [("S2", 2), ("BM4", 4), ("BM6", 6)])
def test_steps_have_the_order_of_their_composition(name, order):
    field, run = space(), {"t": (0, 4), "x": X}
    best = lv.integrate(field, V(composition="SS10s35"), steps=400, **run).x[-1]
    ends = [
        lv.integrate(field, V(composition=name), steps=20 * 2**k, **run).x[-1] for k in range(4)
    ]
    slopes = -np.diff(np.log2([np.abs(end - best).max() for end in ends]))
    assert np.abs(slopes - order).max() < 0.1
    assert abs(slopes[-1] - order) < 0.02


@pytest.mark.parametrize("make", [space, plane])
def test_a_step_keeps_volume_and_is_undone(make):
    field = make()
    start = X[: len(field.coordinates)]
    found = lv.analysis.determinant(field, V(), t=(0, 100), h=0.1, every=1000, x=start).observed
    assert found["defect"][-1] < 2e-14
    assert abs(found["log_determinant"][-1]) < 1e-12
    there = lv.integrate(field, V(), t=(0, 10), h=0.1, x=start)
    back = lv.integrate(field, V(), t=(10, 0), h=0.1, x=there.x[-1])
    assert np.abs(back.x[-1] - start).max() < 1e-12


def test_volume_is_kept_over_a_hundred_thousand_steps():
    found = lv.analysis.determinant(space(), V(), t=(0, 1e4), h=0.1, every=10**5, x=X).observed
    assert found["defect"][-1] < 1e-12
    assert abs(found["log_determinant"][-1]) < 1e-11


def test_a_steady_stream_function_does_not_drift():
    field = plane()
    psi = lv.integrate(field, V(), t=(0, 2000), h=0.1, every=20, x=[0.3, 0.2]).invariants["psi"]
    early, late = (np.abs(part - psi[0]).max() for part in (psi[:200], psi[-200:]))
    assert 0 < late < 2 * early < 1e-4


def test_field_lines_of_a_stellarator_stay_on_their_tubes():
    """The flux turns five times around the axis; RK4 loses a hundredth in a longer run."""

    def flux(t, x, params):
        q, phi, z = ca.vertsplit(x)
        across = ca.sqrt(2 * q) - 1
        turning = (across**2 - z**2) * ca.cos(5 * phi) + 2 * across * z * ca.sin(5 * phi)
        return {"phi": turning / 2, "Z": -ca.log(2 * q) / 2}

    field, period = lv.PotentialField(flux, x=("q", "phi", "Z")), 2 * np.pi
    start = [[1.08**2 / 2, 0.0, 0.0]]
    points = lv.section(field, V(), t=(0, 1500), h=0.1, plane="phi", period=period, x=start).x
    across, third = np.sqrt(2 * points[:, 0]) - 1, len(points) // 3
    angle, radius = np.arctan2(points[:, 2], across), np.hypot(across, points[:, 2])
    columns = np.array([f(k * angle) for k in range(8) for f in (np.cos, np.sin)]).T
    curve = np.linalg.lstsq(columns[:third], radius[:third], rcond=None)[0]
    apart = (radius - columns @ curve) / radius
    assert abs(apart[-third:].mean()) < 1e-4
    assert abs(apart).max() < 1e-2


def test_derivatives_are_those_of_the_discrete_run():
    field = space()
    found = lv.analysis.check_gradient(
        field, V(), wrt=["x", "params.a", "params.b", "t0", "t1"], t=(0.2, 3), steps=20, x=X,
        size=1e-3,
    )  # fmt: skip
    assert found.dot < 1e-13
    assert found.differences < 1e-8
    run = lv.integrate(field, V(), t=(0, 3), h=0.1, x=X, tangents={"params.b": [0.0, 1.0]})
    d = 1e-3
    ends = [
        lv.integrate(field, V(), t=(0, 3), h=0.1, x=X, params={"b": [0.9, 0.3 + k * d]}).x[-1]
        for k in (-2, -1, 1, 2)
    ]
    slope = (8 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12 * d)
    assert np.abs(run.tangents["params.b"].x[-1] - slope).max() < 1e-9


def test_members_are_single_runs_with_parameters_of_their_own():
    field, a = space(), np.array([0.8, 1.0, 1.3])
    starts = np.random.default_rng(3).normal(size=(3, 3))
    many = lv.ensemble(field, V(), t=(0, 3), h=0.1, x=starts, params={"a": a}, threads=2)
    for k in range(3):
        one = lv.integrate(field, V(), t=(0, 3), h=0.1, x=starts[k], params={"a": a[k]})
        assert np.array_equal(one.x, many.x[:, k])
    together = lv.ensemble(field, V(), t=(0, 3), h=0.1, x=starts)
    assert np.array_equal(together.x[:, 1], many.x[:, 1])


def test_a_member_without_a_solution_fails_alone():
    def psi(t, x, params):
        return ca.sqrt(x[0]) + 50 * x[0] * x[1] ** 2

    field = lv.PotentialField(psi, x=("x", "y"))
    starts = [[1.0, 0.02], [-1.0, 0.02], [1.0, 8.0]]
    many = lv.ensemble(field, V(), t=(0, 0.05), h=0.01, x=starts)
    assert set(many.failures) == {1, 2}
    assert "potential of the plane of x and y is not finite" in str(many.failures[1])
    assert "the velocity changes too much within the step" in str(many.failures[2])


def test_steps_that_pass_a_vortex_are_refused_where_no_mixed_derivative_shows_it():
    """On an axis it is zero, and a member would end far off its circle."""
    vortex = lv.PotentialField(lambda t, x, params: ca.log(ca.dot(x, x)) / 2, x=("x", "y"))
    run = {"t": (0, 1), "h": 0.01}
    for start in ([0, 1e-3], [1e-3, 0], [0, 0.05]):
        with pytest.raises(
            ValueError, match=r"a step of 0\.01 is too long for this field and start"
        ):
            lv.integrate(vortex, V(), x=start, **run)
    longest = 0.9 * 0.2**2 / 0.3667132690474256
    with pytest.raises(ValueError, match=f"up to {0.99 * longest:.3g}$"):
        lv.integrate(vortex, V(), t=(0, 1), h=0.1, x=[0, 0.2])
    fine = lv.integrate(vortex, V(), x=[0, 0.2], **run)
    assert np.abs(np.hypot(*fine.x.T) / 0.2 - 1).max() < 1e-4
    assert fine.message == ""
    many = lv.ensemble(vortex, V(), x=[[0, 1.0], [0, 1e-3]], **run)
    assert "steps of member 1 are too long for the field at t = 0" in many.message
    # along its way it comes to where no step can be taken
    jump = lv.PotentialField(
        lambda t, x, params: x[1] + x[1] ** 2 * ca.exp(-((x[0] - 1) ** 2) * 100) * 50, x=2
    )
    with pytest.raises(ValueError, match="too long for this field and start"):
        lv.integrate(jump, V(), t=(0, 2), h=1.0, x=[0.0, 0.01])


def test_steps_that_become_too_long_are_said():
    """Near its middle a vortex turns ever faster, and no equation of a plane shows it."""

    def psi(t, x, params):
        return ca.exp(t) * ca.sin(x[0]) * ca.sin(x[1])

    field, start = lv.PotentialField(psi, x=("x", "y")), [np.pi / 2 + 1e-3, np.pi / 2]
    assert lv.integrate(field, V(), t=(0, 3), h=0.1, x=start).message == ""
    found = lv.integrate(field, V(), t=(0, 4), h=0.1, x=start)
    assert "steps are too long for the field at t = 3.3, and states from there on" in found.message
    assert "give h up to 0.0445" in found.message
    separable = lv.PotentialField(lambda t, x, params: 1e6 * x[0] ** 2 + ca.cosh(x[1]), x=2)
    assert lv.integrate(separable, V(), t=(0, 1), h=1e-3, x=[1e-3, 0]).message == ""


def test_times_events_sections_and_a_tolerance():
    field = space()
    times = [0.05, 1.23, 2.9]
    at = lv.integrate(field, V(composition="BM6"), t=(0, 3), h=0.1, x=X, t_eval=times)
    exact = solved(lambda t, x: field.velocity(x, t), [0, *times], X)[1:]
    assert np.abs(at.x - exact).max() < 2e-7
    met = lv.integrate(
        field, V(), t=(0, 3), h=0.1, x=X,
        events={"up": lv.Event(lambda t, x, params: x[2] + 1.5, terminal=True)},
    )  # fmt: skip
    assert abs(met.x[-1, 2] + 1.5) < 1e-10
    flat = lv.section(plane(), V(), t=(0, 60), h=0.1, plane="y", x=[[0.3, 0.2]])
    assert len(flat.x) > 3
    controlled = lv.integrate(field, V(), t=(0, 3), rtol=1e-7, x=X)
    assert np.abs(controlled.x[-1] - lv.integrate(
        field, V(composition="BM6"), t=(0, 3), steps=600, x=X).x[-1]).max() < 1e-7  # fmt: skip


def dipole(t, x, params):
    """Return the vector potential of a dipole along z."""
    return [part / ca.norm_2(x) ** 3 for part in (-x[1], x[0], 0 * x[0])]


def test_lines_that_run_into_a_singularity_are_ended_by_an_event(tmp_path):
    """In sections too; what fails says what it is, since no step is short enough."""
    field, run = lv.PotentialField(dipole, x=("x", "y", "z")), {"t": (0, 20), "plane": "z"}
    for h in (0.02, 0.005):
        with pytest.raises(lv.IntegrationError, match="velocity changes too much within") as caught:
            lv.integrate(field, V(), t=(0, 20), h=h, x=[1.5, 0.0, 0.5])
        assert "a path that runs into a singularity has to end before it" in str(caught.value)
    near = {"near": lv.Event(lambda t, x, params: ca.dot(x, x) - 0.36, terminal=True)}
    starts = [[1.5, 0.0, 0.5], [1.4, 0.0, -0.5], [1.4, 0.2, 0.5]]
    found = lv.section(field, V(), h=0.01, x=starts, events=near, **run)
    assert [*found.member] == [0, 2]
    assert not found.failures
    assert set(found.endings) == {0, 1, 2}
    assert "3 ended by events" in repr(found)
    met = found.events["near"]
    assert np.sum(met.x**2, axis=-1) == pytest.approx(0.36, abs=1e-12)
    data = found.to_xarray()
    assert (data.x.values == found.x).all()
    assert (data.t.values == found.t).all()
    assert data.event_t_near.size == 3
    found.save(tmp_path / "section.nc")
    with xarray.open_dataset(tmp_path / "section.nc") as opened:
        assert (opened.member.values == found.member).all()
        assert list(opened.coordinate.values) == ["x", "y", "z"]
        assert "near" in opened.endings
    found.save(tmp_path / "section.csv")
    rows = np.loadtxt(tmp_path / "section.csv", delimiter=",", skiprows=1)
    assert (rows == np.column_stack([found.member, found.t, found.x])).all()
    with pytest.raises(ValueError, match=r"not saved to 'a.xyz'\nhint: use one of .nc, .csv"):
        found.save("a.xyz")
    # z = 0 is where r = L, of the lines r = L sin^2
    r, rho = np.linalg.norm(starts, axis=1), np.hypot(*np.array(starts).T[:2])
    assert np.linalg.norm(found.x, axis=1) == pytest.approx((r**3 / rho**2)[[0, 2]], rel=1e-5)


@pytest.mark.parametrize("direction", ["both", "up", "down"])
@pytest.mark.parametrize("t", [(0, 30), (30, 0)])
def test_events_beside_a_section_change_nothing_of_it(direction, t):
    eyes = lv.PotentialField(
        lambda t, x, params: ca.log(ca.cosh(x[1]) + 0.5 * ca.cos(x[0])), x=("x", "y")
    )
    run = {
        "t": t, "h": 0.1, "plane": "x", "period": 2 * np.pi, "offset": 0.3, "direction": direction,
        "x": [[0.1, 1.5], [0.2, -1.2], [2.0, 0.1]],
    }  # fmt: skip
    beside = {"seen": lv.Event(lambda t, x, params: x[1] - 1.4)}
    one, other = lv.section(eyes, V(), **run), lv.section(eyes, V(), events=beside, **run)
    assert len(one) > 3
    assert (one.member == other.member).all()
    assert np.abs(one.x - other.x).max() < 1e-13
    assert np.abs(one.t - other.t).max() < 1e-12
    with pytest.raises(ValueError, match="'plane' is the event of the section itself"):
        lv.section(eyes, V(), events={"plane": beside["seen"]}, **run)
    strobe = run | {"plane": "t", "direction": "both"}
    with pytest.raises(ValueError, match="is for planes and surfaces, and plane='t' is none\nhint"):
        lv.section(eyes, V(), events=beside, **strobe)


def test_flows_without_an_iteration_are_explicit():
    """A separable potential needs no iteration, and the plan says so."""
    field = lv.PotentialField(lambda t, x, params: x[0] ** 2 / 2 + ca.cosh(x[1]), x=("x", "y"))
    plan = lv.plan(field, h=0.1, x=[0.1, 0.2])
    assert "1 of the flows need no iteration" in str(plan)
    again = lv.integrate(field, plan, t=(0, 1), h=0.1, x=[0.1, 0.2])
    assert np.array_equal(again.x, lv.integrate(field, V(), t=(0, 1), h=0.1, x=[0.1, 0.2]).x)
    one = lv.integrate(field, V(composition="S2"), t=(0, 0.2), steps=1, x=[0.1, 0.2]).x[-1]
    # the adjoint for half a step, then the flow: x is first in the one, y in the other
    x, y, h = 0.1, 0.2, 0.1
    x = x + h * np.sinh(y)
    y = y - h * x
    y = y - h * x
    x = x + h * np.sinh(y)
    assert np.abs(one - [x, y]).max() < 1e-15


def test_a_pickle_runs_alike():
    field = space()
    other = pickle.loads(pickle.dumps(field))
    ends = [lv.integrate(f, V(), t=(0, 1), h=0.1, x=X, params={"a": 1.1}).x for f in (field, other)]
    assert np.array_equal(*ends)
    assert repr(other) == "PotentialField(x, y, z; 3 planes, driven)"


@pytest.mark.parametrize(
    ("call", "error", "sentence"),
    [
        (
            lambda: lv.PotentialField(lambda t, x, params: x[0], x=4),
            ValueError,
            "two or three coordinates, not of 4\nhint: PolynomialField",
        ),
        (
            lambda: lv.PotentialField(lambda t, x, params: [x[0], x[1]], x=("x", "y", "z")),
            ValueError,
            "potential must return 3 values, not 2",
        ),
        (
            lambda: lv.PotentialField(lambda t, x, params: [x[0], x[1]], x=("x", "y")),
            ValueError,
            "potential must return a scalar, not 2 values",
        ),
        (
            lambda: lv.PotentialField(lambda t, x, params: {"w": x[0]}, x=("x", "y", "z")),
            ValueError,
            "potential has a value for 'w', which is no coordinate",
        ),
        (lambda: lv.PotentialField(3.0, x=2), TypeError, "potential must be a function, not 3.0"),
        (
            lambda: lv.integrate(plane(), V(), t=(0, 90), h=30.0, x=X[:2]),
            ValueError,
            "a step of 30 is too long for this field and start: the equations of BM4",
        ),
        (
            lambda: lv.integrate(plane(), V(diagonal="shears"), t=(0, 1), h=0.1, x=X[:2]),
            TypeError,
            "diagonal= is for polynomial fields",
        ),
        (
            lambda: lv.integrate(plane(), lv.Spark(), t=(0, 1), h=0.1, x=X[:2]),
            TypeError,
            "Spark.*does not step potential fields; methods that do: VolumeSplitting, a plan",
        ),
        (
            lambda: lv.integrate(plane(), V(), t=(0, 1), h=0.1, x=X[:2], params={"a": 1}),
            ValueError,
            "there is no parameter 'a'",
        ),
        (
            lambda: lv.integrate(plane(), lv.plan(space(), h=0.1, x=X), t=(0, 1), h=0.1, x=X[:2]),
            ValueError,
            "the plan is not for a potential field of 2 variables and .* operations",
        ),
    ],
)
def test_what_makes_no_field_or_run_is_refused(call, error, sentence):
    with pytest.raises(error, match=sentence):
        call()
