"""H(t) to a tolerance: series in time against references, their products, outputs and windows."""

import sys
from itertools import islice
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from ordinary import propagated
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

import liouville as lv
from liouville.problems import walker_preston

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import driven_products

TOLERANCES = (1e-4, 1e-7, 1e-10)

CASES = {
    "chain": lambda: driven_products.chain(8),
    "Landau-Zener": driven_products.landau_zener,
    "circular": lambda: driven_products.circular(6),
}


def exact(h0, functions, times, psi):
    """Return states at times by another method."""
    return propagated(lambda t, y: h0 @ y + sum(f(t) * (h @ y) for f, h in functions), times, psi)


@pytest.mark.parametrize("case", CASES)
def test_driven_runs_keep_to_their_tolerance_at_every_output(case):
    h0, functions, drive, (t0, t1), psi = CASES[case]()
    system = lv.Schrodinger(h0, drive=drive)
    times = np.append(t0, t0 + (t1 - t0) * np.linspace(0.01, 1.0, 23) ** 2)
    wanted = exact(h0, functions, times, psi)
    for tol in TOLERANCES:
        solution = lv.integrate(system, lv.SchrodingerSplitting(tol), t=times, psi=psi)
        errors = np.linalg.norm(solution.psi - wanted, axis=1)
        assert errors.max() <= tol + 1e-11, tol
        end = lv.integrate(system, lv.Chebyshev(tol), t=(t0, t1), psi=psi)
        # outputs are free
        assert solution.stats["products"] == end.stats["products"]
        assert np.linalg.norm(end.psi[-1] - solution.psi[-1]) <= 1e-13
        assert (
            end.stats["products"] <= 1.3 * lv.plan(system, lv.Chebyshev(tol), t=(t0, t1)).products
        )


@pytest.mark.parametrize("place", range(4))
def test_a_series_takes_at_most_three_fifths_of_the_products_of_dop853_at_equal_error(place):
    case = next(islice(driven_products.cases(), place, None))
    _, system, multiply, middle, span, psi = case
    end = lv.integrate(system, lv.Chebyshev(1e-12), t=span, psi=psi).psi[-1].ravel()
    # long chains take a while
    for tol in (1e-4,) if psi.size > 100 else (1e-4, 1e-6):
        ours = lv.integrate(system, lv.Chebyshev(tol), t=span, psi=psi)
        error = np.linalg.norm(ours.psi[-1].ravel() - end)
        counts = []
        for asked in 10.0 ** -np.arange(4.0, 12.0):
            runs = [driven_products.dop853(multiply, s, span, psi, asked) for s in (0.0, middle)]
            counts = [n for found, n in runs if np.linalg.norm(found - end) <= error]
            if counts:
                break
        # the next looser tolerances miss the error
        assert ours.stats["products"] <= 0.6 * min(counts), tol


def test_a_well_that_moves_and_breathes_has_the_order_of_each_splitting():
    def well(t, x, params):
        return -params.d * ca.exp(-(((x - 1.5 * ca.sin(t)) / (1 + 0.3 * ca.cos(2 * t))) ** 2))

    grid = lv.Grid(-10, 10, 64, potential=well)
    system = lv.Schrodinger(grid, params={"d": 4.0})
    psi = np.exp(-(grid.points[:, 0] ** 2)) + 0j
    run = {"t": (0.0, 2.0), "psi": psi / np.linalg.norm(psi), "params": {"d": 2.0}}
    wanted = lv.integrate(system, lv.Chebyshev(1e-12), **run).psi[-1]
    for method in (lv.Chebyshev(1e-6), lv.Magnus(6, 1e-6)):
        assert np.linalg.norm(lv.integrate(system, method, **run).psi[-1] - wanted) < 1e-6
    for scheme, order, steps in (("S2", 2, 80), ("BM4", 4, 80), ("RKN4s6", 4, 80), ("BM6", 6, 40)):
        ends = [
            lv.integrate(system, lv.SplitOperator(scheme), steps=n, **run).psi[-1]
            for n in (steps, 2 * steps)
        ]
        errors = [np.linalg.norm(end - wanted) for end in ends]
        assert abs(np.log2(errors[0] / errors[1]) - order) < 0.3, scheme


