r"""Contacts that share a load: more of them than independent rows.

Their motion is that of a mode, their forces are not determined. A mode lasts as long as *some*
forces that give its accelerations are within their bounds, which is a linear program: the margin is

.. math:: \max_{N, T} \min_k \{ N_k,\; \mu_k N_k - T_k,\; \mu_k N_k + T_k \} .
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.scipy import scipy
from liouville._runs.contacts.complementarity import Array
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._runs.contacts.traced import Contacts, Matrices

#: Forces below this part of those that would move the system so are none.
NONE, ROUNDED = 1e-9, 1e-14
#: The largest margin, in units of what the forces lead to.
LARGEST = 1.0


def gives_way(contacts: Contacts, at: Matrices, modes: tuple[Mode, ...]) -> bool:
    """Return whether no forces within their bounds give the accelerations of a mode."""
    return _program(contacts, at, modes)[0] < -ROUNDED * _weight(at)


def _weight(at: Matrices) -> float:
    """Return the size of forces that give the accelerations that there are without them."""
    return float(np.abs(at.free).max() / (np.abs(at.moves).max() or 1.0))


def forces_of(contacts: Contacts, at: Matrices, modes: tuple[Mode, ...]) -> tuple[Array, Array]:
    """Return normal forces and friction with the largest margin."""
    return _program(contacts, at, modes)[1:]


def _program(
    contacts: Contacts, at: Matrices, modes: tuple[Mode, ...]
) -> tuple[float, Array, Array]:
    c = len(modes)
    closed = [k for k, mode in enumerate(modes) if mode is not Mode.OPEN]
    sticks = [k for k, mode in enumerate(modes) if mode is Mode.STICK]
    columns = np.zeros((2 * c, len(closed) + len(sticks)))
    for j, k in enumerate(closed):
        columns[:, j] = at.A[:, k] - at.A[:, c + k] * contacts.friction[k] * modes[k].sign
    for j, k in enumerate(sticks):
        columns[:, len(closed) + j] = at.A[:, c + k]
    active = [*closed, *(c + k for k in sticks)]
    # the rows that are independent, by their singular values: the others follow to roundoff
    u, values, vt = np.linalg.svd(columns[active], full_matrices=False)
    own = values > 1e-10 * values.max(initial=0.0)
    equal = np.hstack([vt[own], np.zeros((own.sum(), 1))])
    sides = -(u.T @ at.b[active])[own] / values[own]
    scale = max(np.abs(sides).max(initial=0.0), NONE * _weight(at)) or 1.0
    bounds = []
    for j in range(len(closed)):
        bounds.append(np.eye(1, columns.shape[1], j)[0])
    for j, k in enumerate(sticks):
        for sign in (1.0, -1.0):
            row = np.zeros(columns.shape[1])
            row[closed.index(k)] = contacts.static[k]
            row[len(closed) + j] = sign
            bounds.append(row)
    bounds.append(np.zeros(columns.shape[1]))  # contacts that wedge a body in have no largest one
    upper = np.hstack([-np.array(bounds), np.ones((len(bounds), 1))])
    sides_of_bounds = np.append(np.zeros(len(bounds) - 1), LARGEST)
    cost = np.zeros(columns.shape[1] + 1)
    cost[-1] = -1.0
    optimize = scipy("optimize", "forces that contacts share")
    found = optimize.linprog(
        cost,
        upper,
        sides_of_bounds,
        equal,
        sides / scale,
        bounds=(None, None),
        method="highs",
    )
    normal, friction = np.zeros(c), np.zeros(c)
    if found.x is None:
        return -np.inf, normal, friction
    x = found.x * scale
    normal[closed] = x[: len(closed)]
    for k in closed:
        friction[k] = -contacts.friction[k] * modes[k].sign * normal[k]
    friction[sticks] = x[len(closed) : -1]
    return float(x[-1]), normal, friction
