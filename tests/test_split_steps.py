"""The split operator with steps by its tolerance, and "auto" on grids."""

import copy
import itertools
import pickle
import re

import casadi as ca
import numpy as np
import pytest

import liouville as lv

END = 4.0


def grid(potential, n=128, low=-10.0, high=10.0):
    return lv.Grid(low, high, n, potential=potential)


def gaussian(x, centre, speed=0.0):
    psi = np.exp(-((x - centre) ** 2) / 2 + 1j * speed * x)
    return psi / np.linalg.norm(psi)


def dense(own, values):
    """Return the matrix of T + V, by transforms of unit vectors."""
    (n,) = own.shape
    x = own.points[:, 0]
    k = 2 * np.pi * np.fft.fftfreq(n, x[1] - x[0])
    return np.fft.ifft(k[:, None] ** 2 / 2 * np.fft.fft(np.eye(n), axis=0), axis=0) + np.diag(
        values
    )


def exact(h, psi, t):
    energies, modes = np.linalg.eigh(h)
    return modes @ (np.exp(-1j * energies * t) * (modes.conj().T @ psi))


#: Potentials as CasADi has them and as arrays, and a start.
STATIC = {
    "quartic": (lambda x: x**2 / 2 + x**4 / 20, 2.0, 0.0),
    "double well": (lambda x: x**4 / 40 - x**2, 2.5, 0.5),
    "deep well": (
        lambda x: -20 / np.cosh(x) ** 2 if isinstance(x, np.ndarray) else -20 / ca.cosh(x) ** 2,
        -4.0,
        3.0,
    ),
}


@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("name", STATIC)
def test_the_error_is_within_the_tolerance(name, tol):
    value, centre, speed = STATIC[name]
    own = grid(lambda t, x, params: value(x))
    x = own.points[:, 0]
    psi = gaussian(x, centre, speed)
    run = lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=tol), t=(0, END), psi=psi)
    error = np.linalg.norm(run.psi[-1] - exact(dense(own, value(x)), psi, END))
    assert error <= tol


#: Potentials with kinks, of whose split operators errors do not fall by the order.
ROUGH = {
    "kink": lambda x, m: 2 * m.fabs(x),
    "tent": lambda x, m: m.fmax(0, 4 - 4 * m.fabs(x - 2)),
    "step": lambda x, m: 5.0 * (x > 0),
}


@pytest.mark.parametrize("tol", [1e-2, 1e-4])
@pytest.mark.parametrize("name", ROUGH)
def test_the_error_is_within_the_tolerance_where_the_order_is_lower(name, tol):
    value = ROUGH[name]
    own = grid(lambda t, x, params: value(x, ca), n=256, low=-15, high=15)
    x = own.points[:, 0]
    for psi in (gaussian(x, 2.0), gaussian(x, -3.0, 2.0)):
        run = lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=tol), t=(0, 10), psi=psi)
        assert np.linalg.norm(run.psi[-1] - exact(dense(own, value(x, np)), psi, 10)) <= tol


@pytest.mark.parametrize("scheme", ["S2", "BM4", "RKN4s6", "BM6", "SS8s21"])
def test_every_scheme_keeps_to_the_tolerance_by_its_own_order(scheme):
    value, centre, _ = STATIC["quartic"]
    own = grid(lambda t, x, params: value(x))
    x = own.points[:, 0]
    psi = gaussian(x, centre)
    method = lv.SplitOperator(scheme, tol=1e-4)
    run = lv.integrate(lv.Schrodinger(own), method, t=(0, END), psi=psi)
    error = np.linalg.norm(run.psi[-1] - exact(dense(own, value(x)), psi, END))
    assert 1e-8 < error <= 1e-4


def test_a_free_particle_is_one_step():
    own = grid(lambda t, x, params: 0.0 * x)
    x = own.points[:, 0]
    psi = gaussian(x, 0.0)
    run = lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=1e-10), t=(0, END), psi=psi)
    assert np.linalg.norm(run.psi[-1] - exact(dense(own, 0 * x), psi, END)) < 1e-12
    assert run.stats["products"] < 200


def driven(t, force):
    """Return centre and speed of a forced oscillator from rest at 1, by quadrature."""
    s, w = np.polynomial.legendre.leggauss(400)
    s = 0.5 * t * (s + 1)
    w = 0.5 * t * w * force(s)
    return np.cos(t) + w @ np.sin(t - s), -np.sin(t) + w @ np.cos(t - s)