def test_the_molecule_in_its_laser_keeps_to_its_tolerance():
    (t, wanted), *_ = walker_preston.reference.items()
    for tol in (1e-5, 1e-9):
        solution = lv.integrate(
            walker_preston.system, lv.Chebyshev(tol), t=(0.0, t), **walker_preston.start
        )
        off = max(abs(solution.psi[-1][k] - value) for k, value in wanted["psi"].items())
        assert off <= tol


@pytest.mark.parametrize("power", [2, 3, 5])
@pytest.mark.parametrize("still", [0.0, 1e-3])
def test_a_drive_that_grows_from_zero_keeps_to_its_tolerance(still, power):
    x, up = np.array([[0.0, 1.0], [1.0, 0.0]]), [1.0, 0.0]
    system = lv.Schrodinger(still * x, drive=[(lambda t, params: t**power, x)])
    for end in (0.5, 1.0, 2.0, 3.0):
        solution = lv.integrate(system, "auto", t=(0, end), psi=up)
        angle = end ** (power + 1) / (power + 1) + still * end
        wanted = [np.cos(angle), -1j * np.sin(angle)]
        assert np.linalg.norm(solution.psi[-1] - wanted) <= 1e-8, end


def test_a_run_back_in_time_returns_and_auto_is_the_series():
    h0, _, drive, (t0, t1), psi = driven_products.chain(6)
    system = lv.Schrodinger(h0, drive=drive)
    there = lv.integrate(system, "auto", t=(t0, t1), psi=psi)
    assert "series in time" in there.method
    back = lv.integrate(system, lv.Chebyshev(1e-10), t=(t1, t0), psi=there.psi[-1])
    assert np.linalg.norm(back.psi[-1] - psi) <= 2e-8


def test_a_jump_is_bisected_down_to():
    h0, h1 = np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([1.0, -1.0])
    system = lv.Schrodinger(h0, drive=[(lambda t, _: ca.if_else(t < 1.3, 0.0, 2.0), h1)])
    psi = np.array([1.0, 0.0])
    solution = lv.integrate(system, lv.Chebyshev(1e-8), t=[0.0, 1.3, 3.0], psi=psi)
    half = exact(h0, [], np.array([0.0, 1.3]), psi)[-1]
    end = exact(h0 + 2 * h1, [], np.array([1.3, 3.0]), half)[-1]
    assert np.linalg.norm(solution.psi[1] - half) <= 1e-8
    assert np.linalg.norm(solution.psi[2] - end) <= 1e-8
    wild = lv.Schrodinger(h0, drive=[(lambda t, _: 1 / (t - 1), h1)])
    with pytest.raises(ValueError, match="is inf at t = 1"):
        lv.integrate(wild, "auto", t=(0.0, 2.0), psi=psi)


def test_a_plan_says_windows_and_comes_back_from_its_file(tmp_path):
    h0, ((_, h1),), _, span, psi = driven_products.chain(6)
    system = lv.Schrodinger(h0, drive=[(lambda t, _: ca.cos(4 * t) / 2, h1)])
    plan = lv.plan(system, lv.Chebyshev(1e-6), t=span)
    assert plan.bound == 1e-6
    assert f"series in time ({plan.windows} windows)" in str(plan)
    plan.save(tmp_path / "plan.json")
    again = lv.Plan.load(tmp_path / "plan.json")
    runs = [lv.integrate(system, each, t=span, psi=psi).psi for each in (plan, again)]
    assert runs[0].tobytes() == runs[1].tobytes()
    with pytest.raises(ValueError, match="an H that depends on time"):
        lv.integrate(lv.Schrodinger(h0), plan, t=span, psi=psi)
    with pytest.raises(TypeError, match="times are those of samples, and no drive has any"):
        lv.Schrodinger(SZ, drive=[(lambda t, q: t, SX)], times=[0.0, 1.0, 2.0])
    with pytest.raises(TypeError, match="is for an H without time"):
        lv.plan(system, lv.Lanczos(), t=span)


def test_members_of_an_ensemble_are_as_alone():
    h0, _, drive, span, psi = driven_products.circular(4)
    system = lv.Schrodinger(h0, drive=drive)
    starts = np.array([psi, psi[::-1], psi.real / np.linalg.norm(psi.real)])
    many = lv.ensemble(system, lv.Chebyshev(1e-6), t=span, psi=starts)
    for k, start in enumerate(starts):
        one = lv.integrate(system, lv.Chebyshev(1e-6), t=span, psi=start)
        assert np.array_equal(one.psi, many.psi[:, k])


