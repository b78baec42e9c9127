"""Families of permutations: every number stands after any d others in one of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from liouville._methods.splitting.permutations import family

REFERENCE = json.loads((Path(__file__).parent / "data" / "volume_reference.json").read_text())


QUADRATIC = {int(n): size for n, size in REFERENCE["permutations"]["quadratic_min"].items()}


@pytest.mark.parametrize(
    ("n", "size"),
    [
        pytest.param(n, size, marks=[pytest.mark.slow] if n > 10**6 else [])
        for n, size in QUADRATIC.items()
    ],
)
def test_families_for_quadratic_fields_are_minimal(n, size):
    positions = family(n, 2)
    assert len(positions) == size
    assert (np.sort(positions, axis=1) == np.arange(n)).all()
    rng = np.random.default_rng(n)
    i, v, w = np.indices((n, n, n)).reshape(3, -1) if n <= 82 else rng.integers(n, size=(3, 10**5))
    other = (i != v) & (i != w)
    i, v, w = i[other], v[other], w[other]
    assert ((positions[:, i] > positions[:, v]) & (positions[:, i] > positions[:, w])).any(0).all()


@pytest.mark.parametrize(
    ("d", "n", "size"),
    [
        (1, 7, 2),
        (3, 4, 4),
        (3, 5, 4),
        pytest.param(3, 6, 6, marks=pytest.mark.slow),
        pytest.param(3, 7, 6, marks=pytest.mark.slow),
        pytest.param(3, 8, 7, marks=pytest.mark.slow),
        (4, 5, 5),
        pytest.param(4, 6, 5, marks=pytest.mark.slow),
        pytest.param(4, 7, 7, marks=pytest.mark.slow),
        (4, 8, 8),
    ],
)
def test_families_for_higher_degrees_are_small(d, n, size):
    positions = family(n, d)
    assert len(positions) <= size
    indices = np.indices((n,) * (d + 1)).reshape(d + 1, -1)
    i, others = indices[0], indices[1:]
    other = (others != i).all(axis=0)
    after = positions[:, i[other]] > positions[:, others[:, other]].max(axis=1)
    assert after.any(axis=0).all()
