import pickle
from dataclasses import FrozenInstanceError, replace

import casadi as ca
import numpy as np
import pytest
from scipy import integrate

import liouville as lv
from liouville import problems
from liouville._solution import points
from liouville.problems import pendulum


@pytest.fixture(scope="module")
def solution():
    pendulum = problems.load("pendulum")
    return lv.integrate(pendulum.system, lv.Spark(stages=2), t=(0.0, 1.0), h=0.02, **pendulum.start)


def test_states_are_attributes_with_time_as_the_first_axis(solution):
    assert solution.q.shape == solution.v.shape == solution.p.shape == (51, 2)
    assert solution.lam.shape == (51, 1)
    assert solution.q is solution.states["q"]


def test_a_missing_state_is_refused_with_those_there_are(solution):
    with pytest.raises(AttributeError, match=r"no 'z'\nhint: its states are q, v, p, lam"):
        _ = solution.z


def test_a_run_without_states_says_how_to_get_them(solution):
    with pytest.raises(AttributeError, match=r"stored no states\nhint: .*states=True"):
        _ = replace(solution, states={}).q


def test_what_is_recorded_cannot_be_edited(solution):
    with pytest.raises(ValueError, match="read-only"):
        solution.q[0, 0] = 0.0
    with pytest.raises(FrozenInstanceError):
        solution.status = "failed"


@pytest.mark.parametrize(
    ("values", "drift"),
    [([-2.0, -2.0, -1.0], [0.0, 0.0, 0.5]), ([1e-16, 1e-16, -0.25], [0.0, 0.0, 0.25])],
    ids=["relative", "absolute where the start is zero but for roundoff"],
)
def test_drift_is_measured_from_the_start(solution, values, drift):
    changed = replace(solution, invariants={"spin": np.array(values)})
    np.testing.assert_allclose(changed.invariant_drift("spin"), drift, rtol=1e-15)


@pytest.mark.parametrize("unit", [1.0, 2.0**-70, 2.0**70])
def test_drifts_have_no_unit(solution, unit):
    energy = {"energy": unit * solution.invariants["energy"]}
    momenta = {"p": unit * solution.p, "v": solution.v}
    zero = replace(solution, invariants=energy, states=momenta)
    other = replace(zero, invariants={"energy": energy["energy"] + unit})
    assert repr(zero) == repr(solution)
    assert repr(solution).endswith("(energy, relative to the kinetic)>")
    kinetic = np.abs(np.sum(solution.v * solution.p, axis=1) / 2).max()
    change = np.abs(solution.invariants["energy"] - solution.invariants["energy"][0])
    np.testing.assert_allclose(zero.invariant_drift("energy"), change / kinetic, rtol=1e-13)
    np.testing.assert_allclose(other.invariant_drift("energy"), change, rtol=0, atol=3e-16)
    # without velocities there is nothing to compare a zero with
    bare = replace(zero, states={})
    assert bare.is_drift_absolute("energy")
    np.testing.assert_array_equal(bare.invariant_drift("energy"), unit * change)


def test_the_message_is_printed(solution):
    ended = replace(solution, message="event 'low' at t = 1\nhint: none")
    assert repr(ended) == repr(solution)[:-1] + "\n event 'low' at t = 1\n hint: none>"
    nothing = replace(ended, t=solution.t[:0], status="failed")
    assert repr(nothing).endswith("\n event 'low' at t = 1\n hint: none>")
    assert repr(replace(ended, path="run")).endswith("'run'\n event 'low' at t = 1\n hint: none>")
    many = lv.ensemble(
        solution.system,
        lv.Spark(2),
        t=(0, 1),
        h=0.1,
        events={"low": lv.Event(lambda t, q, v, lam, p: q[0] - 0.9, terminal=True)},
        q=np.tile(solution.q[0], (2, 1)),
        v=np.zeros((2, 2)),
    )
    assert repr(many).endswith("\n events ended 2 of 2 members>")
    failed = replace(many, message="1 of 2 members failed")
    assert "\n 1 of 2 members failed\n events ended 2 of 2" in repr(failed)