SX, SZ = np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([1.0, -1.0])


@pytest.mark.parametrize("method", ["auto", lv.Chebyshev(1e-9), lv.Magnus(4, 1e-8)])
@pytest.mark.parametrize(("start", "length"), [(15.98, 1.0), (7.771, 0.002), (19.99, 0.005)])
def test_a_pulse_of_a_ten_thousandth_of_the_run_is_seen(method, start, length):
    def pulse(t, _):
        return ca.if_else(ca.logic_and(t > start, t < start + length), 1 / length, 0.0)

    system, psi = lv.Schrodinger(SZ, drive=[(pulse, SX)]), np.array([1.0, 0.0])
    parts = [(SZ, start), (SZ + SX / length, length), (SZ, 20.0 - start - length)]
    for t, times in ((0.0, parts), (20.0, parts[::-1])):
        wanted = psi
        for h, span in times:
            wanted = expm((-1j if t == 0.0 else 1j) * span * h) @ wanted
        found = lv.integrate(system, method, t=(t, 20.0 - t), psi=psi).psi[-1]
        assert np.linalg.norm(found - wanted) <= 2e-8


@pytest.mark.parametrize("method", ["auto", lv.Chebyshev(1e-9), lv.Magnus(4, 1e-8)])
def test_a_plan_says_how_short_a_pulse_may_be(method):
    system = lv.Schrodinger(SZ, drive=[(lambda t, _: ca.exp(-((t - 3.0) ** 2)), SX)])
    said = "in distances of 0.0012: a pulse shorter than these is seen by its time in points="
    assert said in str(lv.plan(system, method, t=(0, 20)))


@pytest.mark.parametrize(("count", "width"), [(40, 0.1), (400, 0.02)])
def test_many_pulses_keep_to_the_tolerance_in_all(count, width):
    height = 0.3 / width
    system = lv.Schrodinger(SZ, drive=[(lambda t, _: height * (ca.fmod(t, 2.0) < width), SX)])
    cycle = expm(-1j * (2.0 - width) * SZ) @ expm(-1j * width * (SZ + height * SX))
    wanted = np.linalg.matrix_power(cycle, count) @ [1.0, 0.0]
    for method in (lv.Chebyshev(1e-8), lv.Magnus(4, 1e-6)):
        found = lv.integrate(system, method, t=(0.0, 2.0 * count), psi=np.array([1.0, 0.0]))
        assert np.linalg.norm(found.psi[-1] - wanted) <= method.tol


def test_outputs_and_points_tell_of_a_pulse_that_is_too_short_to_be_found():
    start, length = 7.771, 1e-7

    def pulse(t, _):
        return ca.if_else(ca.logic_and(t > start, t < start + length), 1 / length, 0.0)

    system = lv.Schrodinger(SZ, drive=[(pulse, SX)])
    wanted = np.array([1.0, 0.0])
    for h, span in ((SZ, start), (SZ + SX / length, length), (SZ, 20.0 - start - length)):
        wanted = expm(-1j * span * h) @ wanted
    times = np.array([0.0, start, start + length, 20.0])
    for method in (lv.Chebyshev(1e-8), lv.Magnus(4, 1e-6)):
        found = lv.integrate(system, method, t=times, psi=np.array([1.0, 0.0])).psi[-1]
        # the ends of the pulse are known to rounding errors of the time
        assert np.linalg.norm(found - wanted) <= method.tol + 1e-15 * start / length
    told = lv.Schrodinger(SZ, drive=[(pulse, SX)], points=[start + length / 3])
    for method in (lv.Chebyshev(1e-8), lv.Magnus(4, 1e-6)):
        found = lv.integrate(told, method, t=(0.0, 20.0), psi=np.array([1.0, 0.0])).psi[-1]
        assert np.linalg.norm(found - wanted) <= method.tol + 1e-15 * start / length