@pytest.mark.parametrize("tol", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("is_back", [False, True])
def test_a_moving_potential_is_kept_to_the_tolerance_forwards_and_back(tol, is_back):
    # a coherent state follows the classical path in a forced oscillator, up to a phase
    sign = -1.0 if is_back else 1.0
    own = grid(lambda t, x, params: x**2 / 2 - ca.sin(2 * sign * t) * x)
    x = own.points[:, 0]
    psi = gaussian(x, 1.0)
    run = lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=tol), t=(0, sign * END), psi=psi)
    centre, speed = driven(END, lambda s: np.sin(2 * s))
    overlap = abs(np.vdot(gaussian(x, centre, sign * speed), run.psi[-1]))
    assert 2 * (1 - overlap) <= tol**2 + 1e-13


def stepped(own, psi, pieces):
    """Return the state after potentials that are constant in time, each with its length."""
    for values, length in pieces:
        psi = exact(dense(own, values), psi, length)
    return psi


#: Times at which a trap changes between two strengths, within a run from 0 to 4.
JUMPS = {
    "one": [1.2345],
    "start": [0.0],
    "end": [END],
    "round": [1.0, 2.0, 3.0],
    "close": [1.0, 1.0 + 1e-3],
    "many": np.linspace(0.05, 3.95, 40).tolist(),
}


@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("name", JUMPS)
@pytest.mark.parametrize("is_drive", [False, True])
def test_jumps_in_time_are_stepped_up_to_and_across(name, tol, is_drive):
    jumps = JUMPS[name]

    def strength(t):
        return 1 + sum((-1) ** k * (t >= jump) for k, jump in enumerate(jumps))

    own = grid(None if is_drive else lambda t, x, params: x**2 / 2 * strength(t))
    x = own.points[:, 0]
    drive = [(lambda t, params: strength(t), x**2 / 2)] if is_drive else []
    system, psi = lv.Schrodinger(own, drive=drive), gaussian(x, 1.0)
    edges = [0.0, *(t for t in jumps if 0 < t < END), END]
    lengths = [(strength((a + b) / 2) * x**2 / 2, b - a) for a, b in itertools.pairwise(edges)]
    run = lv.integrate(system, lv.SplitOperator(tol=tol), t=(0, END), psi=psi)
    assert np.linalg.norm(run.psi[-1] - stepped(own, psi, lengths)) <= tol
    # two steps in search of a jump, one up to it and one across
    assert run.stats["products"] < 2000 + 150 * len(jumps)


def test_a_wall_that_moves_from_point_to_point_jumps_at_each():
    own = grid(lambda t, x, params: x**2 / 2 + 3 * (x > t - 2))
    x = own.points[:, 0]
    psi = gaussian(x, -1.0)
    inside = np.sort(x[(x > -2) & (x < END - 2)]) + 2
    edges = [0.0, *inside, END]
    pieces = [(x**2 / 2 + 3 * (x > (a + b) / 2 - 2), b - a) for a, b in itertools.pairwise(edges)]
    run = lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=1e-8), t=(0, END), psi=psi)
    assert np.linalg.norm(run.psi[-1] - stepped(own, psi, pieces)) <= 1e-8


@pytest.mark.parametrize("tol", [1e-2, 1e-8])
def test_a_pole_in_time_ends_in_a_sentence(tol):
    own = grid(lambda t, x, params: x**2 / 2 / (t - 1.2345))
    psi = gaussian(own.points[:, 0], 1.0)
    with pytest.raises(lv.IntegrationError, match=r"one step of about .* after another"):
        lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=tol), t=(0, END), psi=psi)


def test_a_pulse_is_seen_by_its_time():
    width, at = 1e-3, 2.345

    def force(t):
        return 3 * ca.exp(-(((t - at) / width) ** 2)) / (width * np.sqrt(np.pi))

    own = grid(lambda t, x, params: x**2 / 2 - force(t) * x)
    x = own.points[:, 0]
    system = lv.Schrodinger(own, points=[at - 3 * width, at, at + 3 * width])
    psi = gaussian(x, 1.0)
    method = lv.SplitOperator(tol=1e-6)
    run = lv.integrate(system, method, t=(0, END), psi=psi)
    centre = np.cos(END) + 3 * np.exp(-(width**2) / 4) * np.sin(END - at)
    speed = -np.sin(END) + 3 * np.exp(-(width**2) / 4) * np.cos(END - at)
    overlap = abs(np.vdot(gaussian(x, centre, speed), run.psi[-1]))
    assert 2 * (1 - overlap) <= 1e-11
    assert "points=" in str(lv.plan(system, method, t=(0, END), psi=psi))


