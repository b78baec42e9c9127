"""How a field and those of its members are split, and what no splitting steps."""

from __future__ import annotations

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods.control import Steps
from liouville._methods.planner import FieldPlan, plan_field
from liouville._methods.splitting import Affine, Split
from liouville._systems import PolynomialField
from liouville._systems.fields.terms import Function

#: Half of the digits of an affine flow are left after so many of its own times.
MOST_TURNS = 1e8

#: At so many times functions of time are looked at before a run.
TIMES = 2001


def split_by(
    plan: FieldPlan, system: PolynomialField, h: float, x: np.ndarray
) -> tuple[FieldPlan, Split]:
    """Return a plan and a field split by it; of a field with fewer terms a plan of its own.

    The method of a plan leaves nothing open: what it makes of a field depends on that field alone.
    """
    terms, names = system.terms, system.variables
    try:
        return plan, plan.split(terms, names)
    except ValueError:
        if terms.n != plan.n or len(terms) > plan.terms:
            raise
        return plan_field(terms, plan.method, h, x, 1, names=names)


def have_same_basis(one: Split, other: Split) -> bool:
    """Return whether the pieces of two fields are of the same variables."""
    if one.basis is None or other.basis is None:
        return one.basis is other.basis
    return np.array_equal(one.basis, other.basis)


def check_times(system: PolynomialField, steps: Steps) -> None:
    """Refuse functions of time that are singular in the time of a run."""
    times = np.linspace(steps.t0, steps.t1, TIMES) if system.is_driven else np.empty(0)
    for function in system.terms.functions if system.is_driven else ():
        if not isinstance(function, Function) or function.places != (len(system.coordinates),):
            continue
        found = function.singular(times)
        if found is not None:
            t0, t1 = sorted(times[list(found)].tolist())
            where = f"at t = {t0:g}" if t0 == t1 else f"between t = {t0:g} and {t1:g}"
            hint = "begin after it, or end before"
            raise ValueError(hinted(f"the field contains {function.text}, singular {where}", hint))


def _is_nilpotent(matrix: np.ndarray) -> bool:
    """Return whether coordinates move one another in turn, so that the flow is a polynomial."""
    moves = matrix != 0
    return not np.linalg.matrix_power(moves.astype(float), len(moves)).any()


def check_affine(parts: Split, h: float) -> None:
    """Refuse a step after which the flow of an affine piece has no digits left."""
    for piece in parts.pieces:
        if isinstance(piece, Affine):
            length = float(np.abs(piece.matrix.astype(float)).sum(axis=1).max()) * abs(h)
            if length > MOST_TURNS and not _is_nilpotent(piece.matrix):
                raise ValueError(
                    hinted(
                        f"a step of {h:g} is {length:.1e} times as long as the affine part of the "
                        "field takes to change: few digits of its flow would be left",
                        "give a smaller h",
                    )
                )