@pytest.fixture(scope="module")
def damped():
    pendulum = problems.load("pendulum")
    return lv.integrate(
        pendulum.system, lv.HHT(-0.3), t=(0.0, 1.0), rtol=1e-3, atol=[1e-3, 1e-4], **pendulum.start
    )


def test_accelerations_are_those_of_the_forces_and_reactions(damped):
    gravity = np.array([0, -9.81])
    np.testing.assert_allclose(damped.acceleration, gravity + damped.reaction(), atol=1e-12)
    np.testing.assert_allclose(damped.a, np.broadcast_to(gravity, damped.a.shape), atol=1e-12)


def test_the_energy_is_what_it_was_and_the_work_less_what_was_dissipated(solution):
    pushed = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - 200 * q[0] ** 2,
        force=lambda t, q, v, params: [ca.cos(t)],
        q=("x",),
    )
    run = lv.integrate(pushed, lv.HHT(), t=(0.0, 4.0), h=0.05, q=[0.1], v=[0.0])
    energy = run.invariants["energy"]
    np.testing.assert_allclose(energy, energy[0] + run.work - run.dissipated, rtol=1e-14)
    work = integrate.cumulative_trapezoid(run.v[:, 0] * np.cos(run.t), run.t, initial=0)
    np.testing.assert_allclose(run.work, work, atol=1e-14)
    assert 0.1 * energy[0] < run.dissipated[-1] < energy[0]
    with pytest.raises(AttributeError, match=r"no 'work'\nhint: HHT and its relatives"):
        _ = solution.work


def test_a_system_that_tells_no_potential_has_no_balance():
    free = lv.Mechanical(
        velocity=lambda t, y, z, params: z,
        momentum=lambda t, y, z, params: z,
        force=lambda t, y, z, params: -z,
        y=1,
        invariants={"energy": lambda t, y, z, params: z[0] ** 2 / 2},
    )
    solution = lv.integrate(free, lv.HHT(), t=(0.0, 1.0), h=0.1, y=[0.0], z=[1.0])
    assert solution.balance == {}
    assert solution.a.shape == (11, 1)
    with pytest.raises(AttributeError, match=r"hint: .* for a Lagrangian or a Structure"):
        _ = solution.dissipated


def test_controlled_steps_are_told_as_such(damped):
    steps = np.diff(damped.t)
    assert damped.h == pytest.approx(np.mean(steps))
    assert damped.tolerances == {"rtol": 1e-3, "atol": [1e-3, 1e-4]}
    assert f"{len(steps)} steps of mean h = {damped.h:.6g}" in repr(damped)


def test_an_unknown_invariant_is_refused_with_those_there_are(solution):
    with pytest.raises(ValueError, match=r"no invariant 'enrgy'\nhint: it has energy"):
        solution.invariant_drift("enrgy")


def test_repr_tells_how_it_went_and_what_was_kept_worst(solution):
    changed = replace(
        solution,
        status="failed",
        invariants={"energy": np.array([2.0, 2.5]), "spin": np.array([1.0, np.nan])},
        residuals={"constraint": np.array([[1e-16], [-3e-9]]), "hidden": np.zeros((2, 1))},
    )
    assert repr(changed) == (
        f"<Solution failed: 50 steps of h = 0.02, t = 0 to 1, {solution.method}\n"
        " worst residual 3.0e-09 (constraint), worst drift nan (spin)>"
    )


