"""Steps of canonical splittings in many digits: the flows by their definitions, with mpmath."""

import json
from math import prod
from pathlib import Path

import pytest
from mpmath import exp, log1p, mp, mpf
from test_composition import SCHEMES, flows

from liouville.splitting import Exponential, Natural, Shear, split
from liouville.splitting.directions import powers
from liouville.terms import Terms

REFERENCE = json.loads((Path(__file__).parent / "data" / "volume_reference.json").read_text())
FIELDS = {field["name"]: field for field in REFERENCE["fields"]}
STEPS = REFERENCE["canonical_steps"]


@pytest.fixture(autouse=True)
def digits():
    """Compute with more digits than are compared."""
    with mp.workdps(45):
        yield


def number(text):
    over, _, under = str(text).partition("/")
    return mpf(over) / mpf(under or 1)


def value(terms, x):
    """Each component of a polynomial field."""
    f = {}
    rows = zip(terms.component.tolist(), terms.coefficient, terms.variables.tolist(), strict=True)
    for i, c, variables in rows:
        f[i] = f.get(i, 0) + number(c) * prod(x[v] for v in variables if v >= 0)
    return f


def flow(piece, h, x):
    """The exact flow of a piece."""
    x = list(x)
    match piece:
        case Natural(terms=terms):
            for i, change in value(terms, x).items():
                x[i] += h * change
        case Shear(direction=a, g=g):
            change = h * value(g, x)[0]
            x = [y + change * number(along) for y, along in zip(x, a, strict=True)]
        case Exponential(places=places, rates=rates, monomial=j):
            rates = [number(c) for c in rates]
            alpha = sum(c * j.count(i) for i, c in zip(places, rates, strict=True))
            z = alpha * h * prod((x[v] for v in j), start=mpf(1))
            phi = -log1p(-z) / z if z else mpf(1)
            m = prod((x[v] for v in j), start=mpf(1))
            for i, c in zip(places, rates, strict=True):
                x[i] *= exp(c * h * m * phi)
    return x


def canonical(step):
    """The field of a step, split as the conventions of the data say."""
    field = FIELDS[step["field"]]
    terms = Terms.of(field["n"], field["terms"])
    if step["method"] == "exp+nat":
        return split(terms, "exponentials", merged=False)
    directions = powers(field["n"], terms.degree)
    return split(terms, "shears", directions=directions, merged=False)


@pytest.mark.parametrize(
    "step", STEPS, ids=lambda s: f"{s['field']}-{s['method']}-{s['composition']}"
)
def test_canonical_steps_are_reproduced_to_all_digits(step):
    parts = canonical(step)
    assert len(parts.pieces) == step["pieces"]
    is_basic = step["composition"] == "Phi"
    sequence = [(False, mpf(1))] if is_basic else flows(SCHEMES[step["composition"]])
    x, h = [number(each) for each in FIELDS[step["field"]]["x0"]], number(step["h"])
    for _ in range(step["steps"]):
        for is_adjoint, alpha in sequence:
            for piece in parts.pieces[:: -1 if is_adjoint else 1]:
                x = flow(piece, alpha * h, x)
    for found, wanted in zip(x, step["x"], strict=True):
        assert abs(found - mpf(wanted)) <= abs(found) * mpf("0.6e-24")
