r"""Robust losses :math:`\rho(z)` of squared residuals z, under which outliers count less.

They are SciPy's: the sum of :math:`\rho(r^2)` is least. The score of a residual is
:math:`\psi(r) = r \rho'(r^2)`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from liouville._basics.errors import hinted
from liouville.analysis.point import Array

#: A loss and its first two derivatives by z.
Loss = Callable[[Array], tuple[Array, Array, Array]]


def _linear(z: Array) -> tuple[Array, Array, Array]:
    return z, np.ones_like(z), np.zeros_like(z)


def _huber(z: Array) -> tuple[Array, Array, Array]:
    far = np.maximum(z, 1.0)
    is_near = z <= 1
    return (
        np.where(is_near, z, 2 * np.sqrt(far) - 1),
        np.where(is_near, 1.0, far**-0.5),
        np.where(is_near, 0.0, -0.5 * far**-1.5),
    )


def _soft_l1(z: Array) -> tuple[Array, Array, Array]:
    t = 1 + z
    return 2 * z / (np.sqrt(t) + 1), t**-0.5, -0.5 * t**-1.5


def _cauchy(z: Array) -> tuple[Array, Array, Array]:
    t = 1 + z
    return np.log1p(z), 1 / t, -1 / t**2


LOSSES: dict[str, Loss] = {
    "linear": _linear, "huber": _huber, "soft_l1": _soft_l1, "cauchy": _cauchy,
}  # fmt: skip


def loss_of(name: str, sigma: object) -> Loss:
    """Return a loss by its name; ValueError where there is none, or no deviation to measure by."""
    if not isinstance(name, str) or name not in LOSSES:
        known = ", ".join(map(repr, LOSSES))
        raise ValueError(f"loss must be one of {known}, not {name!r}")
    if name != "linear" and sigma is None:
        sentence = f"loss={name!r} makes residuals count less beyond their deviation"
        raise ValueError(hinted(sentence, "give sigma=, that of a measurement without outliers"))
    return LOSSES[name]


def spread(loss: Loss, residuals: Array, unknowns: int) -> float:
    r"""Return the factor of :math:`(J^T J)^{-1}` in the covariance of a robust fit.

    .. math::

        K^2 \frac{\sum \psi^2 / (N - p)}{(\overline{\psi'})^2}, \qquad
        K = 1 + \frac{p}{N} \frac{\operatorname{var} \psi'}{(\overline{\psi'})^2}

    :cite:t:`huber1981`, equation (6.5) of chapter 7, with N residuals in units of their deviation
    and p unknowns. It is 1 in the mean where no outlier is.
    """
    _, first, second = loss(residuals**2)
    score, slope = residuals * first, first + 2 * residuals**2 * second
    mean, count = float(np.mean(slope)), residuals.size
    factor = 1 + unknowns / count * float(np.var(slope)) / mean**2
    return factor**2 * float(score @ score) / (count - unknowns) / mean**2
