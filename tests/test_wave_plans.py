"""Plans of wave functions before they run: bounds of errors, tolerances, and fewest products."""

import itertools
import time

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mpmath import mp
from properties import examples

import liouville as lv
from liouville._basics import checksum
from liouville._methods.planner.waves.ladder import ROUNDOFF, SHORTER, cheapest, ladder
from liouville.problems import load

METHODS = {
    "auto": lv.SchrodingerSplitting,
    "fast": lambda tol: lv.SchrodingerSplitting(tol, "fast"),
    "stable": lambda tol: lv.SchrodingerSplitting(tol, "stable"),
    "Chebyshev": lv.Chebyshev,
}
SEEDS = st.integers(0, 2**32 - 1)

#: A spectrum of half width 1 around 0.
UNIT = lv.Schrodinger(np.diag([-1.0, 1.0]), bounds=(-1.0, 1.0))


def eigen(system):
    """Return energies and eigenvectors of H / hbar, in the user's components."""
    n = system.hamiltonian.size
    matrix = np.array([system.hamiltonian.multiply(row) for row in np.eye(n)])
    energies, vectors = np.linalg.eigh(matrix)
    return energies, system.outward(vectors.T.copy()).T


def exact(matrix, t, psi):
    """Return a state at a time by eigenvectors in 40 digits."""
    with mp.workdps(40):
        energies, vectors = mp.eigsy(mp.matrix(matrix.tolist()))
        start = vectors.T * mp.matrix(psi.tolist())
        turned = [mp.expj(-e * mp.mpf(t)) * c for e, c in zip(energies, start, strict=True)]
        return np.array([complex(c) for c in vectors * mp.matrix(turned)])


def random_state(rng, n):
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    return psi / np.linalg.norm(psi)


@examples(60)
@given(
    seed=SEEDS,
    n=st.integers(2, 6),
    theta=st.floats(0.0, 3.0).map(lambda x: 10**x),
    tol=st.integers(3, 11).map(lambda k: 10.0**-k),
    method=st.sampled_from(sorted(METHODS)),
    shift=st.sampled_from([0.0, 0.0, 3.0]),
    is_backward=st.booleans(),
)
def test_the_error_is_never_above_the_bound_and_the_bound_not_above_the_tolerance(
    seed, n, theta, tol, method, shift, is_backward
):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(n, n))
    matrix = matrix + matrix.T + shift * np.eye(n)
    system = lv.Schrodinger(matrix)
    t = float(theta / (np.ptp(system.bounds) / 2)) * (-1 if is_backward else 1)
    psi = random_state(rng, n)
    try:
        solution = lv.integrate(system, METHODS[method](tol), t=(0.0, t), psi=psi)
    except ValueError as refused:
        assert "reach" in str(refused)  # noqa: PT017
        assert tol < 1e-9
        return
    error = np.linalg.norm(solution.psi[-1] - exact(matrix, t, psi))
    assert error <= solution.stats["bound"] <= tol


@examples(25)
@given(
    seed=SEEDS,
    times=st.lists(st.floats(0.05, 40.0), min_size=1, max_size=6, unique=True).map(sorted),
    tol=st.integers(3, 11).map(lambda k: 10.0**-k),
    method=st.sampled_from(sorted(METHODS)),
)
@example(seed=5983571, times=[1.0, 12.5, 23.0], tol=1e-6, method="fast")
def test_the_bound_holds_at_each_of_many_uneven_times(seed, times, tol, method):
    rng = np.random.default_rng(seed)
    system = lv.Schrodinger(lv.Lattice(12, potential=rng.normal(size=12)))
    energies, vectors = eigen(system)
    psi = random_state(rng, 12)
    solution = lv.integrate(system, METHODS[method](tol), t=[0.0, *times], psi=psi)
    wanted = [vectors @ (np.exp(-1j * energies * t) * (vectors.T @ psi)) for t in times]
    errors = np.linalg.norm(solution.psi[1:] - np.array(wanted), axis=1)
    # eigenvectors and energies in double precision are off by a few units
    assert errors.max() <= solution.stats["bound"] + 1e-13 <= tol + 1e-13


