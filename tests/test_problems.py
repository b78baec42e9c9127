"""Each mechanical problem starts consistently, reaches its reference and keeps what it says."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import liouville as lv
from liouville import problems

DATA = json.loads((Path(__file__).parent / "data" / "mechanics_reference.json").read_text())[
    "problems"
]

# Largest error at the references, relative to the largest entry, with Spark(6) and the module's h:
# ten times what was measured. The top turns some fifty times, so roundoff weighs more;
# the Fekete points are almost at rest, so their speeds are small beside it.
CASES = (
    *problems.MECHANICAL,
    *problems.ASSEMBLED,
    *problems.REDUNDANT,
    *problems.NONHOLONOMIC,
    *problems.CONTACTS,
)
TOLERANCE = dict.fromkeys(CASES, 1e-13) | {
    "heavy_top": 1e-11,
    "kepler_on_sphere": 1e-11,
    "bricard": 1e-12,
    "fekete": 1e-12,
    "spatial_slider_crank": 1e-12,
    "belt": 1e-12,
    "rocking_block": 1e-12,
}
# Parameters that the motion does not depend on: one mass scale, the completion of the top's mass
# matrix, and friction where nothing slips.
IRRELEVANT = {
    "pendulum": {"m"},
    "doubled_rod": {"m"},
    "spherical_pendulum": {"m"},
    "chain": {"m"},
    "rigid_chain": {"m", "mu"},
    "heavy_top": {"mu"},
    "knife_edge": {"m", "J"},
    "ladder": {"m"},
    "rocking_block": {"m", "mu"},
}
# Exponents of length and time of the parameters, in units of mass that leave stiffness alone.
UNITS = {
    "pendulum": {"m": (0, 2), "l": (1, 0), "g": (1, -2)},
    "spherical_pendulum": {"m": (0, 2), "l": (1, 0), "g": (1, -2)},
    "double_pendulum": {"m1": (0, 2), "m2": (0, 2), "l1": (1, 0), "l2": (1, 0), "g": (1, -2)},
    "chain": {"m": (0, 2), "l": (1, 0), "g": (1, -2)},
    "polymer": {"m": (0, 2), "l": (1, 0), "k": (2, 0), "c": (0, 0), "a": (0, 0)},
    "car_axis": {
        "M": (0, 2),
        "eps": (0, 0),
        "L": (1, 0),
        "L0": (1, 0),
        "r": (1, 0),
        "omega": (0, -1),
        "g": (1, -2),
    },
    "relativistic_particle": {
        "m": (0, 2),
        "c": (1, -1),
        "e": (0, 0),
        "B": (0, 1),
        "E": (1, 0),
        "l": (1, 0),
    },
}
# Polylines at the end of an outline that are springs and may stretch.
SPRINGS = {"car_axis": 2, "andrews": 1}
OUTLINED = (
    "pendulum",
    "doubled_rod",
    "hinged_fourbar",
    "double_pendulum",
    "chain",
    "slider_crank",
    "car_axis",
    "andrews",
    "circular_track",
    "chaplygin_sleigh",
    "spherical_pendulum",
    "heavy_top",
    "rigid_chain",
    "bricard",
    "rolling_disk",
    *problems.CONTACTS,
)


def integrate(problem, stages=6, **options):
    start = options.pop("start", problem.start)
    method = lv.Spark(stages=stages)
    return lv.integrate(problem.system, method, t=problem.interval, h=problem.h, **options, **start)


def error(problem, solution, keys=("q", "v")):
    """Return the largest deviation from the references in the solution's span."""
    worst = 0.0
    for time, states in problem.reference.items():
        if time <= solution.t[-1]:
            k = int(np.argmin(abs(solution.t - time)))
            found = {key: values[k] for key, values in solution.states.items()}
            if solution.contacts:  # whose changes move the records that follow
                at = solution(time)
                found = {key: getattr(at, key) for key in ("q", "v")}
            else:
                assert solution.t[k] == pytest.approx(time, rel=1e-14)
            for key in states.keys() & set(keys):
                expected = np.asarray(states[key])
                miss = abs(found[key] - expected).max()
                worst = max(worst, miss / abs(expected).max())
    return worst


