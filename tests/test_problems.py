"""Each problem of the library starts consistently, reaches its reference and keeps what it says."""

import json
from pathlib import Path

import numpy as np
import pytest

import liouville as lv
from liouville import problems

DATA = json.loads((Path(__file__).parent / "data" / "mechanics_reference.json").read_text())[
    "problems"
]

# Largest error at the references, relative to the largest entry, with Spark(6) and the module's h:
# a hundred times what was measured. The top turns fifty times, so roundoff weighs more.
TOLERANCE = dict.fromkeys(problems.names(), 1e-12) | {"heavy_top": 1e-10}
# What the motion does not depend on: one mass scale, and the completion of the top's mass matrix.
IRRELEVANT = {
    "pendulum": {"m"},
    "spherical_pendulum": {"m"},
    "chain": {"m"},
    "heavy_top": {"mu"},
}
# Polylines at the end of an outline that are springs and may stretch.
SPRINGS = {"car_axis": 2, "andrews": 1}
PLANAR = ("pendulum", "double_pendulum", "chain", "slider_crank", "car_axis", "andrews")


def integrate(problem, stages=6, **options):
    start = options.pop("start", problem.start)
    method = lv.Spark(stages=stages)
    return lv.integrate(problem.system, method, t=problem.interval, h=problem.h, **options, **start)


def error(problem, solution, keys=("q", "v")):
    """Return the largest deviation from the references within the interval."""
    worst = 0.0
    for time, states in problem.reference.items():
        if time <= problem.interval[1]:
            k = int(np.argmin(abs(solution.t - time)))
            assert solution.t[k] == pytest.approx(time, rel=1e-14)
            for key in states.keys() & set(keys):
                expected = np.asarray(states[key])
                miss = abs(solution.states[key][k] - expected).max()
                worst = max(worst, miss / abs(expected).max())
    return worst


@pytest.fixture(scope="module", params=problems.names())
def case(request):
    problem = problems.load(request.param)
    return request.param, problem, integrate(problem)


def test_start_is_consistent(case):
    _, problem, solution = case
    assert abs(solution.residuals["constraint"][0]).max() < 1e-15
    assert abs(solution.residuals["hidden"][0]).max() < 1e-14
    moved = problem.system.consistent(**problem.start)
    for key, values in problem.start.items():
        np.testing.assert_allclose(moved[key], values, rtol=0, atol=1e-15)


def test_a_start_off_the_constraint_is_refused(case):
    _, problem, _ = case
    start = dict(problem.start, q=np.asarray(problem.start["q"]) + 1e-3)
    with pytest.raises(ValueError, match="constraint"):
        integrate(problem, start=start)


def test_reference_is_reached(case):
    name, problem, solution = case
    assert error(problem, solution) < TOLERANCE[name]
    assert error(problem, solution, keys=("lam",)) < 1e-11


def test_own_step_suits_three_stages(case):
    _, problem, _ = case
    assert error(problem, integrate(problem, stages=3)) < 1e-6


def test_reference_sees_every_parameter(case):
    name, problem, _ = case
    unseen = set()
    for parameter, value in problem.system.params.items():
        params = {parameter: np.asarray(value) * (1 + 1e-6)}
        start = problem.system.consistent(params=params, **problem.start)
        if error(problem, integrate(problem, params=params, start=start)) < 2 * TOLERANCE[name]:
            unseen.add(parameter)
    assert unseen == IRRELEVANT.get(name, set())


def test_conserved_invariants_are_constant_and_no_others(case):
    _, problem, solution = case
    constant = set()
    for name, values in solution.invariants.items():
        # The pendulum's energy is zero: measure against the kinetic energy's size as well.
        scale = max(abs(values[0]), abs(np.sum(solution.p * solution.v, axis=1)).max())
        if np.ptp(values) < 1e-12 * scale:
            constant.add(name)
    assert constant == set(problem.conserved)
    assert set(problem.conserved) <= set(problem.system.invariants)