@examples(25)
@given(
    seed=SEEDS,
    theta=st.sampled_from([2.0, 20.0, 200.0]),
    tol=st.integers(3, 10).map(lambda k: 10.0**-k),
    dimension=st.integers(8, 30),
)
def test_lanczos_keeps_to_its_tolerance(seed, theta, tol, dimension):
    rng = np.random.default_rng(seed)
    system = lv.Schrodinger(lv.Lattice(60, potential=rng.normal(size=60)))
    energies, vectors = eigen(system)
    t = theta / (np.ptp(energies) / 2)
    psi = random_state(rng, 60)
    solution = lv.integrate(system, lv.Lanczos(tol, dimension), t=(0.0, t), psi=psi)
    wanted = vectors @ (np.exp(-1j * energies * t) * (vectors.T @ psi))
    assert np.linalg.norm(solution.psi[-1] - wanted) <= tol


PROBLEMS = ("harmonic_oscillator", "poschl_teller", "tight_binding", "heisenberg")


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name != "poschl_teller"])
@pytest.mark.parametrize(("method", "slack"), [("fast", 2), ("stable", 2), ("Chebyshev", 4)])
def test_the_bound_is_not_much_above_the_error_of_the_worst_state(name, method, slack):
    problem = load(name)
    energies, vectors = eigen(problem.system)
    t = problem.interval[1] - problem.interval[0]
    for tol in (1e-4, problem.tol):
        plan = lv.plan(problem.system, METHODS[method](tol), t=problem.interval)
        starts = np.concatenate([vectors.T, 1j * vectors.T])
        ends = lv.ensemble(problem.system, plan, t=problem.interval, psi=starts).psi[-1]
        turned = np.exp(-1j * np.tile(energies, 2) * t)[:, None] * starts
        first, second = np.split(ends - turned, 2)
        # on each eigenvector the error is a real 2 x 2 matrix, and the worst state is one of them
        pairs = np.stack([first.view(float), second.view(float)], axis=-1)
        worst = np.linalg.norm(pairs, ord=2, axis=(1, 2)).max()
        assert worst <= plan.bound < slack * worst, (tol, plan.scheme)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_bound_is_within_ten_times_the_error_of_the_problem(name):
    problem = load(name)
    t = problem.interval[1] - problem.interval[0]
    energies, vectors = eigen(problem.system)
    psi = np.asarray(problem.start["psi"])
    wanted = vectors @ (np.exp(-1j * energies * t) * (vectors.T @ psi))
    for method in ("auto", "stable", "Chebyshev"):
        solution = lv.integrate(
            problem.system, METHODS[method](problem.tol), t=problem.interval, psi=psi
        )
        error = np.linalg.norm(solution.psi[-1] - wanted)
        # below 1e-12 it is that of roundings, which seldom add up
        assert error <= solution.stats["bound"] < max(10 * error, 1e-12), method


@pytest.mark.parametrize("mode", ["auto", "fast", "stable"])
@pytest.mark.parametrize("theta", [20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 1e4])
def test_a_splitting_takes_fewer_products_than_a_series(theta, mode):
    for tol in 10.0 ** -np.arange(3, 11):
        splitting = lv.plan(UNIT, METHODS[mode](tol), t=(0.0, theta))
        series = lv.plan(UNIT, lv.Chebyshev(tol), t=(0.0, theta))
        assert "splitting" in splitting.scheme
        assert splitting.products < series.products, tol
        assert splitting.products >= theta / 2  # which no splitting can do better


def test_products_are_those_of_the_plan():
    chain = load("tight_binding").system
    psi = random_state(np.random.default_rng(0), 50)
    for method in METHODS.values():
        for t in ((0.0, 30.0), (0.0, 1.0, 2.5, 30.0)):
            plan = lv.plan(chain, method(1e-6), t=t)
            solution = lv.integrate(chain, plan, t=t, psi=psi)
            assert solution.stats["products"] == plan.products


def test_a_real_start_has_the_shorter_series_if_that_is_the_cheaper():
    end, few = (0.0, 200.0), np.linspace(0.0, 200.0, 5)
    for t in (end, few):
        real = lv.plan(UNIT, METHODS["auto"](1e-6), t=t, psi=[1.0, 2.0])
        either = lv.plan(UNIT, METHODS["auto"](1e-6), t=t)
        assert "splitting" in either.scheme
        assert "Chebyshev" in real.scheme
        assert real.products < either.products


