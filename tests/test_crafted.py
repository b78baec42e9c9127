"""Files that somebody made, with right checksums: each is refused in a sentence with its name."""

import json
import math
import random
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from test_stored import pendulum

import liouville as lv
from liouville import problems
from liouville._basics import checksum
from liouville._solution import export
from liouville._solution.export.files import write_netcdf

#: What is put in the place of an attribute, of an entry of the description, and of an array.
ODD = [
    None, 7, -3, 1.5, True, math.nan, 10**400, "x", "", [], [1], ["a", "a"], {}, {"a": None},
    "null", "7", "[[[]]]", '{"a": {}}', '{"x": [1]}', '{"0": []}', '["x", "x"]', "[" * 100_000,
]  # fmt: skip
ARRAYS = [
    np.float64(1.0), np.zeros(7), np.zeros((2, 3, 4, 5)), np.array([b"x"] * 11), np.array("x"),
    np.zeros((10, 3), dtype=complex), np.zeros(11, dtype=bool), np.zeros((11, 2), dtype=np.int32),
]  # fmt: skip


def used(run):
    """Use a loaded solution as people do."""
    assert repr(run)
    assert run._repr_html_()
    assert run.members is None or repr(run.member(0))
    run.sel(coordinate=[*run.names["coordinates"]][:1])


def refused(path, *, words=""):
    """Return whether a file is refused, which a sentence with its name and these words does."""
    try:
        used(lv.load(path))
    except ValueError as error:
        said = str(error)
    else:
        return False
    assert path.name in said
    assert words in said
    assert len(said) < 1000
    return True


@pytest.fixture(scope="module")
def runs():
    """Give an ensemble with events and tangents, and a wave."""
    system, start = problems.load("pendulum").system, problems.load("pendulum").start
    many = lv.ensemble(
        system, lv.Spark(2), t=(0, 2), h=0.2, params={"g": [9.0, 10.0]}, **start,
        events={"low": lambda t, q, v, lam, params: q[0]}, tangents={"params.g": 1.0},
        observe={"height": lambda t, q, v, params: q[1]},
    )  # fmt: skip
    chain = problems.load("tight_binding")
    wave = lv.integrate(chain.system, lv.Chebyshev(1e-6), t=[0.0, 0.5, 1.0], **chain.start)
    return {"many": replace(many, system=None), "wave": replace(wave, system=None)}


def of_npz(path):
    with np.load(path) as opened:
        arrays = dict(opened)
    return arrays, json.loads(str(arrays.pop("liouville")))


def write_npz(path, arrays, described):
    np.savez(path, **arrays, liouville=np.array(json.dumps(described)))


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("many", 2),
        ("wave", 2),
        *(pytest.param(x, 99, marks=pytest.mark.slow) for x in ("many", "wave")),
    ],
)
def test_an_npz_with_any_odd_entry_is_refused_by_name(runs, tmp_path, name, count):
    draw = random.Random(7)

    def some(given):
        return draw.sample(given, min(count, len(given)))

    path = tmp_path / "crafted.npz"
    runs[name].save(path)
    arrays, described = of_npz(path)
    assert not refused(path)
    tried = found = 0
    for part in ("attributes", "labels", "axes"):
        for key in described[part]:
            for odd in some(ODD):
                changed = described | {part: described[part] | {key: odd}}
                write_npz(path, arrays, changed)
                found += refused(path)
                tried += 1
            left = {k: x for k, x in described[part].items() if k != key}
            write_npz(path, arrays, described | {part: left})
            refused(path)
        for odd in some(ODD):
            write_npz(path, arrays, described | {part: odd})
            assert refused(path)
    for key in described["axes"]:
        axes, own = described["axes"][key]
        for odd in (
            [axes, None],
            [axes, {**own, "name": 3}],
            [[*axes, "more"], own],
            [axes[1:], own],
        ):
            write_npz(path, arrays, described | {"axes": described["axes"] | {key: odd}})
            assert refused(path, words=key) or not axes
    for key in arrays:
        for odd in some(ARRAYS):
            write_npz(path, {**arrays, key: odd}, described)
            assert refused(path, words=key)
        write_npz(path, {k: x for k, x in arrays.items() if k != key}, described)
        assert refused(path, words=key)
    assert found > 0.7 * tried


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_a_dataset_with_an_odd_attribute_is_refused_by_name(runs, tmp_path, suffix):
    path, draw = tmp_path / f"crafted{suffix}", random.Random(8)
    data = runs["many"].to_xarray()
    runs["many"].save(path)
    for key in draw.sample([*data.attrs], 6):
        odd = draw.choice(["x", "[]", '{"a": {}}', "[" * 100_000])
        if suffix == ".zarr":
            meta = checksum.document_in(path / "zarr.json")
            meta["attributes"] = {**data.attrs, key: draw.choice([odd, None, -3])}
            (path / "zarr.json").write_text(checksum.signed(meta, "attributes"))
        else:
            path.unlink()
            write_netcdf(export.paired(data.assign_attrs({key: odd})), path)
        refused(path)