def test_an_energy_that_a_force_changes_has_no_drift(tmp_path):
    def oscillator(force):
        return lv.Lagrangian(lambda t, q, v, p: (v[0] ** 2 - q[0] ** 2) / 2, q=1, force=force)

    span = {"t": (0.0, 1.0), "h": 0.1, "q": [1.0], "v": [0.0]}
    free, damped = (
        lv.integrate(oscillator(force), lv.Spark(2), **span)
        for force in (None, lambda t, q, v, p: -0.1 * v)
    )
    damped.save(tmp_path / "damped.npz")
    assert "worst drift" in repr(free)
    for found in (damped, lv.load(tmp_path / "damped.npz")):
        size = found.invariant_drift("energy").max()
        assert repr(found).endswith(f"\n largest change {size:.1e} (energy)>")
        assert "change of energy" in found._repr_html_()


def test_the_reaction_of_a_pendulum_is_the_pull_of_its_rod(solution):
    # g = (|q|^2 - l^2) / 2, so that -g_q^T lam = -q lam; gravity and acceleration give it too.
    np.testing.assert_allclose(solution.reaction(), -solution.q * solution.lam, rtol=1e-14)
    tension = 9.81 * -solution.q[:, 1] + np.sum(solution.v**2, axis=1)
    np.testing.assert_allclose(solution.reaction("rod"), -solution.q * tension[:, None], atol=1e-6)