def bound(rung, x, steps, stretches):
    places = np.flatnonzero(rung.fractions * rung.theta * (1 + 1e-12) >= x)
    if not places.size:
        return np.inf
    k = places[0]
    logs = steps * np.log1p(rung.err[k])
    if rung.stable:
        of_form = rung.kappa[k] + rung.kappa[k] ** 2 / 2
        logs = min(logs, steps * rung.dphi[k] + stretches * of_form)
    return np.expm1(min(700.0, logs)) + ROUNDOFF * np.sqrt(steps) * rung.gain


@examples(50)
@given(
    thetas=st.lists(st.floats(0.01, 500.0), min_size=1, max_size=4),
    tol=st.floats(2.0, 12.0).map(lambda k: 10**-k),
    stable=st.booleans(),
)
def test_the_choice_is_the_cheapest_of_all(thetas, tol, stable):
    best, stretches = np.inf, 1 + np.count_nonzero(np.diff(thetas))
    for rung in ladder():
        for shorter in SHORTER if rung.stable or not stable else ():
            counts = [max(1, int(np.ceil(x * shorter / rung.theta))) for x in thetas]
            longest = max(x / count for x, count in zip(thetas, counts, strict=True))
            if bound(rung, longest, sum(counts), stretches) <= tol:
                best = min(best, rung.n * sum(counts))
    found = cheapest(np.array(thetas), tol, stable)
    assert (np.inf if found is None else found.shears) == best
    if found is not None:
        assert found.bound <= tol
        assert found.rung.stable or not stable
        assert (np.array(thetas) <= found.steps * found.rung.theta * (1 + 1e-12)).all()


def test_beyond_fifty_steps_a_stable_method_is_taken():
    few, many = (lv.plan(UNIT, METHODS["auto"](1e-3), t=(0.0, theta)) for theta in (400.0, 1e4))
    assert few.steps <= 50 < many.steps
    assert "fast" in few.scheme
    assert "stable" in many.scheme


def test_what_no_splitting_reaches_is_a_series_and_said_so():
    short, tol = (0.0, 3.0), 1e-14
    plan = lv.plan(UNIT, METHODS["auto"](tol), t=short)
    assert "Chebyshev" in plan.scheme
    assert "no splitting reaches" in str(plan)
    for mode in ("fast", "stable"):
        with pytest.raises(ValueError, match=rf"no {mode} splitting reaches tol = 1e-14.*\nhint"):
            lv.plan(UNIT, METHODS[mode](tol), t=short)
    with pytest.raises(ValueError, match=r"tol = 1e-13 is out of reach: .*\nhint: give tol of"):
        lv.plan(UNIT, METHODS["auto"](1e-13), t=(0.0, 300.0))


@pytest.mark.parametrize("shift", [-1e6, 1e9])
@pytest.mark.parametrize("method", METHODS)
def test_a_constant_added_to_all_energies_costs_the_roundoff_of_its_phase_alone(shift, method):
    rng, span = np.random.default_rng(1), (0.0, 10.0)
    a = rng.normal(size=(12, 12))
    matrix, psi = a + a.T + shift * np.eye(12), random_state(rng, 12)
    system, tol = lv.Schrodinger(matrix), 2e-16 * 10 * abs(shift) * 10
    plan = lv.plan(system, METHODS[method](tol), t=span, psi=psi)
    run = lv.integrate(system, plan, t=span, psi=psi)
    assert np.linalg.norm(run.psi[-1] - exact(matrix, 10.0, psi)) <= plan.bound <= tol
    with pytest.raises(ValueError, match=r"give tol of .*; energies are .*a constant taken off H"):
        lv.plan(system, METHODS[method](tol / 100), t=span)


SAVED = {
    "splitting": (UNIT, lv.SchrodingerSplitting(1e-6)),
    "series": (UNIT, lv.Chebyshev(1e-6)),
    "Krylov": (UNIT, lv.Lanczos(1e-6)),
}


@pytest.mark.parametrize(("system", "method"), SAVED.values(), ids=SAVED)
def test_a_plan_comes_back_from_its_file_and_runs_to_the_same_bits(tmp_path, system, method):
    t, psi = (0.0, 3.0, 7.5), [0.6, 0.8j]
    plan = lv.plan(system, method, t=t, psi=psi)
    plan.save(tmp_path / "plan.json")
    loaded = lv.Plan.load(tmp_path / "plan.json")
    assert loaded == plan
    assert (loaded.times, loaded.method, str(loaded)) == (t, method, str(plan))
    one, other = (lv.integrate(system, each, t=t, psi=psi) for each in (plan, loaded))
    assert one.psi.tobytes() == other.psi.tobytes()
    with pytest.raises(ValueError, match="its form must be field, not 'wave'"):
        lv.FieldPlan.load(tmp_path / "plan.json")


