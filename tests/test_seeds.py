"""Tests have the same cases in every run: what is drawn at random has a seed, in one place."""

import re
from pathlib import Path

from hypothesis import settings

ROOT = Path(__file__).resolve().parent.parent
CORE_TESTS = sorted((ROOT / "crates" / "tests" / "tests").rglob("*.rs"))
TESTS = sorted((ROOT / "tests").glob("*.py"))
UNSEEDED = re.compile(r"default_rng\(\)|\bRandom\(\)|\brandom\.seed\(\)|RandomState\(\)")


def test_properties_of_the_core_have_their_seed():
    blocks = [
        (path.name, block)
        for path in CORE_TESTS
        for block in path.read_text(encoding="utf-8").split("proptest! {")[1:]
    ]
    assert blocks
    for name, block in blocks:
        assert block.lstrip().startswith("#![proptest_config(properties("), name


def test_no_generator_is_without_a_seed():
    for path in TESTS:
        if path != Path(__file__).resolve():
            assert not UNSEEDED.search(path.read_text(encoding="utf-8")), path.name


def test_examples_are_those_of_the_run_before():
    assert settings.get_profile("house").derandomize
    assert settings.get_profile("house").database is None
    assert not settings.get_profile("fuzz").derandomize