@pytest.fixture(scope="module", params=CASES)
def case(request):
    problem = problems.load(request.param)
    return request.param, problem, integrate(problem)


def test_start_is_consistent(case):
    _, problem, solution = case
    assert abs(solution.residuals["constraint"][0]).max(initial=0) < 1e-15
    for name in solution.residuals.keys() - {"constraint"}:
        assert abs(solution.residuals[name][0]).max(initial=0) < 1e-14
    moved = problem.system.consistent(**problem.start)
    for key, values in problem.start.items():
        size = max(1.0, np.abs(values).max())
        # what meets equations to roundoff is known to roundoff times their condition
        np.testing.assert_allclose(moved[key], values, rtol=0, atol=1e-14 * size)


def test_a_start_off_the_constraint_is_refused(case):
    name, problem, _ = case
    key = "v" if name in problems.NONHOLONOMIC else "q"
    values = np.asarray(problem.start[key])
    start = dict(problem.start, **{key: values - np.linspace(1e-3, 2e-3, len(values))})
    with pytest.raises(
        ValueError, match="penetrates" if name in problems.CONTACTS else "constraint"
    ):
        integrate(problem, start=start)


def test_reference_is_reached(case):
    name, problem, solution = case
    assert error(problem, solution) < TOLERANCE[name]
    assert error(problem, solution, keys=("lam",)) < 1e-13


def test_own_step_suits_three_stages(case):
    _, problem, _ = case
    assert error(problem, integrate(problem, stages=3)) < 1e-6


def test_reference_sees_every_parameter(case):
    name, problem, _ = case
    unseen = set()
    for parameter, value in problem.system.params.items():
        params = {parameter: np.asarray(value) * (1 - 1e-6)}
        start = problem.system.consistent(params=params, **problem.start)
        if error(problem, integrate(problem, params=params, start=start)) < 2 * TOLERANCE[name]:
            unseen.add(parameter)
    assert unseen == IRRELEVANT.get(name, set())