def test_pendulum_reaches_its_far_references():
    pendulum = problems.load("pendulum")
    method = lv.Spark(stages=6)
    for time, tolerance in ((100.0, 1e-11), (2000.0, 1e-9)):
        solution = lv.integrate(
            pendulum.system, method, t=(0.0, time), h=0.05, every=1000, **pendulum.start
        )
        np.testing.assert_allclose(
            solution.q[-1], pendulum.reference[time]["q"], rtol=0, atol=tolerance
        )


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("spherical_pendulum", "spherical"),
        ("double_pendulum", "double_pendulum"),
        ("moving_wire", "moving_wire"),
    ],
)
def test_data_file_and_library_agree(name, key):
    problem, data = problems.load(name), DATA[key]
    assert problem.start["q"] == pytest.approx([float(x) for x in data["y0"]], rel=1e-15)
    assert problem.start["v"] == pytest.approx([float(x) for x in data["z0"]], rel=1e-15)
    for time, states in problem.reference.items():
        expected = data["end_states"][f"{time:g}"]
        for state, column in (("q", "y"), ("v", "z"), ("lam", "psi")):
            assert states[state] == pytest.approx([float(x) for x in expected[column]], rel=1e-15)


def test_heavy_top_reaches_the_data_of_another_top():
    top, data = problems.load("heavy_top"), DATA["heavy_top_quaternion"]
    params = {"m": 1.0, "J": (0.0, 0.0, 0.5), "X": (0.0, 0.0, 1.0), "g": 1.0, "mu": 2.0}
    q, v = (np.array(data[key], dtype=float) for key in ("y0", "z0"))
    method = lv.Spark(stages=6)
    solution = lv.integrate(top.system, method, t=(0.0, 5.0), h=0.05, params=params, q=q, v=v)
    expected = data["end_states"]["5"]
    for found, column in ((solution.q, "y"), (solution.v, "z"), (solution.lam, "psi")):
        np.testing.assert_allclose(found[-1], np.array(expected[column], dtype=float), rtol=1e-11)
    assert np.ptp(solution.invariants["angular_momentum"]) < 1e-12
    assert np.ptp(solution.invariants["spin"]) < 1e-12


@pytest.mark.parametrize("links", [1, 3, 25])
def test_chain_of_any_length_starts_hanging_and_keeps_its_energy(links):
    chain = problems.load("chain")
    system, start = chain.build(links), chain.start_for(links)
    assert len(system.coordinates) == 2 * links
    assert len(system.constraints) == links
    assert start["q"][-1] == -1.0
    assert start["v"][-2] == pytest.approx(1.0, rel=1e-15)
    solution = lv.integrate(system, lv.Spark(stages=4), t=(0.0, 0.2), h=0.1 / links, **start)
    assert np.ptp(solution.invariants["energy"]) < 1e-8
    assert abs(solution.residuals["constraint"]).max() < 1e-13


@pytest.mark.parametrize("name", PLANAR)
def test_outline_moves_rigid_bodies(name):
    problem = problems.load(name)
    solution = integrate(problem, stages=3, every=10)
    lengths = []
    for q in solution.q:
        lines = problem.outline(q, problem.system.params)
        assert all(line.shape[1] == 2 for line in lines)
        rigid = lines[: len(lines) - SPRINGS.get(name, 0)]
        lengths.append(np.concatenate([np.hypot(*np.diff(line, axis=0).T) for line in rigid]))
    assert min(lengths[0]) > 0
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], np.shape(lengths)), rtol=1e-12)


def test_every_problem_is_listed():
    files = {path.stem for path in Path(problems.__file__).parent.glob("*.py")} - {"__init__"}
    assert set(problems.names()) == files
    assert set(PLANAR) == {name for name in files if hasattr(problems.load(name), "outline")}


def test_unknown_problem_is_refused_with_the_nearest_name():
    with pytest.raises(ValueError, match=r"'andrew'\nhint: did you mean 'andrews'"):
        problems.load("andrew")