def test_an_array_of_a_zarr_folder_that_is_described_oddly_is_refused_by_name(runs, tmp_path):
    path, draw = tmp_path / "crafted.zarr", random.Random(9)
    odd = [None, 7, "x", [], {}, [0], [10**400], {"configuration": {"chunk_shape": [0, 0]}}]
    runs["many"].save(path)
    file = path / "zarr.json"
    group = checksum.document_in(file)
    arrays = group["consolidated_metadata"]["metadata"]
    pickled = {**arrays["q"], "zarr_format": 2}

    def written(changed):
        entry = {"kind": "inline", "must_understand": False, "metadata": changed}
        file.write_text(checksum.signed({**group, "consolidated_metadata": entry}, "attributes"))

    for array in ("q", "time"):
        described = arrays[array]
        for key in described.keys() - {"attributes"}:
            left = {k: x for k, x in described.items() if k != key}
            for changed in (left, {**described, key: draw.choice(odd)}):
                written({**arrays, array: changed})
                refused(path)
    for changed in ([], {"q": 3}, {**arrays, "q": pickled}, {**arrays, "../q": arrays["q"]}):
        written(changed)
        assert refused(path)
    written(arrays)
    used(lv.load(path))
    for name in runs["many"].to_xarray().data_vars:  # as an earlier release wrote them
        file = path / name / "zarr.json"
        whole = file.read_text()
        file.write_text(whole.replace("]", ""))
        assert refused(path, words=name)
        file.write_text(whole)
    del group["consolidated_metadata"]
    (path / "zarr.json").write_text(checksum.signed(group, "attributes"))
    used(lv.load(path))


def test_only_the_arrays_are_read_that_a_file_names(tmp_path, monkeypatch):
    path = tmp_path / "crafted.npz"
    run = lv.integrate(**pendulum(steps=5))
    run.save(path)
    arrays, described = of_npz(path)
    write_npz(path, {**arrays, "more": np.zeros(10)}, described)
    read = []
    of = np.lib.format.read_array
    monkeypatch.setattr(np.lib.format, "read_array", lambda *a, **k: read.append(1) or of(*a, **k))
    lv.load(path)
    assert len(read) <= 2 + len(described["axes"])


@pytest.mark.parametrize("name", ["more", "q"])
def test_an_array_that_is_larger_than_its_file_is_refused_before_it_is_read(tmp_path, name):
    path = tmp_path / "crafted.npz"
    lv.integrate(**pendulum(steps=5)).save(path)
    arrays, described = of_npz(path)
    arrays.pop(name, None)
    write_npz(path, arrays, described)
    # a header that tells 8 TiB
    with zipfile.ZipFile(path, "a") as opened, opened.open(f"{name}.npy", "w") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f8", "fortran_order": False, "shape": (2**40,)}
        )
    assert refused(path, words="8796093022208 bytes")