def revived(n, periods, method):
    """Return the error of a run over periods of an oscillator, and how it was planned."""
    own = grid(lambda t, x, params: x**2 / 2, n=n, low=-12.0, high=12.0)
    psi, t = gaussian(own.points[:, 0], 1.0), (0, 2 * np.pi * periods)
    run = lv.integrate(lv.Schrodinger(own), method, t=t, psi=psi)
    return np.linalg.norm(run.psi[-1] - (-1) ** periods * psi), run.method


def test_the_reach_of_a_tolerance_is_that_of_the_state_and_not_of_the_grid():
    # energies of the grid are up to 1.4e5, whose phases have roundings of 1.6e-9
    error, _ = revived(4096, 4, lv.SplitOperator(tol=1e-11))
    assert error <= 1e-11
    error, scheme = revived(2048, 64, "auto")
    assert error <= 1e-8
    assert scheme.startswith("split operator")


def test_a_tolerance_below_the_roundings_of_transforms_is_refused():
    with pytest.raises(ValueError, match=r"tol = 1e-13 is out of reach: .* pairs of FFTs"):
        revived(64, 3, lv.SplitOperator(tol=1e-13))


def test_outputs_at_uneven_times_are_each_within_the_tolerance():
    value, centre, _ = STATIC["quartic"]
    own = grid(lambda t, x, params: value(x))
    x = own.points[:, 0]
    psi, h = gaussian(x, centre), dense(own, value(x))
    t = np.r_[0, np.sort(np.random.default_rng(4).uniform(0, END, 40))]
    run = lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=1e-6), t=t, psi=psi)
    for time, state in zip(run.t, run.psi, strict=True):
        assert np.linalg.norm(state - exact(h, psi, time)) <= 1e-6


def test_members_are_runs_alone():
    value, _, _ = STATIC["quartic"]
    own = grid(lambda t, x, params: value(x))
    x = own.points[:, 0]
    starts = np.array([gaussian(x, 2.0), gaussian(x, 0.5)])
    system, method = lv.Schrodinger(own), lv.SplitOperator(tol=1e-6)
    plan = lv.plan(system, method, t=(0, END), psi=starts[0])
    found = lv.ensemble(system, method, t=(0, END), psi=starts)
    for k, start in enumerate(starts):
        alone = lv.integrate(system, plan, t=(0, END), psi=start)
        assert np.array_equal(found.psi[-1, k], alone.psi[-1])


def test_a_condensate_is_kept_to_the_tolerance_below_resonances():
    own = grid(lambda t, x, params: x**2 / 2, n=256)
    x = own.points[:, 0]
    psi = gaussian(x, 1.0)
    system = lv.Schrodinger(own, nonlinearity=lambda t, rho, params: 10 * rho)
    fine = lv.integrate(
        system, lv.SplitOperator("RKN6s11"), t=(0, 2), psi=psi, steps=2000, every=2000
    )
    method = lv.SplitOperator(tol=1e-6)
    run = lv.integrate(system, method, t=(0, 2), psi=psi)
    assert np.linalg.norm(run.psi[-1] - fine.psi[-1]) <= 1e-6 * np.linalg.norm(psi)
    plan = lv.plan(system, method, t=(0, 2), psi=psi)
    # without noise that grows beyond the tolerance steps may be in resonance with waves
    assert run.stats["products"] < 1000
    again = lv.plan(system, lv.SplitOperator(tol=1e-6), t=(0, 40), psi=psi)
    largest = (np.pi / (x[1] - x[0])) ** 2 / 2
    assert again.core.longest < 4 * np.pi / largest
    assert plan.core.longest > 4 * np.pi / largest


