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

from dataclasses import dataclass, replace

import numpy as np

from liouville._runs.contacts.complementarity import SOLVED, Array, lemke
from liouville._runs.contacts.cones import cones
from liouville._runs.contacts.matrices import of_contacts

#: Contacts act on one another by more than this part of how they act on themselves.
COUPLED = 1e-13
#: Rows are dependent where an eigenvalue of A is below this part of the largest.
DEPENDENT = 1e-13
#: What a compression brings to rest is within this part of the largest rate.
STOPPED = 1e-12
#: Friction is below its bound by more than this part.
WITHIN = 1e-6
#: The largest number of sweeps, which end where they change nothing but by this part.
MOST_SWEEPS, SETTLED = 20_000, 1e-15
#: They diverge where forces are so many times those of single contacts.
UNBOUNDED = 1e9


@dataclass(frozen=True)
class Forces:
    """Normal forces and friction of all contacts, and what they lead to.

    ``across`` and ``along`` are accelerations of gaps and slips, or rates after an impact, whose
    ``phases`` are its compression and its expansion.
    """

    normal: Array
    friction: Array
    across: Array
    along: Array
    phases: tuple[Forces, ...] = ()


def noise(found: Forces, mu: Array, held: Array, owner: Array) -> float:
    """Return how far accelerations of slips are off zero that friction holds, or drives.

    It holds what is `held` where it is below its bound, and never acts along the slip.
    """
    friction, along = (of_contacts(x, owner) for x in (found.friction, found.along))
    driven = np.bincount(owner, found.friction * found.along, len(mu))[held] / friction[held]
    inside = held & (friction < (1 - WITHIN) * mu * found.normal)
    return float(np.concatenate([driven, along[inside]]).max(initial=0.0))


def solve(
    A: Array,
    b: Array,
    closed: Array,
    slip: Array,
    mu: Array,
    owner: Array,
    borne: Array | None = None,
    pressed: Array | None = None,
) -> Forces | None:
    """Return the forces of the closed contacts; None where none are found.

    Parameters
    ----------
    A, b : ndarray
        Of gaps of all c contacts, then of all s slips.
    closed : ndarray of bool, shape (c,)
        The contacts that may bear a force.
    slip : ndarray, shape (s,)
        The direction of the slip, in the plane its sign; 0 where friction is to be found.
    mu : ndarray, shape (c,)
        The coefficients of friction.
    owner : ndarray of int, shape (s,)
        The contact of each slip.
    borne : ndarray, optional
        Normal forces that there are in any case, as of an expansion.
    pressed : ndarray of bool, optional
        The contacts that bear nothing but these.
    """
    c = len(mu)
    extra = np.zeros(c) if borne is None else borne
    slid = mu[owner] * slip
    base = b + A[:, :c] @ extra - A[:, c:] @ (slid * extra[owner])
    if pressed is not None:
        base[:c][pressed] = 1.0  # no force is needed to keep such a gap
    normal, friction = extra.copy(), np.zeros(len(owner))
    # how each N acts, with the friction of what slips
    across = A[:, :c].copy()
    np.subtract.at(across.T, owner, (A[:, c:] * slid).T)
    moves = np.bincount(owner, np.abs(slip), minlength=c) > 0
    groups, is_alone = _coupled_ones(A, np.flatnonzero(closed), owner)
    sought = (mu > 0) & ~moves  # friction is to be found
    ones = _alone((across, A[:, c:], base), is_alone, sought, (mu, extra), owner)
    for i in groups + [np.array([k]) for k in np.flatnonzero(is_alone & ~ones[0])]:
        own = i[sought[i]]
        rows = np.flatnonzero(_among(own, c)[owner])
        whose = owner[rows]
        group = _Group(
            across[:, i],
            A[:, c + rows],
            base,
            i,
            np.searchsorted(i, whose),
            mu[whose],
            extra[whose],
            c + rows,
        )
        in_plane = _glocker_pfeiffer, _stewart_trinkle, _by_sweeps
        for form in (cones,) if len(own) < len(rows) else in_plane:
            found = form(group)
            if found is not None:
                break
        else:
            return None
        normal[i] += found[0]
        friction[rows] = found[1]
    is_solved, own_normal, own_friction = ones
    normal[is_solved] += own_normal[is_solved]
    rough = (is_solved & sought)[owner]
    friction[rough] = own_friction[owner][rough]
    slides = (closed & ~sought)[owner]
    friction[slides] = (-slid * normal[owner])[slides]
    both = A @ np.concatenate([normal, friction]) + b
    return Forces(normal, friction, both[:c], both[c:])


def _among(contacts: Array, c: int) -> Array:
    """Return which of all contacts are these."""
    found = np.zeros(c, dtype=bool)
    found[contacts] = True
    return found


