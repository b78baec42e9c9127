import csv
import json
import shutil
import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import xarray
from scipy import io

import liouville as lv
from liouville import problems
from liouville._solution.export import check, to_xarray

ARRAYS = ("states", "invariants", "residuals", "observed", "balance")
FACTS = ("names", "h", "tolerances", "method", "stats", "params", "status", "message")


@pytest.fixture(scope="module")
def solution():
    """Give a short run, with values in it that are easily lost on the way to a file."""
    pendulum = problems.load("pendulum")
    run = lv.integrate(
        pendulum.system, lv.HHT(), t=(0.0, 1.0), rtol=1e-3, atol=[1e-5, 1 / 3], **pendulum.start
    )
    hard = np.resize([-0.0, 5e-324, np.inf, np.nan, 9.969209968386869e36, 1 / 3], len(run.t))
    hard[7] = np.array([0x7FF8DEADBEEF0001], dtype=np.uint64).view(np.float64)[0]
    return replace(
        run,
        invariants={"spin / 2": hard, **run.invariants},
        observed={"a/b": hard, "corner": run.q * 2, "q": run.v},
        params={"m": 0.1, "masses": [1 / 3, 1e-300]},
        system=None,
        status="failed",
        message="step 51 failed\nhint: \u03c0",
    )


def assert_same(one, other):
    assert one.t.tobytes() == other.t.tobytes()
    for group in ARRAYS:
        mine, yours = getattr(one, group), getattr(other, group)
        assert list(mine) == list(yours)
        for name in mine:
            assert mine[name].shape == yours[name].shape
            assert mine[name].tobytes() == yours[name].tobytes()
    for fact in FACTS:
        assert getattr(one, fact) == getattr(other, fact)


@pytest.mark.parametrize("name", ["run.nc", "run.zarr", "run.npz"])
def test_what_is_saved_comes_back_bit_for_bit(solution, tmp_path, name):
    solution.save(tmp_path / name)
    loaded = lv.load(tmp_path / name)
    assert_same(solution, loaded)
    assert loaded.system is None
    assert {type(value) for value in loaded.stats.values()} <= {int, float, str}


@pytest.mark.parametrize("name", ["run.nc", "run.zarr", "run.npz"])
def test_saving_again_replaces_what_was_there(solution, tmp_path, name):
    # No constraints, no states, nothing observed: what is empty comes back empty.
    none = np.empty((len(solution.t), 0))
    bare = replace(
        solution,
        states={},
        observed={},
        balance={},
        tolerances={},
        residuals={"constraint": none, "hidden": none},
        names={"coordinates": ("x", "y"), "constraints": ()},
    )
    solution.save(tmp_path / name)
    bare.save(tmp_path / name)
    assert_same(bare, lv.load(tmp_path / name))


@pytest.fixture(scope="module")
def ensemble():
    """Give a short ensemble, with hard values in it, scalars and vectors that were observed."""
    vortex = problems.load("hill_vortex")
    x = np.random.default_rng(1).uniform(-0.5, 0.5, (5, 3))
    observe = {"height": lambda t, x, params: x[2], "flat": lambda t, x, params: x[:2]}
    run = lv.ensemble(
        vortex.system, lv.VolumeSplitting(), t=(0, 1), h=0.05, every=3, x=x, observe=observe
    )
    hard = np.resize([-0.0, 5e-324, np.inf, np.nan, 1 / 3], run.observed["height"].shape)
    return replace(run, observed={**run.observed, "a/b": hard})


@pytest.mark.parametrize("name", ["run.nc", "run.zarr", "run.npz"])
@pytest.mark.parametrize("states", [True, False])
def test_an_ensemble_comes_back_bit_for_bit(ensemble, tmp_path, name, states):
    saved = ensemble if states else replace(ensemble, states={})
    assert saved.observed["flat"].shape == (8, 5, 2)
    saved.save(tmp_path / name)
    loaded = lv.load(tmp_path / name)
    assert_same(saved, loaded)
    assert loaded.members == 5
    assert repr(loaded) == repr(saved)


