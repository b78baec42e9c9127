"""Damage on the disk: a byte that changed is harmless, or found in a sentence with the file."""

import random
import shutil

import numpy as np
import pytest
import zarr
from test_stored import CutError, cutting, pendulum, same, turning

import liouville as lv
from liouville import problems
from liouville._runs.stored import folder, stream

SEED = 15


def height(t, q, v, lam, params):
    return q[0]


def swinging(**more):
    return pendulum(steps=60, events={"low": height}, **more)


def changed(draw, file):
    """Change a byte of a file."""
    data = bytearray(file.read_bytes())
    place = draw.randrange(len(data))
    data[place] ^= 1 << draw.randrange(8) if draw.random() < 0.7 else draw.randrange(1, 256)
    file.write_bytes(data)


def files_of(path):
    """Return the files at a path, each as often as its size asks for, but every one."""
    files = [path] if path.is_file() else sorted(x for x in path.rglob("*") if x.is_file())
    return [file for file in files if file.stat().st_size and file.name != "lock"]


def found_or_harmless(act, whole, path):
    """Act on a damaged path; returns whether the damage was found."""
    found = refused(act, path)
    if isinstance(found, str):
        assert path.name in found
        return True
    same(whole, found)
    return False


def refused(act, path):
    """Return what an act returns, or the sentence by which it is refused."""
    try:
        return act(path)
    except ValueError as error:
        return str(error)


def flipped(path, act, whole, tmp_path, times):
    """Flip a byte of a file at a path, again and again; returns which share was found."""
    draw, found = random.Random(SEED), []
    copy = tmp_path / f"copy{path.suffix}"
    for file in files_of(path) * times:
        shutil.rmtree(copy, ignore_errors=True)
        (shutil.copytree if path.is_dir() else shutil.copy)(path, copy)
        changed(draw, copy if path.is_file() else copy / file.relative_to(path))
        found.append(found_or_harmless(act, whole, copy))
    return sum(found) / len(found)


@pytest.mark.parametrize(
    ("name", "call", "times"),
    [
        ("run.nc", swinging, 50),
        ("run.zarr", turning, 1),
        pytest.param("run.nc", swinging, 500, marks=pytest.mark.slow),
        pytest.param("run.zarr", swinging, 5, marks=pytest.mark.slow),
    ],
)
def test_a_flipped_byte_of_a_saved_solution_is_found(name, call, times, tmp_path):
    whole = lv.integrate(**call())
    whole.save(tmp_path / name)
    # a blank more or less between the entries of JSON changes nothing
    least = 1.0 if name == "run.nc" else 0.7
    assert flipped(tmp_path / name, lv.load, whole, tmp_path, times) >= least


several = pytest.mark.parametrize(
    ("call", "times"), [(turning, 1), pytest.param(swinging, 5, marks=pytest.mark.slow)]
)


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(stream, "BYTES", 1000)
    monkeypatch.setattr(folder.os, "fsync", lambda _: None)


@several
def test_a_flipped_byte_of_a_store_is_found(call, times, small, tmp_path):
    whole = lv.integrate(**call())
    lv.integrate(**call(), store=tmp_path / "run.zarr")
    assert flipped(tmp_path / "run.zarr", lv.load, whole, tmp_path, times) > 0.5


@several
def test_a_run_goes_on_from_no_damaged_state(call, times, small, tmp_path):
    path = tmp_path / "run.zarr"
    whole = lv.integrate(**call())
    with pytest.raises(CutError):
        lv.integrate(**call(), store=lv.Store(path, 15), progress=cutting(2))

    def resumed(path):
        return lv.load(lv.resume(path).path)

    assert flipped(path, resumed, whole, tmp_path, times) > 0.5


@pytest.mark.parametrize("act", [lv.load, lambda path: lv.load(lv.resume(path).path)])
def test_a_lost_file_of_a_store_is_missed(act, small, tmp_path):
    path, copy = tmp_path / "run.zarr", tmp_path / "copy.zarr"
    whole = lv.integrate(**turning())
    if act is lv.load:
        lv.integrate(**turning(), store=path)
    else:
        with pytest.raises(CutError):
            lv.integrate(**turning(), store=lv.Store(path, 15), progress=cutting(2))
    for file in files_of(path):
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(path, copy)
        (copy / file.relative_to(path)).unlink()
        is_mended = act is not lv.load and file.name == "zarr.json"  # of an array: written again
        assert found_or_harmless(act, whole, copy) or is_mended or "checkpoint" in file.parts, file


@pytest.mark.parametrize("name", ["run.nc", "run.zarr"])
def test_a_file_cut_short_is_found(name, tmp_path):
    whole = lv.integrate(**(turning() if name == "run.zarr" else swinging()))
    whole.save(tmp_path / name)
    for file in files_of(tmp_path / name):
        data = file.read_bytes()
        for size in {0, len(data) // 2, len(data) - 1}:
            file.write_bytes(data[:size])
            is_found = found_or_harmless(lv.load, whole, tmp_path / name)
            assert is_found or (name == "run.zarr" and data[size:] == b"\n")
        file.write_bytes(data)
    same(whole, lv.load(tmp_path / name))


def test_a_folder_of_zarr_2_is_not_opened(tmp_path):
    group = zarr.open_group(tmp_path / "run.zarr", mode="w", zarr_format=2)
    group.attrs["liouville_solution"] = 3
    with pytest.raises(ValueError, match=r"cannot be read as \.zarr: it holds no zarr\.json"):
        lv.load(tmp_path / "run.zarr")


def test_an_interrupted_save_leaves_what_was_there(tmp_path, monkeypatch):
    first, second = (lv.integrate(**pendulum(steps=n)) for n in (10, 20))
    for name in ("run.nc", "run.zarr", "run.csv"):
        first.save(tmp_path / name)
        before = {file: file.read_bytes() for file in files_of(tmp_path / name)}

        def dying(*args, **more):
            raise CutError

        with monkeypatch.context() as patch:
            patch.setattr("xarray.Dataset.to_netcdf", dying)
            patch.setattr("xarray.Dataset.to_zarr", dying)
            patch.setattr(np, "savetxt", dying)
            with pytest.raises(CutError):
                second.save(tmp_path / name)
        assert {file: file.read_bytes() for file in files_of(tmp_path / name)} == before
        assert not [*tmp_path.glob(".*")]


def test_a_flipped_byte_of_a_plan_is_found(tmp_path):
    module = problems.load("tight_binding")
    plan = lv.plan(module.system, t=(0.0, 10.0))
    path, draw = tmp_path / "plan.json", random.Random(SEED)
    plan.save(path)
    data, found = path.read_bytes(), 0
    for _ in range(200):
        path.write_bytes(data)
        changed(draw, path)
        loaded = refused(lv.Plan.load, path)
        assert loaded == plan or "plan.json" in loaded
        found += loaded != plan
    assert found > 150