def test_a_netcdf_file_whose_arrays_are_larger_than_it_is_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "crafted.nc"
    run = lv.integrate(**pendulum(steps=5))
    run.save(path)
    with h5py.File(path, "a") as file:
        del file["q"]
        file.create_dataset("q", shape=(2**36,), chunks=(2**20,), dtype="f8")
    checksum.append_to(path)
    with pytest.raises(ValueError, match=r"crafted\.nc"):
        lv.load(path)


ENDLESS = {
    "shears": (
        lv.SchrodingerSplitting(1e-6),
        {"stops": [[1.0, 10**18]]},
        "1000000000000000000 ste",
    ),
    "series": (
        lv.Chebyshev(1e-6),
        {"stops": [[1.0, 10**18]]},
        "1000000000000000000 steps to t = 1",
    ),
    "rate": (lv.Chebyshev(1e-6), {"core": {"rate": 1e-300}}, "errors of 1e-300 in all"),
    "krylov": (lv.Lanczos(1e-6), {"core": {"rate": 0.0}}, "errors of 0 in all"),
    "dimension": (lv.Lanczos(1e-6), {"core": {"dimension": 2}}, "has no dimension 2"),
    "magnus": (lv.Magnus(4, tol=1e-6), {"core": {"rate": -1.0}}, "errors of -1 in all"),
    "tol": (lv.Magnus(4, tol=1e-6), {"core": {"tol": 0.0}}, "has no tol 0"),
}


@pytest.mark.parametrize("name", ENDLESS)
def test_a_plan_whose_run_would_not_end_is_refused_before_it(name, tmp_path):
    path = tmp_path / "crafted.json"
    method, changes, words = ENDLESS[name]
    system, call = problems.load("tight_binding").system, {"t": (0.0, 1.0)}
    start = np.full(system.size, system.size**-0.5, dtype=complex)
    plan = lv.plan(system, method, **call)
    plan.save(path)
    assert lv.integrate(system, lv.Plan.load(path), psi=start, **call).status == "done"
    described = json.loads(path.read_text())
    del described["crc32"]
    changed = described | {
        key: described[key] | x if isinstance(x, dict) else x for key, x in changes.items()
    }
    path.write_text(checksum.signed(changed))
    crafted = lv.Plan.load(path)
    with pytest.raises(ValueError, match=words):
        lv.integrate(system, crafted, psi=start, **call)


def test_a_plan_of_another_drive_with_the_same_range_is_refused(tmp_path):
    def driven(pulse):
        x, z = np.array([[0, 1.0], [1, 0]]), np.diag([1.0, -1.0])
        return lv.Schrodinger(z, drive=[(np.sin(np.pi * times), x)], times=times**pulse)

    times = np.linspace(0.0, 1.0, 9)
    one, other = 1, 2
    plan = lv.plan(driven(one), t=(0.0, 1.0))
    assert plan.products
    with pytest.raises(ValueError, match="made for another"):
        lv.integrate(driven(other), plan, t=(0.0, 1.0), psi=[1, 0j])


def test_a_plan_with_an_odd_field_is_refused_with_its_file(tmp_path):
    path = tmp_path / "crafted.json"
    chain, top = problems.load("tight_binding"), problems.load("euler_top")
    plans = (
        lv.plan(chain.system, lv.Chebyshev(1e-6), t=[0.0, 1.0]),
        lv.plan(top.system, h=0.1, **top.start),
    )
    for plan in plans:
        plan.save(path)
        described = json.loads(path.read_text())
        del described["crc32"]
        own = {("core", key): described["core"] for key in described.get("core", {})}
        for part, key in [*((None, key) for key in described), *own]:
            for odd in (None, [[None]], {"name": 3}, 10**400):
                inner = {**described[part], key: odd} if part else odd
                path.write_text(checksum.signed({**described, part or key: inner}))
                try:
                    assert str(lv.Plan.load(path))
                except ValueError as error:
                    said = str(error)
                    assert "crafted.json" in said