def _coupled_ones(A: Array, contacts: Array, owner: Array) -> tuple[list[Array], Array]:
    """Return contacts in groups that act on one another, and which of all act on none."""
    n, c = len(contacts), len(A) - len(owner)
    if n < 2:
        return [], _among(contacts, c)
    (slips,) = np.nonzero(_among(contacts, c)[owner])
    rows = np.concatenate([contacts, c + slips])
    whose = np.concatenate([np.arange(n), np.searchsorted(contacts, owner[slips])])
    own = np.sqrt(np.abs(np.diag(A)))[rows]
    acts = np.abs(A[np.ix_(rows, rows)]) > COUPLED * np.outer(own, own)
    belongs = (whose[:, None] == np.arange(n)).astype(float)
    near = (belongs.T @ acts @ belongs > 0) | np.eye(n, dtype=bool)
    found, left = [], near.sum(axis=1) > 1
    is_alone = _among(contacts[~left], c)
    for k in np.flatnonzero(left):
        if not left[k]:
            continue
        group = np.arange(n) == k
        while (wider := group | near[group].any(axis=0)).sum() > group.sum():
            group = wider
        left &= ~group
        found.append(contacts[group])
    return found, is_alone


def _alone(
    parts: tuple[Array, Array, Array],
    which: Array,
    sought: Array,
    bounds: tuple[Array, Array],
    owner: Array,
) -> tuple[Array, Array, Array]:
    """Return which contacts that act on no others have just one solution, and N and T of these.

    They are smooth, slip, or have friction in the plane. `parts` are how N and T act on all, and
    what there is without them; `bounds` the coefficients of friction and what contacts bear.
    """
    (normals, tangents, base), (mu, borne) = parts, bounds
    if not which.any():
        return which, 0 * mu, 0 * mu
    k, first = np.arange(len(mu)), np.searchsorted(owner, np.arange(len(mu)))
    rows, p = len(mu) + first, base[k]
    a, b, e, d, q = (
        normals[k, k],
        tangents[k, first],
        normals[rows, k],
        tangents[rows, first],
        base[rows],
    )
    is_given = (a == 0) & (p > 0)
    is_smooth = which & ~sought & (is_given | (a > 0))
    is_rough = which & sought & (np.bincount(owner) == 1) & (d > mu * np.abs(e))
    is_rough &= is_given | (a > mu * np.abs(b))
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = np.maximum(-p / a, 0.0)
        # friction that sticks, with what it bears in any case where nothing presses besides
        stuck = (b * q - d * p) / (a * d - b * e)
        stuck, is_held = np.where(is_given | (stuck < 0), 0.0, stuck), ~is_given & (stuck >= 0)
        friction = np.where(is_held, (e * p - a * q) / (a * d - b * e), -q / d)
        rough = stuck
        for way in (-1.0, 1.0):
            most = np.maximum(-(p + way * mu * borne * b) / (a + way * mu * b), 0.0)
            most = np.where(is_given, 0.0, most)
            force = way * mu * (most + borne)
            slips = (e * most + d * force + q) * way <= 0
            rough, friction = np.where(slips, most, rough), np.where(slips, force, friction)
    return is_smooth | is_rough, np.where(is_rough, rough, normal), friction


@dataclass(frozen=True)
class _Group:
    """Contacts that act on one another.

    Attributes
    ----------
    normals, tangents : ndarray
        How N of each, with its friction if it slips, and T of those with friction to be found act
        on all gaps and slips.
    b : ndarray
        What there is without them.
    i, j : ndarray of int
        The contacts, and the places among them of those with friction to be found.
    mu, borne : ndarray
        Coefficients of friction, and normal impulses that there are in any case, of these.
    slips : ndarray of int
        The rows of the slips whose friction is to be found.
    """

    normals: Array
    tangents: Array
    b: Array
    i: Array
    j: Array
    mu: Array
    borne: Array
    slips: Array

    @property
    def rows(self) -> tuple[Array, Array]:
        """The rows of the gaps, and of the slips whose friction is to be found."""
        return self.i, self.slips


def _glocker_pfeiffer(group: _Group) -> tuple[Array, Array] | None:
    """Return N and T; with z = (N, x = T + mu N_all, ds-) and w = (dds, ds+, 2 mu N_all - x)."""
    p, m, mu, tangents = len(group.i), len(group.j), group.mu, group.tangents
    b, normals = group.b - tangents @ (mu * group.borne), group.normals.copy()
    normals[:, group.j] -= tangents * mu
    Z = np.zeros((p + 2 * m, p + 2 * m))
    for rows, own in zip((slice(p), slice(p, p + m)), group.rows, strict=True):
        Z[rows, :p], Z[rows, p : p + m] = normals[own], tangents[own]
    Z[p : p + m, p + m :] = np.eye(m)
    Z[np.arange(p + m, p + 2 * m), group.j] = 2 * mu
    Z[p + m :, p : p + m] = -np.eye(m)
    z = lemke(Z, np.concatenate([*(b[own] for own in group.rows), 2 * mu * group.borne]))
    if z is None:
        return None
    return z[:p], z[p : p + m] - mu * (z[group.j] + group.borne)


