"""Whether the energy of a conservative system has changed by more than its own size."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

#: The part of the kinetic energy that an error of the energy may be without a word.
PART = 0.1


def change_of_energy(t: np.ndarray, parts: Mapping[str, np.ndarray], *, rises: bool) -> str:
    r"""Say where the energy has changed by more than its own size since the first record, or "".

    The size of an energy that is :math:`E_0` first is :math:`|E_0|` and the mean so far of the
    kinetic energy :math:`v^T p / 2`, but not below a tenth of the present one. With `rises` only a
    gain counts, as of methods that damp. The states must be among the parts.
    """
    if not {"invariant energy", "v", "p"} <= parts.keys() or t.size < 2:
        return ""
    with np.errstate(all="ignore"):
        energy = parts["invariant energy"][..., 0].reshape(t.size, -1)
        kinetic = np.abs(np.sum(parts["v"] * parts["p"], axis=-1)).reshape(t.size, -1) / 2
        mean = np.cumsum(kinetic, axis=0) / np.arange(1, t.size + 1)[:, None]
        change = energy - energy[0]
        change = change if rises else np.abs(change)
        found = change > np.maximum(np.abs(energy[0]) + mean, PART * kinetic)
    if not found.any():
        return ""
    k = int(np.argmax(found.any(axis=1)))
    member = int(np.argmax(found[k]))
    whose = f" of member {member}" if parts["invariant energy"].ndim == 3 else ""
    return (
        f"the energy{whose} has changed from {energy[0, member]:.3g} to {energy[k, member]:.3g} "
        f"at t = {t[k]:.6g}, by more than its own size: steps were too large before"
    )