BROKEN = {
    "core": ({"core": []}, r"core is \(\)"),
    "kind": ({"core": {"kind": "shear"}}, "no propagator 'shear'"),
    "no core": ({"core": 3}, "core is 3"),
    "stops": ({"stops": [[1.0, 0]]}, "stops must be"),
    "no stops": ({"stops": []}, "has no steps"),
    "theta": ({"theta": "wide"}, "theta must be .* not 'wide'"),
    "bounds": ({"bounds": [2.0, 1.0]}, "bounds must be"),
    "bound": ({"bound": "small"}, "bound must be .* not 'small'"),
    "method": ({"method": {"name": "spark", "stages": 2}}, "its method is Spark"),
}


@pytest.mark.parametrize(("change", "message"), BROKEN.values(), ids=BROKEN)
def test_a_file_that_is_no_plan_of_a_wave_is_refused(tmp_path, change, message):
    path = tmp_path / "plan.json"
    lv.plan(UNIT, t=(0.0, 1.0)).save(path)
    path.write_text(checksum.signed({**checksum.verified(path), **change}))
    with pytest.raises(ValueError, match=f"no plan that liouville saved: .*{message}"):
        lv.Plan.load(path)


@pytest.mark.parametrize("method", ["auto", lv.Magnus(4)], ids=["windows", "steps"])
def test_ctrl_c_ends_a_plan_that_takes_long(method, pressing):
    """It would take minutes, and what was found by then is not kept."""
    drive = [(lambda t, params: ca.sin(t), np.ones((2, 2)))]
    system, end = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive), 2e6
    if method != "auto":
        well = lv.Grid(-10, 10, 2**18, lambda t, x, params: ca.exp(-((x - ca.sin(t)) ** 2)))
        system, end = lv.Schrodinger(well, bounds=(-1.0, 1.0)), 100.0
    lv.plan(system, method, t=(0.0, 1e-9))
    with pressing(0.2), pytest.raises(KeyboardInterrupt):
        lv.plan(system, method, t=(0.0, end))
    assert lv.plan(system, method, t=(0.0, 1e-9)).products > 0


@pytest.mark.parametrize("method", [lv.Chebyshev(1e-5), lv.Magnus(tol=1e-5)], ids=str)
@pytest.mark.parametrize("function", [lv.plan, lv.integrate, lv.ensemble])
def test_ctrl_c_ends_the_look_at_functions_of_time_before_a_run(function, method, pressing):
    """They are looked at a million times, in 16 s."""
    drive = [(lambda t, _: sum(ca.sin((1 + k / 99) * t) for k in range(200)), np.ones((2, 2)))]
    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive)
    starts = {lv.plan: {}, lv.integrate: {"psi": [1, 0]}, lv.ensemble: {"psi": np.eye(2)}}
    function(system, method, t=(0.0, 1e-3), **starts[function])
    with pressing(0.3) as since, pytest.raises(KeyboardInterrupt):
        function(system, method, t=(0.0, 1e6), **starts[function])
    assert since() < 0.5


#: Functions of time over a run of some length, with steps that differ much or are many.
DRIVES = {
    "wave": lambda t, end: ca.sin(t),
    "pulse": lambda t, end: (
        3 * ca.exp(-(((t - end / 2) / (end / 20)) ** 2)) * ca.cos(5 * t) + 0.1 * ca.cos(t)
    ),
    "short pulse": lambda t, end: (
        0.05 * ca.cos(t) + 300 * ca.exp(-(((t - 0.37 * end) / (end / 2000)) ** 2))
    ),
    "chirp": lambda t, end: ca.cos(0.2 * t + 4 * t * t / end),
    "decay": lambda t, end: 4 * ca.exp(-5 * t / end) * ca.cos(3 * t),
}
PIECES = 200


