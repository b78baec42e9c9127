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


#: Measurements less unknowns that are none but for roundoff.
ROUNDED = 1e-9

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


def robust(loss: Loss, residuals: Array, jacobian: Array, covariance: Array, priors: int) -> Array:
    r"""Return the covariance of a robust fit from that of least squares.

    .. math::

        H^{-1} V H^{-1}, \quad
        H = \frac{\overline{\psi'}}{K} J^T J + P, \quad
        V = \frac{\sum \psi^2}{N - p} J^T J + P, \quad
        K = 1 + \frac{p}{N} \frac{\operatorname{var} \psi'}{(\overline{\psi'})^2}

    :cite:t:`huber1981`, equation (6.5) of chapter 7, with N residuals of measurements in units of
    their deviation and p unknowns that these determine. The last rows of the Jacobian are those of
    priors, whose squares count, :math:`P`; the trace of :math:`J (J^T J + P)^{-1} J^T` is p.

    Raises
    ------
    ValueError
        So many residuals are beyond their deviation that the loss has no curvature.
    """
    count = residuals.size - priors
    own, known = jacobian[:count], jacobian[count:]
    r, p = residuals[:count], float(np.einsum("ij,jk,ik->", own, covariance, own))
    _, first, second = loss(r**2)
    score, slope = r * first, first + 2 * r**2 * second
    mean = float(np.mean(slope))
    if not mean > 0:
        sentence = "so many residuals are beyond sigma that nothing is known of how good the fit is"
        raise ValueError(hinted(sentence, "give the sigma of a measurement without outliers"))
    factor = 1 + p / count * float(np.var(slope)) / mean**2
    square = float(score @ score) / (count - p) if count - p > ROUNDED else 1.0
    slopes, of_priors = own.T @ own, known.T @ known
    curvature = mean / factor * slopes + of_priors
    sizes = np.sqrt(np.diagonal(curvature))
    inverse = np.linalg.inv(curvature / np.outer(sizes, sizes)) / np.outer(sizes, sizes)
    found: Array = inverse @ (square * slopes + of_priors) @ inverse
    return found