def test_rounding_errors_of_the_time_neither_shorten_windows_nor_leave_the_bound():
    late, span, psi = 1e6, 20.0, np.array([1.0, 0.0])
    phase = np.fmod(2 * late, 2 * np.pi)
    runs = []
    for start, shift, tol in ((0.0, phase, 1e-12), (late, 0.0, 1e-11)):
        drive = [(lambda t, _, shift=shift: 0.5 * ca.cos(2 * t + shift), SX)]
        system, times = lv.Schrodinger(SZ, drive=drive), (start, start + span)
        runs.append(lv.integrate(system, lv.Chebyshev(tol), t=times, psi=psi))
    early, found = runs
    assert np.linalg.norm(found.psi[-1] - early.psi[-1]) <= found.stats["bound"] <= 1e-8
    assert found.stats["products"] <= 1.1 * early.stats["products"]


def test_samples_are_no_part_of_the_tape():
    sizes = []
    for count in (11, 1001):
        at = np.linspace(0.0, 20.0, count)
        system = lv.Schrodinger(SZ, drive=[(np.cos(at), SX)], times=at)
        sizes.append(len(str(system._weights)))
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize("count", [401, 100001])
def test_no_sample_is_passed_over(count):
    at, place = np.linspace(0.0, 20.0, count), count // 3
    samples = np.zeros(count)
    samples[place] = 1.0 / at[1]
    spline = CubicSpline(at, samples)
    # what the spline has beyond falls by a factor of 0.27 a sample
    near = at[place - 30 : place + 31]
    begin = expm(-1j * SZ * near[0]) @ [1.0, 0.0]
    wanted = propagated(lambda t, y: SZ @ y + spline(t) * (SX @ y), near, begin)[-1]
    wanted = expm(-1j * SZ * (20.0 - near[-1])) @ wanted
    system = lv.Schrodinger(SZ, drive=[(samples, SX)], times=at)
    for method in ("auto", lv.Magnus(4, 1e-7)):
        found = lv.integrate(system, method, t=(0.0, 20.0), psi=np.array([1.0, 0.0]))
        assert np.linalg.norm(found.psi[-1] - wanted) <= (1e-8 if method == "auto" else 1e-7)


def test_a_function_of_time_may_be_singular_outside_the_run():
    """Functions are looked at within the run only."""
    z, x = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    driven = lv.Schrodinger(z, drive=[(lambda t, params: 1 / t, x)])
    found = lv.integrate(driven, "auto", t=(1, 2), psi=[1, 0]).psi[-1]
    for by_products in ((2, lambda t, psi: z @ psi + x @ psi / t), lambda t: z + x / t):
        same = lv.integrate(lv.Schrodinger(by_products), "auto", t=(1, 2), psi=[1, 0]).psi[-1]
        assert np.linalg.norm(found - same) < 3e-8
    back = lv.integrate(driven, "auto", t=(2, 1), psi=found).psi[-1]
    assert np.linalg.norm(back - [1, 0]) < 3e-8
    grid = lv.Grid(-5, 5, 64, potential=lambda t, x, params: x**2 / 2 / t)
    psi = np.exp(-(grid.points[:, 0] ** 2) / 2)
    steps = lv.integrate(lv.Schrodinger(grid), lv.SplitOperator(), t=(1, 2), steps=40, psi=psi)
    assert lv.plan(lv.Schrodinger(grid), t=(1, 2)).products > 0
    chosen = lv.integrate(lv.Schrodinger(grid), "auto", t=(1, 2), psi=psi)
    assert np.linalg.norm(chosen.psi[-1] - steps.psi[-1]) < 1e-7 * np.linalg.norm(psi)
    with pytest.raises(ValueError, match="is inf at t = 0"):
        lv.plan(driven, t=(0, 1))