@pytest.mark.parametrize("g", [-2.0, -1.0, 1.0, 10.0, 20.0])
def test_long_steps_of_condensates_keep_to_the_tolerance(g):
    # steps far beyond resonances, and a trial step that the grid does not resolve
    own = grid(lambda t, x, params: x**2 / 2 + (0.05 * x**4 if g > 5 else 0.0), n=256)
    psi = gaussian(own.points[:, 0], 0.8, 0.5)
    system = lv.Schrodinger(own, nonlinearity=lambda t, rho, params: g * rho)
    fine = lv.integrate(system, lv.SplitOperator(), t=(0, 2), psi=psi, steps=1600, every=1600)
    for tol in (1e-2, 1e-4, 1e-6):
        run = lv.integrate(system, lv.SplitOperator(tol=tol), t=(0, 2), psi=psi)
        assert np.linalg.norm(run.psi[-1] - fine.psi[-1]) <= tol
        assert run.stats["products"] < 3000


def test_an_absorber_is_kept_to_the_tolerance_of_the_start():
    own = grid(lambda t, x, params: 0.1 * x**2, n=256, low=-30, high=30)
    x = own.points[:, 0]
    w = 2 * np.clip((abs(x) - 15) / 15, 0, None) ** 2
    psi = gaussian(x, 0.0, 4.0)
    run = lv.integrate(
        lv.Schrodinger(own, absorber=w), lv.SplitOperator(tol=1e-6), t=(0, 8), psi=psi
    )
    h = dense(own, 0.1 * x**2 - 1j * w)
    energies, modes = np.linalg.eig(h)
    want = modes @ (np.exp(-1j * energies * 8) * np.linalg.solve(modes, psi))
    assert np.linalg.norm(run.psi[-1] - want) <= 1e-6


def anharmonic(n=512):
    own = grid(lambda t, x, params: x**2 / 2 + x**4 / 20, n=n)
    x = own.points[:, 0]
    return lv.Schrodinger(own), gaussian(x, 1.0, 0.5), own


def test_auto_takes_the_split_operator_where_it_is_cheaper():
    system, psi, own = anharmonic()
    series = lv.plan(system, t=(0, END))
    run = lv.integrate(system, "auto", t=(0, END), psi=psi)
    assert run.stats["products"] < series.products / 10
    x = own.points[:, 0]
    assert np.linalg.norm(run.psi[-1] - exact(dense(own, x**2 / 2 + x**4 / 20), psi, END)) <= 1e-8
    plan = lv.plan(system, t=(0, END), psi=psi)
    assert plan.scheme.startswith("split operator")
    assert plan.bound is None
    least = re.search(r"a series would take (\d+) products or more", str(plan))
    assert least is not None
    assert 0.5 * series.products < int(least[1]) < series.products


def test_auto_keeps_what_is_cheaper_than_the_split_operator():
    own = grid(lambda t, x, params: x**2 / 2)
    system = lv.Schrodinger(own)
    psi = np.random.default_rng(1).normal(size=128)  # of all energies
    plan = lv.plan(system, t=(0, 20), psi=psi)
    assert plan.bound is not None
    assert "a split operator would take more" in str(plan)


def test_auto_looks_at_all_of_a_run_and_not_at_its_start_alone():
    # a packet that is free at first falls into a deep well
    own = grid(lambda t, x, params: -60 * ca.exp(-(x**2)), n=512, low=-20, high=20)
    psi = gaussian(own.points[:, 0], -6.0, 3.0)
    plan = lv.plan(lv.Schrodinger(own), t=(0, END), psi=psi)
    assert not plan.scheme.startswith("split operator")


def test_auto_takes_a_series_where_a_kink_makes_steps_short():
    own = grid(lambda t, x, params: ROUGH["kink"](x, ca), n=512, low=-15, high=15)
    plan = lv.plan(lv.Schrodinger(own), t=(0, 10), psi=gaussian(own.points[:, 0], 2.0))
    assert not plan.scheme.startswith("split operator")
    assert plan.products < 10_000  # a split operator takes 110,000


def test_a_run_goes_on_where_its_plan_has_begun_it():
    system, psi, _ = anharmonic()
    plan = lv.plan(system, t=(0, END), psi=psi)
    first = lv.integrate(system, plan, t=(0, END), psi=psi)
    assert first.stats["products"] == plan.products  # all of it was made for the plan
    again = lv.integrate(system, plan, t=(0, END), psi=psi)
    assert np.array_equal(first.psi, again.psi)
    assert first.stats == {**again.stats, "seconds": first.stats["seconds"]}
    other = lv.integrate(system, plan, t=(0, END), psi=1j * psi)
    assert np.linalg.norm(other.psi[-1] - 1j * first.psi[-1]) < 1e-12
    for copied in (pickle.loads(pickle.dumps(plan)), copy.deepcopy(plan)):
        run = lv.integrate(system, copied, t=(0, END), psi=psi)
        assert np.array_equal(first.psi, run.psi)