@pytest.mark.parametrize("is_back", [False, True], ids=["on", "back"])
@pytest.mark.parametrize("name", DRIVES)
def test_many_steps_are_estimated_by_some_in_all_parts_of_a_run(name, is_back):
    end, method = 200.0, lv.Magnus(4, 1e-6)
    function, x = DRIVES[name], np.array([[0.0, 1.0], [1.0, 0.0]])
    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=[(lambda t, _: function(t, end), x)])
    plan = lv.plan(system, method, t=(end, 0.0) if is_back else (0.0, end))
    assert plan.reasons[1].endswith("as counted in parts of the run")
    # short pieces with their shares of the tolerance have all steps counted
    times = np.linspace(0.0, end, PIECES + 1)
    piece = lv.Magnus(4, method.tol / PIECES)
    parts = [lv.plan(system, piece, t=t) for t in itertools.pairwise(times)]
    counted = sum(part.products for part in parts)
    assert 0.8 * counted < plan.products < 1.3 * counted


def test_a_run_over_many_jumps_takes_fewer_products_than_its_plan_says():
    drive = [(lambda t, _: ca.sign(ca.sin(0.5 * t)), np.array([[0.0, 1.0], [1.0, 0.0]]))]
    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive)
    plan = lv.plan(system, lv.Magnus(4, 1e-6), t=(0.0, 500.0))
    taken = lv.integrate(system, plan, t=(0.0, 500.0), psi=[1.0, 0.0]).stats["products"]
    assert taken <= plan.products < 3 * taken


def test_roundings_of_late_times_are_no_reason_for_shorter_steps():
    end, x = 20_000.0, np.array([[0.0, 1.0], [1.0, 0.0]])

    def pulse(t, _):
        return 3 * ca.exp(-(((t - end / 2) / (end / 20)) ** 2)) * ca.cos(5 * t)

    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=[(pulse, x)])
    # its run takes 2.2e7
    assert 2.2e7 < lv.plan(system, lv.Magnus(4), t=(0.0, end)).products < 2e8


def test_a_run_of_few_steps_has_all_of_them_counted():
    drive = [(lambda t, _: ca.sin(t), np.ones((2, 2)))]
    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive)
    plan = lv.plan(system, lv.Magnus(4, 1e-4), t=(0.0, 10.0))
    assert plan.reasons[1].endswith(" or fewer")


def test_planning_of_many_steps_takes_a_small_part_of_their_run():
    drive = [(lambda t, _: ca.sin(t), np.ones((2, 2)))]
    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive)
    run, plans = {"t": (0.0, 300.0)}, []
    for _ in range(3):
        started = time.process_time()
        plan = lv.plan(system, lv.Magnus(4), **run)
        plans.append(time.process_time() - started)
    started = time.process_time()
    lv.integrate(system, plan, psi=[1.0, 0.0], **run)
    assert min(plans) < 0.25 * (time.process_time() - started)


@pytest.mark.parametrize(
    ("dimension", "tol", "end"), [(2, 1e-8, 1e-3), (4, 1e-8, 0.2), (20, 1e-8, 4.0), (20, 1e-3, 9.0)]
)
def test_the_plan_of_lanczos_counts_the_products_that_a_run_takes(dimension, tol, end):
    matrix = np.random.default_rng(1).normal(size=(60, 60))
    system = lv.Schrodinger(matrix + matrix.T)
    method = lv.Lanczos(tol, dimension=dimension)
    planned = lv.plan(system, method, t=(0, end)).products
    made = lv.integrate(system, method, t=(0, end), psi=np.ones(60)).stats["products"]
    assert 0.7 * made < planned < 1.4 * made


def test_krylov_spaces_that_take_hours_are_refused_and_costly_ones_said():
    system = lv.Schrodinger(lv.Lattice(20))
    with pytest.raises(ValueError, match=r"dimension 2 take about 9.8e\+07 products, .* 12 12"):
        lv.plan(system, lv.Lanczos(1e-8, dimension=2), t=(0, 1))
    plan = lv.plan(system, lv.Lanczos(1e-8, dimension=4), t=(0, 1))
    assert "spaces of dimension 4 take about 6.4e+02 products" in plan.reasons[0]
    # two levels need no more
    qubit = lv.Schrodinger(np.diag([1.0, -1.0]))
    assert lv.plan(qubit, lv.Lanczos(1e-8, dimension=2), t=(0, 1)).reasons[0].endswith("energies")