@pytest.mark.parametrize("name", UNITS)
def test_units_do_not_matter(name):
    problem, length, time = problems.load(name), 2.0, 0.5
    solution = integrate(problem, stages=3)
    scaled = lv.integrate(
        problem.system,
        lv.Spark(stages=3),
        t=(problem.interval[0], problem.interval[1] * time),
        h=problem.h * time,
        params={
            key: value * length ** UNITS[name][key][0] * time ** UNITS[name][key][1]
            for key, value in problem.system.params.items()
        },
        q=np.multiply(problem.start["q"], length),
        v=np.multiply(problem.start["v"], length / time),
    )
    np.testing.assert_allclose(scaled.q, length * solution.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(scaled.v, length / time * solution.v, rtol=0, atol=1e-10)
    for values in (scaled.invariants[invariant] for invariant in problem.conserved):
        assert np.ptp(values) < 1e-9 * abs(scaled.p * scaled.v).max()


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
    for time, tolerance in ((100.0, 1e-12), (2000.0, 2e-10)):
        solution = lv.integrate(
            pendulum.system, method, t=(0.0, time), h=0.05, every=200, **pendulum.start
        )
        assert error(pendulum, solution, keys=("q", "v", "lam")) < tolerance


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


def test_heavy_top_is_also_the_small_top_of_the_data_file():
    top, data = problems.load("heavy_top"), DATA["heavy_top_quaternion"]
    params = {"m": 1.0, "J": (0.0, 0.0, 0.5), "X": (0.0, 0.0, 1.0), "g": 1.0, "mu": 2.0}
    q, v = (np.array(data[key], dtype=float) for key in ("y0", "z0"))

    def end(t, h, stages):
        method = lv.Spark(stages=stages)
        solution = lv.integrate(top.system, method, t=(0, t), h=h, params=params, q=q, v=v)
        return solution.q[-1], solution.v[-1], solution.lam[-1]

    exact = data["end_states"]["5"]
    for found, key in zip(end(5.0, 0.05, 6), ("y", "z", "psi"), strict=True):
        np.testing.assert_allclose(found, np.array(exact[key], dtype=float), rtol=0, atol=1e-13)
    # One coarse step depends on how the mass matrix is completed, the motion does not.
    for stages, step in data["spark_one_step_h=1/10"].items():
        q1, v1, _ = end(0.1, 0.1, int(stages))
        np.testing.assert_allclose(q1, np.array(step["y1"], dtype=float), rtol=0, atol=1e-14)
        np.testing.assert_allclose(v1, np.array(step["z1"], dtype=float), rtol=0, atol=1e-14)


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


def test_chain_of_a_hundred_links_reaches_its_reference():
    chain = problems.load("chain")
    method = lv.Spark(stages=4)
    solution = lv.integrate(
        chain.build(100), method, t=(0.0, 1.0), h=0.005, every=200, **chain.start_for(100)
    )
    tip = np.concatenate([solution.q[-1, -2:], solution.v[-1, -2:]])
    expected = (
        0.68569408663740427965,
        -0.71423594003739304957,
        0.26425055159943680195,
        0.26940306299187936705,
    )  # computed in extended precision
    np.testing.assert_allclose(tip, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("rods", "revolute"), [(1, False), (1, True), (2, True), (9, True)])
def test_rigid_chain_of_either_joint_keeps_its_energy(rods, revolute):
    chain = problems.load("rigid_chain")
    system, start = chain.build(rods, revolute), chain.start_for(rods, revolute)
    assert len(system.coordinates) == 7 * rods
    assert len(system.constraints) == (6 if revolute else 4) * rods
    solution = lv.integrate(system, lv.Spark(stages=4), t=(0.0, 0.2), h=0.05 / rods, **start)
    assert np.ptp(solution.invariants["energy"]) < 1e-11
    assert abs(solution.residuals["constraint"]).max() < 1e-14
    assert abs(solution.residuals["hidden"]).max() < 1e-14


@pytest.mark.parametrize("name", OUTLINED)
def test_outline_moves_rigid_bodies(name):
    problem = problems.load(name)
    solution = integrate(problem, stages=3, every=10)
    lengths = []
    for q in solution.q:
        lines = problem.outline(q, SimpleNamespace(**problem.system.params))
        assert len({line.shape[1] for line in lines} & {2, 3}) == 1
        rigid = lines[: len(lines) - SPRINGS.get(name, 0)]
        lengths.append(
            np.concatenate([np.linalg.norm(np.diff(line, axis=0), axis=1) for line in rigid])
        )
    assert min(lengths[0]) > 0
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], np.shape(lengths)), rtol=1e-12)


def test_every_problem_is_listed():
    files = {path.stem for path in Path(problems.__file__).parent.glob("[!_]*.py")}
    assert set(problems.names()) == files
    assert set(OUTLINED) == {name for name in files if hasattr(problems.load(name), "outline")}


def test_a_problem_is_imported_where_it_is_first_used():
    assert lv.problems.euler_top is problems.load("euler_top")
    assert not hasattr(problems, "eulertop")
    with pytest.raises(
        TypeError, match="name must be that of a problem, such as 'pendulum', not 3"
    ):
        problems.load(3)


def test_unknown_problem_is_refused_with_the_nearest_name():
    with pytest.raises(ValueError, match=r"'andrew'\nhint: did you mean 'andrews'"):
        problems.load("andrew")
    for nothing in ("", "zzz"):
        with pytest.raises(
            ValueError, match=f"'{nothing}'\nhint: there are pendulum, .*, lattice3d$"
        ):
            problems.load(nothing)