def test_many_outputs_are_counted():
    system, psi, _ = anharmonic()
    t = np.linspace(0, END, 1001)
    plan = lv.plan(system, t=t, psi=psi)
    assert not plan.scheme.startswith("split operator")


def test_a_run_that_is_differentiated_has_a_method_with_a_derivative():
    system, psi, _ = anharmonic(128)
    direction = np.roll(psi, 1)
    run = lv.integrate(system, "auto", t=(0, 10), psi=psi, tangents={"psi": direction})
    other = lv.integrate(system, "auto", t=(0, 10), psi=direction)
    assert np.linalg.norm(run.tangents["psi"].psi[-1] - other.psi[-1]) < 3e-8


def test_a_saved_plan_runs_to_the_same_bits(tmp_path):
    system, psi, _ = anharmonic(128)
    plan = lv.plan(system, lv.SplitOperator(tol=1e-6), t=(0, END), psi=psi)
    plan.save(tmp_path / "plan.json")
    read = lv.Plan.load(tmp_path / "plan.json")
    first, again = (lv.integrate(system, each, t=(0, END), psi=psi) for each in (plan, read))
    assert np.array_equal(first.psi, again.psi)
    assert np.array_equal(first.psi, lv.integrate(system, plan.method, t=(0, END), psi=psi).psi)


def test_a_tighter_tolerance_takes_more_products():
    system, psi, _ = anharmonic(128)
    runs = [
        lv.integrate(system, lv.SplitOperator(tol=10.0**-k), t=(0, 20), psi=psi)
        for k in range(2, 11)
    ]
    products = [run.stats["products"] for run in runs]
    assert products == sorted(products)


def test_bad_calls_are_refused_in_a_sentence():
    system, psi, _ = anharmonic(64)
    method = lv.SplitOperator(tol=1e-6)
    with pytest.raises(TypeError, match="chooses its steps by its tol"):
        lv.integrate(system, method, t=(0, 1), h=0.1, psi=psi)
    with pytest.raises(TypeError, match=r"or SplitOperator\(tol=\), which chooses"):
        lv.integrate(system, lv.SplitOperator(), t=(0, 1), psi=psi)
    with pytest.raises(TypeError, match="psi is missing"):
        lv.plan(system, method, t=(0, 1))
    with pytest.raises(TypeError, match=r"leaves nothing to plan\nhint: .* lv.integrate"):
        lv.plan(system, lv.SplitOperator(), t=(0, 1), psi=psi)
    with pytest.raises(TypeError, match=r"takes no h=\nhint: .* give h to lv.integrate"):
        lv.plan(system, method, t=(0, 1), psi=psi, h=0.1)
    with pytest.raises(ValueError, match="tol must be from"):
        lv.SplitOperator(tol=2.0)
    with pytest.raises(TypeError, match="steps a Grid"):
        lv.integrate(lv.Schrodinger(lv.Lattice(20)), method, t=(0, 1), psi=np.eye(20)[3])
    with pytest.raises(ValueError, match="out of reach"):
        lv.integrate(system, lv.SplitOperator(tol=1e-13), t=(0, 1e4), psi=psi)


def test_a_state_is_given_in_the_shape_of_its_grid_and_laid_out_by_it():
    own = lv.Grid([-5, -6], [5, 6], [16, 20], potential=lambda t, x, params: ca.sumsqr(x) / 2)
    psi = np.exp(-((own.points - [1.0, 0.0]) ** 2).sum(axis=1) / 2)
    runs = [
        lv.integrate(lv.Schrodinger(own), lv.SplitOperator(tol=1e-6), t=(0, 1), psi=each)
        for each in (psi, psi.reshape(own.shape))
    ]
    assert np.array_equal(runs[0].psi, runs[1].psi)
    density = np.abs(runs[0].psi.reshape(-1, *own.shape)) ** 2
    centre = (density.sum(axis=2) @ own.axes[0]) / density.sum(axis=(1, 2))
    assert centre == pytest.approx([1.0, np.cos(1.0)], abs=1e-3)
    assert lv.Lattice([3, 4]).shape == (3, 4)