@pytest.mark.parametrize("size", [3, 300])
def test_a_drive_that_does_not_depend_on_time_is_a_part_of_h(size):
    rng = np.random.default_rng(size)
    still, one, two = (np.diag(rng.normal(size=size)) for _ in range(3))
    one += 0.3 * (np.eye(size, k=1) + np.eye(size, k=-1))
    functions = (lambda t, params: params.a, lambda t, params: 2 * params.b)
    system = lv.Schrodinger(
        still, drive=[*zip(functions, (one, two), strict=True)], params={"a": 0.7, "b": -0.2}
    )
    psi = np.full(size, size**-0.5)
    plain = lv.Schrodinger(still + 0.7 * one - 0.4 * two)
    run = lv.integrate(system, "auto", t=(0, 20), psi=psi)
    wanted = lv.integrate(plain, "auto", t=(0, 20), psi=psi)
    assert np.linalg.norm(run.psi[-1] - wanted.psi[-1]) < 2e-8
    assert run.stats["products"] < 1.3 * wanted.stats["products"]
    assert lv.plan(system, t=(0, 20)).bound is not None
    # other values, and those of members
    other = lv.integrate(system, lv.Lanczos(), t=(0, 5), psi=psi, params={"a": 1.1})
    plain = lv.Schrodinger(still + 1.1 * one - 0.4 * two)
    wanted = lv.integrate(plain, "auto", t=(0, 5), psi=psi)
    assert np.linalg.norm(other.psi[-1] - wanted.psi[-1]) < 2e-8
    many = lv.ensemble(system, "auto", t=(0, 5), psi=psi, params={"a": [0.7, 1.1]})
    assert np.linalg.norm(many.psi[-1, 1] - wanted.psi[-1]) < 2e-8


def test_a_drive_without_time_has_its_derivatives():
    z, x = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    system = lv.Schrodinger(z, drive=[(lambda t, params: params.a, x)], params={"a": 0.3})
    last = [
        lv.integrate(system, "auto", t=(0, 3), psi=[1, 0], params={"a": 0.3 + d}).psi[-1]
        for d in (-1e-4, 1e-4)
    ]
    slope = (last[1] - last[0]) / 2e-4
    run = lv.integrate(system, "auto", t=(0, 3), psi=[1, 0], tangents={"params.a": 1.0})
    assert np.linalg.norm(run.tangents["params.a"].psi[-1] - slope) < 1e-6


def test_the_split_operator_takes_diagonal_drives():
    """As a potential of t and x, by a function and by samples, and as series in time have it."""
    x = lv.Grid(-8, 8, 64).points[:, 0]
    well, psi = x**2 / 2, np.exp(-(x**2) / 2)
    at = np.linspace(-0.5, 2.5, 400)
    field = [(lambda t, params: params.a * ca.cos(3 * t), x)]
    by_potential = lv.Grid(
        -8, 8, 64, potential=lambda t, x, params: x**2 / 2 + params.a * ca.cos(3 * t) * x
    )
    options = {"t": (0, 2), "steps": 40, "psi": psi}
    driven = lv.Schrodinger(lv.Grid(-8, 8, 64, well), drive=field, params={"a": 0.5})
    sampled = lv.Schrodinger(lv.Grid(-8, 8, 64, well), drive=[(0.5 * np.cos(3 * at), x)], times=at)
    whole = lv.Schrodinger(by_potential, params={"a": 0.5})
    one, other, third = (
        lv.integrate(s, lv.SplitOperator(), **options) for s in (driven, whole, sampled)
    )
    assert np.abs(one.psi - other.psi).max() < 1e-13
    assert np.abs(one.observed["energy"] - other.observed["energy"]).max() < 1e-12
    assert np.abs(one.psi - third.psi).max() < 1e-7
    series = lv.integrate(driven, "auto", t=(0, 2), psi=psi)
    assert np.abs(one.psi[-1] - series.psi[-1]).max() < 1e-7
    hop = np.diag(np.ones(63), 1)
    mixed = lv.Schrodinger(lv.Grid(-8, 8, 64, well), drive=[(lambda t, params: t, hop + hop.T)])
    with pytest.raises(TypeError, match="drives by diagonal matrices alone"):
        lv.integrate(mixed, lv.SplitOperator(), **options)


def test_members_of_a_driven_grid_have_potentials_of_their_own_and_none():
    def trap(t, x, params):
        return x**2 / 2

    def tilted(potential):
        grid = lv.Grid(-6, 6, 32, potential)
        return lv.Schrodinger(grid, drive=[(lambda t, params: ca.cos(t), grid.points[:, 0])])

    system = tilted(trap)
    x = system.grid.points[:, 0]
    potentials = np.array([x**2, 0 * x])
    psi = np.exp(-((x - 1) ** 2) / 2) + 0j
    run = lv.ensemble(system, "auto", t=(0, 1), psi=psi, potential=potentials)
    for k, potential in enumerate(potentials):
        alone = lv.integrate(tilted(potential), "auto", t=(0, 1), psi=psi)
        assert np.array_equal(run.psi[:, k], alone.psi)
