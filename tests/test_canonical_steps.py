"""Steps of canonical splittings, to all of their printed digits."""

import json
from pathlib import Path

import pytest
from mpmath import mp, mpf
from plain_splitting import in_digits, walk
from test_composition import SCHEMES, flows

from liouville._methods.splitting import Exponential, Natural, Shear, split
from liouville._methods.splitting.directions import powers
from liouville._systems.fields.terms import Terms

REFERENCE = json.loads((Path(__file__).parent / "data" / "volume_reference.json").read_text())
FIELDS = {field["name"]: field for field in REFERENCE["fields"]}


def number(text):
    over, _, under = text.partition("/")
    return mpf(over) / mpf(under or 1)


def canonical(step):
    """Split the field of a step as the conventions of the data say."""
    field = FIELDS[step["field"]]
    terms = Terms.of(field["n"], field["terms"])
    if step["method"] == "exp+nat":
        return split(terms, "exponentials", merged=False)
    directions = powers(field["n"], terms.degree)
    return split(terms, "shears", directions=directions, merged=False)


def written(piece):
    """Write a piece as the plain stepper reads it, its fractions kept."""
    match piece:
        case Natural(terms=r):
            return ("natural", range(r.n), r.component, r.coefficient.tolist(), r.variables)
        case Shear(direction=a, g=g):
            terms = (g.component, g.coefficient.tolist(), g.variables)
            return ("shear", range(g.n), a.tolist(), *terms)
        case Exponential(places=places, rates=rates, monomial=j):
            return ("exponential", places, rates.tolist(), list(j))


@pytest.mark.parametrize(
    "step",
    REFERENCE["canonical_steps"],
    ids=lambda step: f"{step['field']}-{step['method']}-{step['composition']}",
)
def test_canonical_steps_are_reproduced_to_all_digits(step):
    with mp.workdps(45):
        parts = canonical(step)
        assert len(parts.pieces) == step["pieces"]
        pieces = in_digits([written(piece) for piece in parts.pieces])
        is_basic = step["composition"] == "Phi"
        scheme = [(False, mpf(1))] if is_basic else flows(SCHEMES[step["composition"]])
        x = [number(value) for value in FIELDS[step["field"]]["x0"]]
        x = walk(pieces, scheme, x, number(step["h"]), step["steps"])
        for found, wanted in zip(x, step["x"], strict=True):
            assert abs(found - mpf(wanted)) <= abs(found) * mpf("0.6e-24")