def test_reactions_of_single_constraints_add_up_to_that_of_all():
    problem = problems.load("double_pendulum")
    solution = lv.integrate(
        problem.system, lv.Spark(stages=2), t=(0.0, 0.1), h=0.01, **problem.start
    )
    names = solution.names["constraints"]
    assert len(names) == 2
    parts = [solution.reaction(name) for name in names]
    np.testing.assert_allclose(sum(parts), solution.reaction(), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(solution.reaction(-1), parts[-1])


def test_a_reaction_that_cannot_be_given_says_why(solution):
    with pytest.raises(ValueError, match=r"no constraint 'rope'\nhint: it has rod"):
        solution.reaction("rope")
    with pytest.raises(ValueError, match=r"constraint must be below 1, the number of them, not 1"):
        solution.reaction(1)
    for several in (["rod", "rod"], 0.5, True):
        with pytest.raises(TypeError, match=r"a name or index, not .*\nhint: reactions add up"):
            solution.reaction(several)
    with pytest.raises(ValueError, match=r"need the system.*\nhint: liouville.load\(path, s"):
        replace(solution, system=None).reaction()


def test_times_are_selected_as_views_whose_drift_is_from_the_start_of_the_run(solution):
    part = solution.sel(time=slice(0.3, 0.52))
    rows = (solution.t >= 0.3) & (solution.t <= 0.52)
    assert part.t.tobytes() == solution.t[rows].tobytes()
    assert np.shares_memory(part.q, solution.q)
    np.testing.assert_array_equal(part.lam, solution.lam[rows])
    np.testing.assert_array_equal(part.reaction(), solution.reaction()[rows])
    drift = solution.invariant_drift("energy")
    kinetic = [np.abs(np.sum(x.v * x.p, axis=1)).max() for x in (part, solution)]
    drift_of_part = part.invariant_drift("energy") * kinetic[0]
    np.testing.assert_allclose(drift_of_part, drift[rows] * kinetic[1], rtol=1e-14)
    np.testing.assert_allclose(part(0.41).q, solution(0.41).q, rtol=1e-10)
    assert solution.sel(time=slice(0.52, 0.3)).t.tobytes() == part.t.tobytes()
    assert solution.t[35] > 0.7
    assert len(solution.sel(time=slice(0, 0.7)).t) == 36
    thin = solution.sel(time=slice(None, None, 10))
    np.testing.assert_array_equal(thin.v, solution.v[::10])
    assert thin.dense_order == 0


def test_coordinates_are_selected_by_name_and_other_arrays_stay(solution):
    part = solution.sel(coordinate=["y"])
    np.testing.assert_array_equal(part.v, solution.v[:, 1:])
    np.testing.assert_array_equal(part.lam, solution.lam)
    assert part.names["coordinates"] == ("y",)
    np.testing.assert_array_equal(solution.sel(coordinate=["y", "x"]).q, solution.q[:, ::-1])
    with pytest.raises(ValueError, match=r"reaction .* all coordinates, not y\nhint: ask before"):
        part.reaction()
    with pytest.raises(ValueError, match="dense output needs the states of all steps"):
        part(0.5)


@pytest.mark.parametrize(
    ("wanted", "kind", "words"),
    [
        ({"time": "0.5"}, TypeError, r"a slice of times, not '0\.5'\nhint: .* solution\(t\) gives"),
        ({"time": slice(2, 3)}, ValueError, "no kept state is at a time from 2 to 3: the run goes"),
        ({"time": slice(0, 1, 0.1)}, ValueError, r"a number of kept states, not 0\.1"),
        ({"coordinate": ["w"]}, ValueError, r"no coordinate 'w'\nhint: it has x, y"),
    ],
)
def test_what_cannot_be_selected_is_refused(solution, wanted, kind, words):
    with pytest.raises(kind, match=words):
        solution.sel(**wanted)


def test_members_and_times_of_an_ensemble_are_selected_in_either_order():
    pendulum = problems.load("pendulum")
    start = {name: np.tile(x, (3, 1)) for name, x in pendulum.start.items()}
    run = {"t": (0.0, 1.0), "h": 0.1, "params": {"g": [1.0, 2.0, 3.0]}}
    many = lv.ensemble(pendulum.system, lv.Spark(2), **run, **start)
    one, other = many.sel(time=slice(0.4, 1)).member(1), many.member(1).sel(time=slice(0.4, 1))
    assert one.q.tobytes() == other.q.tobytes()
    drift = other.invariant_drift("energy")
    np.testing.assert_array_equal(one.invariant_drift("energy"), drift)
    assert one.params == other.params == {**pendulum.system.params, "g": 2.0}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("energy", r"'energy'\nhint: solution\.invariants\['energy'\] has it"),
        ("hidden", r"'hidden'\nhint: solution\.residuals\['hidden'\] has it"),
        ("iterations", r"'iterations'\nhint: solution\.stats\['iterations'\] has it"),
        ("success", r"'success'\nhint: solution\.status is 'done'"),
        ("nfev", r"'nfev'\nhint: solution\.stats has"),
        ("z", r"no 'z'\nhint: its states are q, v, p, lam"),
        ("y", r"'y'\nhint: coordinate 'y' is a column: solution\.q\[\.\.\., 1\]$"),
        ("speed", r"^'Solution' object has no attribute 'speed'$"),
    ],
)
def test_names_of_other_libraries_have_a_hint(solution, name, words):
    assert not hasattr(solution, name)
    with pytest.raises(AttributeError, match=words):
        getattr(solution, name)
    assert pickle.loads(pickle.dumps(replace(solution, system=None))).t.shape == solution.t.shape


# --- habits of pandas, xarray and matplotlib ----------------------------------------------


def swing(**more):
    return lv.integrate(pendulum.system, lv.Spark(3), t=(0, 1), h=0.1, **pendulum.start, **more)


def swings():
    given = {"params": {"g": [9.0, 9.81, 10.0]}, **pendulum.start}
    return lv.ensemble(pendulum.system, lv.Spark(3), t=(0, 1), h=0.1, **given)


def test_solutions_are_equal_that_have_the_same_records():
    run = swing()
    assert run == swing()
    assert hash(run) == hash(swing())
    assert run != swing(params={"g": 9.80665})
    assert run != lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, **pendulum.start)
    assert run != run.sel(time=slice(0, 0.5))
    assert run != 3
    assert bool(run)
    many = swings()
    assert many == swings()
    assert many[1] == many.member(1) == many.sel(member=1)
    assert many[1] != many[2]


