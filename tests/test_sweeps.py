"""The pages of sliders show what was computed, and need nothing else."""

import base64
import json
import re
import runpy

import numpy as np
import pytest
from pages import ROOT

SWEEPS = runpy.run_path(str(ROOT / "tools" / "sweeps.py"))


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweeps")
    SWEEPS["main"](folder)
    return {path.stem: path.read_text(encoding="utf-8") for path in folder.iterdir()}


def shown(page):
    """Return the data of a page, and its points in units of the box that is seen."""
    data = json.loads(re.search(r"^const run = (.*);$", page, re.M)[1])
    numbers = np.frombuffer(base64.b64decode(data["points"]), "<i2").reshape(data["shape"])
    return data, numbers * data["scale"] / 32767


def test_the_page_of_sliders_has_each_page_in_a_frame(pages):
    text = (ROOT / "docs" / "sliders.md").read_text(encoding="utf-8")
    framed = re.findall(r'src="_static/(\w+)\.html"', text)
    assert sorted(framed) == sorted(pages)


def test_a_page_is_small_and_asks_nothing_of_the_network(pages):
    for page in pages.values():
        assert len(page) < 700_000
        assert not re.search(r"https?:|fetch\(|import ", page)


def test_each_value_has_a_run_and_a_sentence(pages):
    for page in pages.values():
        data, _ = shown(page)
        count = len(data["values"])
        assert data["shape"][0] == len(data["notes"]) == count > 5
        assert len(set(data["notes"])) > count / 2


def test_the_rod_has_its_length_and_a_small_swing_the_period_of_theory(pages):
    data, points = shown(pages["sweep_pendulum"])
    lengths = 1.1 * np.linalg.norm(points[:, :, 1], axis=-1)
    assert np.abs(lengths - 1).max() < 1e-4  # of numbers with 16 bits
    angle = np.radians(data["values"][0])
    series = 2 * np.pi / np.sqrt(9.81) * (1 + angle**2 / 16 + 11 * angle**4 / 3072)
    assert abs(float(re.search(r"takes ([\d.]+) s", data["notes"][0])[1]) - series) < 1e-4


def test_the_area_of_the_dye_stays(pages):
    _, points = shown(pages["sweep_flow"])
    x, y = np.moveaxis(points, -1, 0)
    area = (x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1)).sum(axis=-1) / 2
    assert np.abs(area / area[:, :1] - 1).max() < 0.01  # of a polygon with 320 corners


def test_the_higher_the_barrier_the_less_of_the_packet_passes(pages):
    data, points = shown(pages["sweep_wave"])
    passed = [float(note.split(" %")[0]) for note in data["notes"]]
    assert passed == sorted(passed, reverse=True)
    assert passed[0] > 99.9
    density = points[..., 1] + 0.9
    beyond = density[:, -1, points.shape[2] // 2 :].sum(axis=-1) / density[:, -1].sum(axis=-1)
    assert np.abs(100 * beyond - passed).max() < 1
