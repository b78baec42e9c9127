r"""Euler's equations of an ideal fluid in the plane, truncated to some Fourier modes; no units.

The vorticity :math:`\omega = \sum_k \omega_k e^{i k \cdot x}` on the torus, with the modes
:math:`|k_1|, |k_2| \le K` and without k = 0,

.. math::

    \omega_k' = -\sum_{p + q = k} \frac{p_1 q_2 - p_2 q_1}{|p|^2}\, \omega_p \omega_q

Of the modes k and -k, whose vorticities are conjugate, one is kept: the coordinates are the real
and imaginary parts a and b of the :math:`\omega_k` with :math:`k_2 > 0`, or :math:`k_2 = 0` and
:math:`k_1 > 0`. Constant are the "energy" :math:`\tfrac12 \sum |\omega_k|^2 / |k|^2` and the
"enstrophy" :math:`\tfrac12 \sum |\omega_k|^2`, with sums over all modes. No mode drives itself, so
the truncation preserves volume.

T. D. Lee, Quart. Appl. Math. 10 (1952) 69-74. The references, for K = 2, are by extrapolation in
45 digits, two tolerances 3e-35 apart (``tools/field_references.py``).
"""

from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from liouville._systems import PolynomialField
from liouville.problems import Parameters

Mode = tuple[int, int]
Terms = list[tuple[int, Fraction, tuple[int, ...]]]


def modes(largest: int) -> list[Mode]:
    """List the modes that are kept."""
    waves = range(-largest, largest + 1)
    return [(k1, k2) for k2 in range(largest + 1) for k1 in waves if (k2, k1) > (0, 0)]


def terms_of(largest: int) -> Terms:
    """Return the terms of the field, real and imaginary parts in turn."""
    kept = modes(largest)
    place = {k: 2 * m for m, k in enumerate(kept)}
    waves = [*kept, *((-k1, -k2) for k1, k2 in kept)]
    found: Terms = []
    for k in kept:
        for p in waves:
            q = k[0] - p[0], k[1] - p[1]
            turn = p[0] * q[1] - p[1] * q[0]
            if turn and max(map(abs, q)) <= largest:
                found += product(place, k, p, q, Fraction(-turn, p[0] ** 2 + p[1] ** 2))
    return found


def product(place: dict[Mode, int], k: Mode, p: Mode, q: Mode, factor: Fraction) -> Terms:
    """Return the terms of factor * omega_p omega_q in omega_k'."""

    def parts(mode: Mode) -> tuple[int, int, int]:
        sign = 1 if mode in place else -1  # the conjugate's imaginary part
        first = place[sign * mode[0], sign * mode[1]]
        return first, first + 1, sign

    (a, b, s), (c, d, r), at = parts(p), parts(q), place[k]
    return [
        (at, factor, (a, c)),
        (at, -s * r * factor, (b, d)),
        (at + 1, r * factor, (a, d)),
        (at + 1, s * factor, (b, c)),
    ]


def build(largest: int) -> PolynomialField:
    """Make the system with the modes up to a wave number.

    Parameters
    ----------
    largest : int
        The largest wave number K in either direction, at least 1: 4 K (K + 1) coordinates.

    Returns
    -------
    PolynomialField
        With coordinates a(k1,k2), b(k1,k2) for each mode kept.
    """
    if largest < 1:
        raise ValueError(f"the largest wave number must be at least 1, not {largest}")
    kept = modes(largest)
    squares = [k1**2 + k2**2 for k1, k2 in kept for _ in range(2)]

    def energy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
        return ca.dot(x, x / ca.DM(squares))

    def enstrophy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
        return ca.dot(x, x)

    names = tuple(f"{part}({k1},{k2})" for k1, k2 in kept for part in "ab")
    invariants = {"energy": energy, "enstrophy": enstrophy}
    return PolynomialField.from_terms(names, terms_of(largest), invariants=invariants)


def start_for(largest: int) -> dict[str, Any]:
    """Start with vorticities of some sixteenths, smaller for short waves."""
    squares = np.array([k1**2 + k2**2 for k1, k2 in modes(largest)])
    m = np.arange(squares.size)
    parts = np.column_stack([5 * m % 11 - 5, 7 * m % 13 - 6]) / (8 * squares[:, None])
    return {"x": parts.ravel()}


system = build(2)
start: dict[str, Any] = start_for(2)
interval = (0.0, 10.0)
h = 0.1
conserved = ("energy", "enstrophy")
reference = {
    1.0: {
        "x": (
            -0.5550362046542299893577,
            -0.7853343134430546946530,
            -0.007465127110631125442521,
            0.008196638855155116811273,
            -0.01080740057018812873806,
            0.07255303348153335211185,
            0.009235620159576450756586,
            0.04915586498231438087691,
            0.4154266647409687310681,
            -0.5915143241156361946144,
            -0.1372966731132056418472,
            0.2780027475699216485741,
            0.02756694875275874114696,
            0.01514527050411125358202,
            0.1551010575864388568376,
            0.1185961340799903639288,
            -0.1716990653893908611864,
            0.01267585478377904381090,
            -0.02827657622069094855267,
            -0.05899007511108695982562,
            0.01329476504031850706206,
            -0.01038533069451482277363,
            -0.06347464961885470613298,
            -0.07368451331858945430388,
        ),
    },
    10.0: {
        "x": (
            -0.5032554475671736133000,
            0.05321096036143169612213,
            -0.1622226547711743537564,
            -0.03046179113656445955040,
            0.005709695435271350143413,
            0.02784463272336552084895,
            -0.08599051076734642442257,
            0.1570526604894195762242,
            0.06518173805683583535544,
            -1.099282650664558866159,
            -0.03724278308524738443114,
            0.01681895864097230946841,
            0.01447405904518595947282,
            0.1025107345806448363425,
            0.06299043839586722509782,
            -0.1890944267137816708857,
            0.06010872108596584641854,
            0.09353894062809241285418,
            -0.02525245662453258725263,
            -0.1625639433617329687230,
            -0.05489952614021157013343,
            -0.009934412644088858785728,
            0.08641325404672010862448,
            0.05656197719881257545484,
        ),
    },
}
source = "truncation of Lee (1952); extrapolation in 45-digit arithmetic"