def test_the_members_of_an_ensemble_are_a_dimension(ensemble):
    data = ensemble.to_xarray()
    assert data.x.dims == ("time", "member", "coordinate")
    np.testing.assert_array_equal(data.x.sel(member=3, coordinate="z"), ensemble.x[:, 3, 2])
    np.testing.assert_array_equal(
        data.invariants.sel(invariant="swirl"), ensemble.invariants["swirl"]
    )


def test_a_table_of_an_ensemble_has_one_member_after_another(ensemble, tmp_path):
    ensemble.save(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["member"] == "3"]
    for column, values in {
        "t": ensemble.t,
        "x[z]": ensemble.x[:, 3, 2],
        "swirl": ensemble.invariants["swirl"][:, 3],
        "flat[1]": ensemble.observed["flat"][:, 3, 1],
    }.items():
        np.testing.assert_array_equal([float(row[column]) for row in rows], values)


def test_a_dataset_is_labelled_by_names(solution):
    data = solution.to_xarray()
    assert data.q.dims == ("time", "coordinate")
    np.testing.assert_array_equal(data.v.sel(coordinate="y"), solution.v[:, 1])
    np.testing.assert_array_equal(
        data.invariants.sel(invariant="energy"), solution.invariants["energy"]
    )
    np.testing.assert_array_equal(
        data.residuals.sel(residual="hidden", constraint="rod"), solution.residuals["hidden"][:, 0]
    )
    np.testing.assert_array_equal(data.observed_q, solution.v)
    np.testing.assert_array_equal(data.balance.sel(term="dissipated"), solution.dissipated)
    assert data.q.sel(time=0.5, method="nearest").shape == (2,)


def test_a_csv_file_has_a_named_column_with_all_digits_for_each_number(solution, tmp_path):
    solution.save(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for column, values in {
        "t": solution.t,
        "v[y]": solution.v[:, 1],
        "a[x]": solution.a[:, 0],
        "dissipated": solution.dissipated,
        "lam[rod]": solution.lam[:, 0],
        "hidden[rod]": solution.residuals["hidden"][:, 0],
        "a/b": solution.observed["a/b"],
        "corner[1]": solution.observed["corner"][:, 1],
    }.items():
        np.testing.assert_array_equal([float(row[column]) for row in rows], values)
    with pytest.raises(ValueError, match=r"CSV file holds only .*\nhint: save to \.nc, \.zarr or"):
        lv.load(tmp_path / "run.csv")


@pytest.mark.parametrize("name", ["run", "run.txt", "run.nc.gz"])
def test_an_unknown_suffix_is_refused_both_ways(solution, tmp_path, name):
    with pytest.raises(ValueError, match=r"suffix of .*\nhint: use one of \.nc, \.zarr, \.npz,"):
        solution.save(tmp_path / name)
    with pytest.raises(ValueError, match=r"suffix of .*\nhint: use one of \.nc, \.zarr, \.npz,"):
        lv.load(tmp_path / name)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["no.nc", "no.npz"])
def test_a_missing_file_or_folder_is_named(solution, tmp_path, name):
    with pytest.raises(FileNotFoundError, match=f"there is no file '.*{name}'"):
        lv.load(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"the folder of '.*nowhere.*' does not exist"):
        solution.save(tmp_path / "nowhere" / name)


