"""Whether the energy of a conservative system changes as only steps too large change it."""

from __future__ import annotations

import numpy as np

#: The part of the kinetic energy that an error of the energy may be without a word.
PART = 0.1

#: The part of the energy's size that is a jump, if it is so many times the median change.
JUMP, CONSPICUOUS = 1e-3, 1e3


def change_of_energy(
    t: np.ndarray,
    energy: np.ndarray,
    kinetic: np.ndarray,
    *,
    start: float | np.ndarray | None = None,
    rises: bool = False,
) -> str:
    r"""Say where the energy changed by more than its own size, or jumped and stayed; else "".

    The size of an energy that is :math:`E_0` first is :math:`|E_0|` and the mean so far of the
    kinetic energy :math:`v^T p / 2`, but not below a tenth of the present one. A jump parts all
    energies before from all after it, see :func:`largest_jump`.

    Parameters
    ----------
    t : ndarray, shape (k,)
        Times of the records.
    energy, kinetic : ndarray, shape (k,) or (k, P)
        Both energies there, of a run or of the members of an ensemble.
    start : float or ndarray, optional
        The energy at the start; without one, that of the first record.
    rises : bool, default False
        Whether only a gain counts, as of methods that damp.
    """
    if t.size < 2:
        return ""
    of = " of member {}" if energy.ndim > 1 else ""
    energy, kinetic = energy.reshape(t.size, -1), np.abs(kinetic).reshape(t.size, -1)
    first = energy[0] if start is None else np.atleast_1d(start)
    with np.errstate(all="ignore"):
        mean = np.cumsum(kinetic, axis=0) / np.arange(1, t.size + 1)[:, None]
        change = energy - first
        change = change if rises else np.abs(change)
        found = change > np.maximum(np.abs(first) + mean, PART * kinetic)
        size = np.maximum(np.abs(first), mean[-1])
        jump, place = largest_jump(energy, rises=rises)
        is_jump = jump > JUMP * size
    if found.any():
        k = int(np.argmax(found.any(axis=1)))
        member = int(np.argmax(found[k]))
        return (
            f"the energy{of.format(member)} has changed from {first[member]:.3g} to "
            f"{energy[k, member]:.3g} at t = {t[k]:.6g}, by more than its own size: "
            "steps were too large before"
        )
    if is_jump.any():
        member = int(np.argmax(is_jump))
        k, part = place[member], 100 * jump[member] / size[member]
        return (
            f"the energy{of.format(member)} has jumped by {part:.2g} % of its size between "
            f"t = {t[k]:.6g} and t = {t[k + 1]:.6g}: steps were too large there"
        )
    return ""


def largest_jump(energy: np.ndarray, *, rises: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much all energies before a place are at least off those after it, and where.

    An error that comes and goes, as that of a symplectic method, has no such place. Not a jump is a
    change that the others are like: it is a thousand times the median change, else 0.
    """
    below, above = np.minimum.accumulate(energy), np.maximum.accumulate(energy)
    last = energy[::-1]
    lowest, highest = np.minimum.accumulate(last)[::-1], np.maximum.accumulate(last)[::-1]
    gap = lowest[1:] - above[:-1]
    if not rises:
        gap = np.maximum(gap, below[:-1] - highest[1:])
    place = np.argmax(gap, axis=0)
    jump = np.take_along_axis(gap, place[None], axis=0)[0]
    usual = np.median(np.abs(np.diff(energy, axis=0)), axis=0)
    return np.where(jump > CONSPICUOUS * usual, jump, 0.0), place