def _stewart_trinkle(group: _Group) -> tuple[Array, Array] | None:
    """Return N and T; with z = (N, T+, T-, size).

    There w = (dds, size + ds, size - ds, mu N_all - T+ - T-).
    """
    p, m, b = len(group.i), len(group.j), group.b
    gaps, slips = group.rows
    both = np.hstack([group.normals, group.tangents, -group.tangents])
    Z = np.zeros((p + 3 * m, p + 3 * m))
    Z[: p + 2 * m, : p + 2 * m] = np.vstack([both[gaps], both[slips], -both[slips]])
    one = np.eye(m)
    Z[p : p + 2 * m, p + 2 * m :] = np.vstack([one, one])
    Z[p + 2 * m :, p : p + 2 * m] = -np.hstack([one, one])
    Z[np.arange(p + 2 * m, p + 3 * m), group.j] = group.mu
    z = lemke(Z, np.concatenate([b[gaps], b[slips], -b[slips], group.mu * group.borne]))
    if z is None:
        return None
    return z[:p], z[p : p + m] - z[p + m : p + 2 * m]


def _by_sweeps(group: _Group) -> tuple[Array, Array] | None:
    """Return N and T by sweeps over the contacts, where a body is wedged in between others.

    There rows are redundant and a self-stress is within the cones, and Lemke's method ends in a ray
    by roundoff.
    """
    p, j, mu, q = len(group.i), group.j, group.mu, group.b[np.concatenate(group.rows)]
    K = np.hstack([group.normals, group.tangents])[np.concatenate(group.rows)]
    x, own = np.zeros(len(q)), np.diag(K)
    if not (own > 0).all():
        return None
    for _ in range(MOST_SWEEPS):
        before = x.copy()
        for k in range(len(q)):
            x[k] -= (K[k] @ x + q[k]) / own[k]
            if k < p:
                x[k] = max(x[k], 0.0)
            else:
                most = mu[k - p] * (x[j[k - p]] + group.borne[k - p])
                x[k] = min(max(x[k], -most), most)
        change, size = np.abs(x - before).max(), np.abs(x).max()
        if change <= SETTLED * size:
            break
        if not size < UNBOUNDED * (np.abs(q) / own).max():
            return None
    w, N, T = K @ x + q, x[:p], x[p:]
    small, weak = SOLVED * (np.abs(K) @ np.abs(x) + np.abs(q)).max(), SOLVED * np.abs(x).max()
    sticks = np.abs(T) < mu * (N[j] + group.borne) - weak
    off = [-w[:p].min(), *np.abs(w[:p][weak < N]), *np.abs(w[p:][sticks]), *(w[p:] * np.sign(T))]
    return (N, T) if max(off) <= small else None


def without_contradictions(A: Array, rates: Array, touching: Array, owner: Array) -> Array:
    """Return rates whose part that dependent rows say twice, and not alike, is left out."""
    rows, found = np.flatnonzero(np.concatenate([touching, touching[owner]])), rates.copy()
    values, vectors = np.linalg.eigh(A[np.ix_(rows, rows)])
    twice = vectors[:, values <= DEPENDENT * values.max(initial=0.0)]
    if twice.size:
        found[rows] -= twice @ (twice.T @ rates[rows])
    return found


def impact(
    A: Array,
    before: Array,
    touching: Array,
    restitution: Array,
    mu: Array,
    owner: Array,
    law: str,
) -> Forces | None:
    """Return the impulses of an impact of contacts that touch, and the rates after it.

    `before` are the rates before it, of gaps and then of slips. Poisson's law has a compression,
    after which nothing approaches, and an expansion with at least `restitution` of its impulses.
    Newton's law has rates of at least `restitution` of those before.
    """
    c = len(mu)
    free, hit = np.zeros(len(owner)), np.zeros(c, dtype=bool)
    groups, is_alone = _coupled_ones(A, np.flatnonzero(touching), owner)
    hit[is_alone] = before[:c][is_alone] < 0
    for group in groups:
        hit[group] = (before[group] < 0).any()
    if law == "newton":
        bounced = before + np.append(
            restitution * np.minimum(before[:c], 0.0), np.zeros(len(owner))
        )
        found = solve(A, bounced, hit, free, mu, owner)
        if found is None:
            return None
        after = A @ np.concatenate([found.normal, found.friction]) + before
        return Forces(found.normal, found.friction, after[:c], after[c:], (found,))
    pressed = solve(A, before, hit, free, mu, owner)
    if pressed is None:
        return None
    if not (restitution * pressed.normal).any():
        return replace(pressed, phases=(pressed,))
    middle = np.concatenate([pressed.across, pressed.along])
    middle[np.abs(middle) <= STOPPED * np.abs(before).max()] = 0.0
    rest = solve(A, middle, hit, free, mu, owner, borne=restitution * pressed.normal)
    if rest is None:
        return None
    normal, friction = pressed.normal + rest.normal, pressed.friction + rest.friction
    after = A @ np.concatenate([normal, friction]) + before
    return Forces(normal, friction, after[:c], after[c:], (pressed, rest))