def test_files_of_others_are_refused(solution, tmp_path):
    xarray.Dataset({"q": 1.0}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match="holds no liouville solution"):
        lv.load(tmp_path / "other.nc")
    (tmp_path / "text.nc").write_text("t,q\n0,1\n")
    with pytest.raises(ValueError, match=r"cannot be read as \.nc"):
        lv.load(tmp_path / "text.nc")
    (tmp_path / "empty.zarr").mkdir()
    with pytest.raises(ValueError, match=r"cannot be read as \.zarr"):
        lv.load(tmp_path / "empty.zarr")
    newer = to_xarray(solution).assign_attrs(liouville_solution=4)
    newer.to_netcdf(tmp_path / "newer.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match=r"layout 4 .*\nhint: read it with the liouville that"):
        lv.load(tmp_path / "newer.nc")


@pytest.mark.parametrize(
    ("package", "name"),
    [("xarray", "run.nc"), ("h5netcdf", "run.nc"), ("h5py", "run.nc"), ("zarr", "run.zarr")],
)
def test_a_missing_package_names_the_extra_to_install(
    solution, tmp_path, monkeypatch, package, name
):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf'need {package}\nhint: pip install "liouville\[io\]"'):
        solution.save(tmp_path / name)
    solution.save(tmp_path / "run.csv")


@pytest.fixture(scope="module")
def swinging():
    """Give pendulums that know their system, so that there are reactions."""
    pendulum = problems.load("pendulum")
    return lv.ensemble(
        pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, params={"g": [1.0, 2.0]}, **pendulum.start
    )


@pytest.mark.parametrize("name", ["run.nc", "run.npz"])
def test_reactions_are_in_files_and_come_back(swinging, tmp_path, name):
    forces = swinging.reaction()
    assert forces[-1].all()
    swinging.save(tmp_path / name)
    loaded = lv.load(tmp_path / name)
    np.testing.assert_array_equal(loaded.reaction(), forces)
    np.testing.assert_array_equal(loaded.member(1).reaction(), forces[:, 1])
    assert loaded.member(1).params["g"] == 2.0
    loaded.save(tmp_path / f"again-{name}")
    assert_same(lv.load(tmp_path / f"again-{name}"), swinging)
    with pytest.raises(ValueError, match="need the system, which a loaded solution does not"):
        loaded.reaction("rod")


def test_a_file_for_matlab_has_structures_with_names_it_takes(swinging, tmp_path):
    hard = {"2 pi / a": swinging.t, "_2 pi / a": -swinging.t, "x" * 70: swinging.t}
    replace(swinging.member(1), observed=hard).save(tmp_path / "run.mat")
    found = io.loadmat(tmp_path / "run.mat", simplify_cells=True)
    np.testing.assert_array_equal(found["t"], swinging.t)
    np.testing.assert_array_equal(found["q"], swinging.q[:, 1])
    np.testing.assert_array_equal(found["reactions"], swinging.reaction()[:, 1])
    np.testing.assert_array_equal(
        found["invariants"]["energy"], swinging.invariants["energy"][:, 1]
    )
    assert [*found["names"]["coordinates"]] == ["x", "y"]
    assert found["params"]["g"] == 2.0
    assert [*found["observed"]] == ["x2_pi___a", "x_2_pi___a", "x" * 63]
    with pytest.raises(ValueError, match=r"MATLAB file holds .*\nhint: save to \.nc, \.zarr or"):
        lv.load(tmp_path / "run.mat")