def test_names_and_numbers_in_brackets_give_arrays_and_members():
    run, many = swing(observe={"angle": lambda t, q, v, params: ca.atan2(q[0], -q[1])}), swings()
    for name, wanted in (("q", run.q), ("y", run.q[:, 1]), ("angle", run.observed["angle"]),
                         ("energy", run.invariants["energy"])):  # fmt: skip
        assert np.array_equal(run[name], wanted)
    assert np.array_equal(many["q"], many.q)
    assert len(many) == 3
    for each in (run, many):
        assert [x in each for x in ("q", "y", "energy", "b", 0)] == [True, True, True, False, False]
    assert many[-1].params["g"] == 10.0
    for group in (run, run.events, run.invariants, run.observed, run.residuals, run.states):
        with pytest.raises(KeyError, match=r"^there is no 'b'\nhint: there (is|are) "):
            group["b"]
    with pytest.raises(TypeError, match="no members to be numbered"):
        run[0]
    with pytest.raises(TypeError, match="no members to count"):
        len(run)


def test_sel_takes_a_time_and_a_coordinate():
    run = swing()
    assert np.array_equal(run.sel(time=0.3).q, run.q[3:4])
    assert np.array_equal(run.sel(coordinate="y").q, run.q[:, 1:])
    with pytest.raises(ValueError, match=r"0.35.*\nhint: solution.t. gives the states at any"):
        run.sel(time=0.35)


def test_tab_completion_offers_the_states_that_there_are():
    run = swing()
    assert {"q", "v", "p", "lam"} <= {*dir(run)}
    assert not {"psi", "x", "y", "z", "a"} & {*dir(run)}
    assert {"q", "v", "t"} <= {*dir(run(0.5))}
    for own in (run, run(0.5)):
        for name in dir(own):
            if name in points.STATES:
                getattr(own, name)


def test_a_frame_has_a_row_for_each_state_of_each_member():
    run, many = swing(), swings()
    frame = run.to_dataframe()
    assert np.array_equal(frame["t"], run.t)
    assert np.array_equal(frame["q[y]"], run.q[:, 1])
    each = many.to_dataframe()
    assert np.array_equal(each[each.member == 2]["energy"], many[2].invariants["energy"])


def test_members_have_coordinates_in_xarray():
    many = swings()
    data = many.to_xarray()
    assert np.array_equal(data.member, [0, 1, 2])
    own = data.swap_dims(member="g").sel(g=9.81)
    assert np.array_equal(own.q, many[1].q)


@pytest.mark.parametrize("name", ["study.nc", "study.zarr"])
def test_files_of_members_have_what_they_differ_in(name, tmp_path):
    xarray = pytest.importorskip("xarray")
    many = swings()
    many.save(tmp_path / name)
    with xarray.open_dataset(tmp_path / name) as data:
        own = data.swap_dims(member="g").sel(g=9.81)
        assert np.array_equal(own.q, many[1].q)
    assert lv.load(tmp_path / name).params["g"] == many.params["g"]


def test_a_loaded_run_is_whole_with_its_system_and_method(tmp_path):
    run = swing()
    run.save(tmp_path / "run.npz")
    path = tmp_path / "run.npz"
    whole = lv.load(path, system=pendulum.system, method=lv.Spark(3))
    assert whole == run
    assert np.array_equal(whole(0.55).q, run(0.55).q)
    assert np.array_equal(whole.reaction("rod"), run.reaction("rod"))
    with pytest.raises(ValueError, match=r"hint: liouville.load\(path, system=...\)"):
        lv.load(path)(0.5)
    with pytest.raises(ValueError, match="method must be the one that made it"):
        lv.load(path, method=lv.Spark(2))
    free = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2, q=("x",))
    with pytest.raises(ValueError, match="system must have the coordinates 'x' and 'y', not 'x'"):
        lv.load(path, system=free)
    with pytest.raises(TypeError, match="system must be the one that was integrated, not 'pendu"):
        lv.load(path, system="pendulum")
