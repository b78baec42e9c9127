"""Candidates for the splitting of a field, by its structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np

from liouville._methods import VolumeSplitting
from liouville._methods.splitting import commuting, has_pairs
from liouville._systems.fields.terms import Terms

#: A field with fewer than this part of all terms of its degree is sparse.
SPARSE = 0.3

#: Affine parts of more variables are not exponentiated.
MOST_EXACT = 200


def affine_part(
    terms: Terms, method: VolumeSplitting, h: float, states: np.ndarray
) -> tuple[str, list[str]]:
    """Take the affine part exactly if it is fast, and larger than the rest."""
    if method.linear != "auto":
        return method.linear, []
    affine = terms.selected(terms.degrees <= 1)
    if terms.n > MOST_EXACT or terms.functions or not len(affine):
        return "split", []
    if len(affine) == len(terms):
        return "exact", ["the field is affine: one exact flow is all of it"]
    matrix = np.zeros((terms.n, terms.n))
    is_linear = affine.degrees == 1
    matrix[affine.component[is_linear], affine.variables[is_linear, -1]] = (
        affine.to_float().coefficient[is_linear]
    )
    rate = float(np.linalg.norm(matrix, 2)) * abs(h)
    parts = [np.linalg.norm(part.to_float().evaluate(states)) for part in (affine, terms - affine)]
    if rate > 0.5 and parts[0] > parts[1] and not commuting(terms):
        return "exact", [f"the affine part is fast, |A| h = {rate:.2g}: it is integrated exactly"]
    return "split", []


def candidates_of(
    terms: Terms, method: VolumeSplitting, names: Sequence[str]
) -> tuple[list[VolumeSplitting], list[str]]:
    """Return the splittings to try, the safest first, and why."""
    if method.linear == "exact":
        terms = terms.selected(terms.degrees > 1)
    diagonals, offs, reasons = _by_structure(terms, method, names)
    pairs = [
        (diagonal, "natural" if diagonal == "n+d" else off)
        for diagonal in diagonals
        for off in offs
    ]
    if method.diagonal == "auto" and method.off_diagonal == "auto" and len(diagonals) > 1:
        # shears fill in what triangular pieces are for
        pairs = [pair for pair in pairs if pair[1] == "natural" or pair[0] == "exponentials"]
    distinct = list(dict.fromkeys(pairs))
    return [replace(method, diagonal=d, off_diagonal=o) for d, o in distinct], reasons


def _by_structure(
    terms: Terms, method: VolumeSplitting, names: Sequence[str]
) -> tuple[list[str], list[str], list[str]]:
    diagonal, reasons = terms.diagonal(), []
    offs = ["natural"] if terms.functions else ["natural", "triangular"]
    if method.off_diagonal != "auto":
        offs = [method.off_diagonal]
    if method.diagonal != "auto":
        return [method.diagonal], offs, ["the diagonal part is as asked for"]
    if not len(terms):
        return ["exponentials"], ["natural"], []
    if commuting(terms):
        return ["shears"], offs[:1], ["the field is constant along its values: it is shears itself"]
    if not len(diagonal):
        reasons = ["no component contains its own variable: no diagonal part, no fill-in"]
        return ["exponentials"], offs, reasons
    why = "the field has functions beside a diagonal part"
    if not terms.functions:
        why = _keeps_structure(terms, names)
    if why or terms.degree == 1:
        reasons = [why or "the diagonal part is linear"]
        return ["exponentials"], (["natural"] if method.off_diagonal == "auto" else offs), reasons
    diagonals = ["exponentials", *(["pairs"] if has_pairs(diagonal) else []), "shears"]
    diagonals += ["regular"] if terms.degree == 2 and terms.n >= 3 else []
    diagonals += ["n+d"] if method.off_diagonal == "auto" else []
    return (
        diagonals,
        offs,
        ["the field is dense, without invariant planes or reversing reflections"],
    )


def _keeps_structure(terms: Terms, names: Sequence[str]) -> str:
    """Return why only exponentials and natural shears keep structure of the field, if they do."""
    n, d = terms.n, terms.degree
    dense = n * comb(n + d, d)
    if len(terms) < SPARSE * dense:
        return f"the field is sparse: {len(terms)} terms of {dense}"
    planes = np.setdiff1d(np.arange(n), terms.off_diagonal().component)
    if planes.size:
        return f"the plane {names[planes[0]]} = 0 is invariant, and stays so"
    if _has_reversing_reflection(terms):
        return "a reflection of some variables reverses the flow, and keeps doing so"
    return ""


def _has_reversing_reflection(terms: Terms) -> bool:
    """Return whether signs s_i = ±1 exist with s_i f_i(s x) = -f_i(x): equations modulo 2."""
    n = terms.n
    rows = np.zeros((len(terms), n + 1), dtype=bool)
    at = np.arange(len(terms))
    rows[at, terms.component] ^= True
    for column in terms.variables.T:
        there = column >= 0
        rows[at[there], column[there]] ^= True
    rows[:, n] = True
    for pivot in range(n):
        hits = np.flatnonzero(rows[:, pivot])
        if hits.size:
            row = rows[hits[0]].copy()
            rows[hits] ^= row
    return not rows[:, n].any()