def test_a_parquet_file_is_the_table_with_how_the_run_went(swinging, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    swinging.save(tmp_path / "run.parquet")
    found = parquet.read_table(tmp_path / "run.parquet")
    assert found["member"].to_pylist() == [0] * 11 + [1] * 11
    np.testing.assert_array_equal(found["q[y]"].to_numpy(), swinging.q[..., 1].T.ravel())
    np.testing.assert_array_equal(
        found["reaction[y]"].to_numpy(), swinging.reaction()[..., 1].T.ravel()
    )
    facts = json.loads(found.schema.metadata[b"liouville"])
    assert (facts["status"], facts["members"]) == ("done", 2)


def test_a_film_of_points_has_a_frame_for_each_kept_step(tmp_path):
    q = ("C1_x", "C1_y", "C1_z", "x2", "y2", "z2")
    free = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=q)
    run = lv.integrate(free, lv.Spark(1), t=(0, 1), h=0.5, q=range(6), v=[0, 0, 1, 0, 1 / 3, 0])
    run.save(tmp_path / "run.xyz")
    lines = (tmp_path / "run.xyz").read_text().splitlines()
    assert lines[4:6] == ["2", 'Properties=species:S:1:pos:R:3:name:S:1 pbc="F F F" Time=0.5']
    frame = [line.split() for line in lines[6:8]]
    assert [(row[0], row[-1]) for row in frame] == [("C", "C1"), ("X", "2")]
    np.testing.assert_array_equal(np.array(frame)[:, 1:4].astype(float).ravel(), run.q[1])


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("x1", "y1", "angle"), "'angle' is no x, y or z of a point"),
        (("x1", "y1", "x2"), "point '2' has only x"),
        (("x1", "y1", "x1'"), '"x1\'" is no x, y or z'),
        ((), "no coordinates by name"),
    ],
)
def test_systems_that_are_no_points_have_no_film_of_points(names, words, tmp_path):
    with pytest.raises(ValueError, match=rf"(?s)film of points.*{words}.*\nhint: name them x1, y1"):
        check(tmp_path / "run.xyz", names)


def test_a_damaged_or_foreign_file_of_numpy_is_refused(swinging, tmp_path):
    path = tmp_path / "run.npz"
    swinging.save(path)
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 1
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=r"run\.npz' cannot be read as \.npz: Bad CRC-32"):
        lv.load(path)
    path.write_bytes(whole[:200])
    with pytest.raises(ValueError, match=r"run\.npz' cannot be read as \.npz"):
        lv.load(path)
    np.savez(path, q=np.zeros(3))
    with pytest.raises(
        ValueError, match=r"holds no liouville solution\nhint: liouville\.load reads"
    ):
        lv.load(path)


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".npz"])
def test_tangents_come_back_bit_for_bit(tmp_path, suffix):
    pendulum = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - 1},
        q=("x", "y"),
        params={"g": 9.81},
    )
    wall = lv.Event(lambda t, q, v, lam, params: q[0], "down", reset=lv.Impact(0.8))
    call = {"t": (0, 2), "h": 0.05, "events": {"a/wall": wall}}
    one = lv.integrate(
        pendulum,
        lv.Spark(2),
        q=[1.0, 0.0],
        v=[0.0, 0.0],
        tangents={"params.g": 1.0, "v": np.eye(2)},
        **call,
    )
    many = lv.ensemble(
        pendulum,
        lv.Spark(2),
        q=[[1.0, 0.0], [0.6, -0.8]],
        v=np.zeros(2),
        tangents={"params.g": 1.0},
        **call,
    )
    qubit = lv.Schrodinger(
        [np.diag([1.0, -1.0]), [np.array([[0, 1.0], [1, 0]]), lambda t, w: ca.cos(w * t)]],
        params={"w": 1.9},
    )
    wave = lv.integrate(qubit, "auto", t=[0, 1, 2], psi=[1, 0], tangents={"params.w": 1.0})
    for run in (one, many, wave):
        run.save(tmp_path / f"run{suffix}")
        again = lv.load(tmp_path / f"run{suffix}")
        shutil.rmtree(tmp_path / "run.zarr", ignore_errors=True)
        assert list(again.tangents) == list(run.tangents)
        for name, tangent in run.tangents.items():
            found = again.tangents[name]
            assert list(found.states) == list(tangent.states)
            for state, values in tangent.states.items():
                np.testing.assert_array_equal(found.states[state], values)
            for event, points in tangent.events.items():
                np.testing.assert_array_equal(found.events[event].t, points.t)
                assert list(found.events[event].states) == list(points.states)
                for state, values in points.states.items():
                    np.testing.assert_array_equal(found.events[event].states[state], values)
