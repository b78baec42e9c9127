"""Whether the energy of a conservative system changes as only too large steps change it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate

import numpy as np

from liouville import _core


def change_of_energy(
    t: np.ndarray,
    rows: np.ndarray,
    columns: Mapping[str, int],
    *,
    start: float | np.ndarray | None = None,
    rises: bool = False,
) -> str:
    r"""Say where the energy changed by more than its own size, or jumped and stayed; else "".

    The size of an energy that is :math:`E_0` first is :math:`|E_0|` and the mean so far of the
    kinetic energy :math:`v^T p / 2`, but not below a tenth of the present one. A jump parts all
    energies before from all after it, by a thousandth of the size and a thousand times the median
    change.

    Parameters
    ----------
    t : ndarray, shape (k,)
        Times of the records.
    rows : ndarray, shape (k, w) or (k, P, w)
        The records, of a run or of the members of an ensemble.
    columns : mapping of str to int
        Names and widths of their columns: without an energy, or what makes the kinetic energy,
        there is nothing to say.
    start : float or ndarray, optional
        The energy at the start; without one, that of the first record.
    rises : bool, default False
        Whether only a gain counts, as of methods that damp.
    """
    has_states = "v" in columns and "p" in columns
    if t.size < 2 or "invariant energy" not in columns or not (has_states or "kinetic" in columns):
        return ""
    at = dict(zip(columns, accumulate(columns.values(), initial=0), strict=False))
    kinetic = (at["v"], at["p"], columns["v"]) if has_states else at["kinetic"]
    energy = at["invariant energy"]
    first = None if start is None else np.ravel(start)
    found = _core.energy_change(rows, energy, kinetic, first, rises)
    if found is None:
        return ""
    k, member, begin, jump = found
    of = f" of member {member}" if rows.ndim == 3 else ""
    if jump is None:
        now = rows[k, ..., energy].reshape(-1)[member]
        return (
            f"the energy{of} has changed from {begin:.3g} to {now:.3g} at t = {t[k]:.6g}, "
            "by more than its own size: steps were too large before"
        )
    return (
        f"the energy{of} has jumped by {100 * jump:.2g} % of its size between "
        f"t = {t[k]:.6g} and t = {t[k + 1]:.6g}: steps were too large there"
    )
