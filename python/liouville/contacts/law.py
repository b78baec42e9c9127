r"""The laws of contact: accelerations and impulses as complementarity problems.

Unknown are normal forces N and friction T of the closed contacts, with

.. math::

    \ddot\varphi = A_{nn} N + A_{nt} T + b_n \ge 0, \quad N \ge 0, \quad N \ddot\varphi = 0,

and, where the slip is zero, :math:`|T| \le \mu N` with :math:`\dot s \ne 0` only where
:math:`T = -\mu N \operatorname{sign} \dot s`. Two forms of the problem are solved, one after the
other: that of Glocker and Pfeiffer (Nonlinear Dynamics 3, 1992), with
:math:`x = T + \mu N` and the parts of :math:`\dot s`, and that of Stewart and Trinkle (IJNME 39,
1996), for which Lemke's method finds impulses wherever there are some (Anitescu and Potra 1997).
Impulses obey the same problem with rates in the place of accelerations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liouville.contacts.complementarity import Array, lemke


@dataclass(frozen=True)
class Forces:
    """Normal forces and friction of all contacts, and what they lead to.

    ``across`` and ``along`` are accelerations of gaps and slips, or rates after an impact.
    """

    normal: Array
    friction: Array
    across: Array
    along: Array


def solve(
    A: Array, b: Array, closed: Array, slip: Array, mu: Array, borne: Array | None = None
) -> Forces | None:
    """Return the forces of the closed contacts; None where none are found.

    Parameters
    ----------
    A, b : ndarray
        Of gaps, then of slips, of all c contacts.
    closed : ndarray of bool, shape (c,)
        The contacts that may bear a force.
    slip : ndarray of int, shape (c,)
        The sign of the slip, 0 where friction is to be found.
    mu : ndarray, shape (c,)
        The coefficients of friction.
    borne : ndarray, optional
        Normal impulses that there are in any case, as of an expansion.
    """
    c = len(mu)
    i = np.flatnonzero(closed)
    j = np.flatnonzero(closed & (slip == 0) & (mu > 0))  # friction is to be found
    extra = np.zeros(c) if borne is None else borne
    base = b + A[:, :c] @ extra
    for form in (_glocker_pfeiffer, _stewart_trinkle):
        found = form(A, base, i, j, slip, mu, extra)
        if found is None:
            continue
        normal, friction = found
        both = A @ np.concatenate([normal, friction]) + b
        return Forces(normal, friction, both[:c], both[c:])
    return None


def _coupled(A: Array, i: Array, slip: Array, mu: Array) -> tuple[Array, Array]:
    """Return how N of the contacts i acts on gaps and slips, with their friction if they slip."""
    c = len(mu)
    own = A[:, i] - A[:, c + i] * (mu * slip)[i]
    return own[:c], own[c:]


def _borne(N: Array, i: Array, slip: Array, mu: Array, extra: Array) -> tuple[Array, Array]:
    """Return normal forces, and friction as of contacts that slip."""
    normal, friction = extra.copy(), np.zeros(len(mu))
    normal[i] += N
    friction[i] = -(mu * slip)[i] * normal[i]
    return normal, friction


def _glocker_pfeiffer(
    A: Array, b: Array, i: Array, j: Array, slip: Array, mu: Array, extra: Array
) -> tuple[Array, Array] | None:
    """With z = (N, x = T + mu N_all, ds-) and w = (dds, ds+, 2 mu N_all - x)."""
    c, p, m = len(mu), len(i), len(j)
    across, along = _coupled(A, i, slip, mu)
    of_j = np.array([np.flatnonzero(i == k)[0] for k in j], dtype=int)
    b = b - A[:, c + j] @ (mu[j] * extra[j])
    for k, place in zip(j, of_j, strict=True):
        across[:, place] -= A[:c, c + k] * mu[k]
        along[:, place] -= A[c:, c + k] * mu[k]
    Z = np.zeros((p + 2 * m, p + 2 * m))
    Z[:p, :p], Z[:p, p : p + m] = across[i], A[i][:, c + j]
    Z[p : p + m, :p], Z[p : p + m, p : p + m] = along[j], A[c + j][:, c + j]
    Z[p : p + m, p + m :] = np.eye(m)
    Z[np.arange(p + m, p + 2 * m), of_j] = 2 * mu[j]
    Z[p + m :, p : p + m] = -np.eye(m)
    q = np.concatenate([b[i], b[c + j], 2 * mu[j] * extra[j]])
    z = lemke(Z, q)
    if z is None:
        return None
    normal, friction = _borne(z[:p], i, slip, mu, extra)
    friction[j] = z[p : p + m] - mu[j] * normal[j]
    return normal, friction


def _stewart_trinkle(
    A: Array, b: Array, i: Array, j: Array, slip: Array, mu: Array, extra: Array
) -> tuple[Array, Array] | None:
    """With z = (N, T+, T-, size) and w = (dds, size + ds, size - ds, mu N_all - T+ - T-)."""
    c, p, m = len(mu), len(i), len(j)
    across, along = _coupled(A, i, slip, mu)
    tangential = A[:, c + j]
    Z = np.zeros((p + 3 * m, p + 3 * m))
    q = np.concatenate([b[i], b[c + j], -b[c + j], mu[j] * extra[j]])
    for first, sign in ((p, 1.0), (p + m, -1.0)):
        Z[:p, first : first + m] = sign * tangential[i]
        Z[p : p + m, first : first + m] = sign * tangential[c + j]
        Z[p + m : p + 2 * m, first : first + m] = -sign * tangential[c + j]
        Z[p + 2 * m :, first : first + m] = -np.eye(m)
        Z[first : first + m, p + 2 * m :] = np.eye(m)
    Z[:p, :p], Z[p : p + m, :p], Z[p + m : p + 2 * m, :p] = across[i], along[j], -along[j]
    of_j = np.array([np.flatnonzero(i == k)[0] for k in j], dtype=int)
    Z[np.arange(p + 2 * m, p + 3 * m), of_j] = mu[j]
    z = lemke(Z, q)
    if z is None:
        return None
    normal, friction = _borne(z[:p], i, slip, mu, extra)
    friction[j] = z[p : p + m] - z[p + m : p + 2 * m]
    return normal, friction


def impact(
    A: Array, rate: Array, slip: Array, hit: Array, restitution: Array, mu: Array, law: str
) -> Forces | None:
    """Return the impulses of an impact of the contacts `hit`, and the rates after it.

    Poisson's law has a compression, after which nothing approaches, and an expansion with at least
    `restitution` of its impulses. Newton's law has rates of at least `restitution` of those before.
    """
    c = len(mu)
    before, free = np.concatenate([rate, slip]), np.zeros(c, dtype=int)
    if law == "newton":
        bounced = before + np.concatenate([restitution * np.minimum(rate, 0.0), np.zeros(c)])
        found = solve(A, bounced, hit, free, mu)
        if found is None:
            return None
        after = A @ np.concatenate([found.normal, found.friction]) + before
        return Forces(found.normal, found.friction, after[:c], after[c:])
    pressed = solve(A, before, hit, free, mu)
    if pressed is None or not (restitution * pressed.normal).any():
        return pressed
    middle = np.concatenate([pressed.across, pressed.along])
    rest = solve(A, middle, hit, free, mu, borne=restitution * pressed.normal)
    if rest is None:
        return None
    normal, friction = pressed.normal + rest.normal, pressed.friction + rest.friction
    after = A @ np.concatenate([normal, friction]) + before
    return Forces(normal, friction, after[:c], after[c:])
