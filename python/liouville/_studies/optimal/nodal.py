"""Controls at nodes from the costates: the minimum of the Hamiltonian there."""

from __future__ import annotations

import numpy as np

from liouville._basics import casadi as ca
from liouville._studies.optimal.arguments import Array
from liouville._studies.optimal.transcription import Equations

#: The most corrections of a minimum, and the size of the last one.
MOST, LAST = 30, 1e-14


class Hamiltonian:
    r"""The control Hamiltonian :math:`l(t, y, z, u) + \pi^T f(t, y, z, u)` as a function of u."""

    def __init__(self, equations: Equations) -> None:
        n, k = equations.n, equations.size
        t, y, z = ca.SX.sym("t"), ca.SX.sym("y", n), ca.SX.sym("z", n)
        pi, u = ca.SX.sym("pi", n), ca.SX.sym("u", k)
        value = ca.dot(pi, equations.at("stage", t, y, z, u=u)[2])
        if "cost" in equations._functions:
            value += equations.at("cost", t, y, z, u=u)
        slope = ca.densify(ca.gradient(value, u))
        curvature = ca.jacobian(slope, u)
        #: Whether each control is in the Hamiltonian otherwise than linearly.
        self.is_curved = np.bincount(curvature.sparsity().row(), minlength=k) > 0
        inputs = [t, y, z, pi, u]
        self._slopes = ca.Function("slopes", inputs, [slope, ca.densify(curvature)])

    def slopes(self, at: tuple[Array, ...], u: Array) -> tuple[Array, Array]:
        """Return gradients (N, k) and curvatures (N, k, k) at N nodes."""
        N, k = u.shape
        slope, curvature = self._slopes.map(N)(*(x.reshape(N, -1).T for x in at), u.T)
        return np.array(slope).T, np.array(curvature).T.reshape(N, k, k)

    def minimum(self, at: tuple[Array, ...], u: Array, bounds: Array) -> Array | None:
        """Return where it is least within bounds, from a guess; None where it is not determined.

        Controls that are in it linearly are at a bound, by the sign of its slope.
        """
        low, high = bounds
        linear = ~self.is_curved
        if linear.any() and not np.isfinite(bounds[:, linear]).all():
            return None
        for _ in range(MOST):
            slope, curvature = self.slopes(at, u)
            held = np.logical_or(linear, (u <= low) & (slope > 0)) | ((u >= high) & (slope < 0))
            step = _newton(slope, curvature, held)
            if step is None:
                return None
            new = np.where(linear, np.where(slope > 0, low, high), np.clip(u - step, low, high))
            change = np.abs(new - u).max(initial=0.0)
            u = new
            if not change > LAST * np.abs(u).max(initial=1.0):
                return u
        return None


def _newton(slope: Array, curvature: Array, held: Array) -> Array | None:
    """Return Newton's corrections of the controls that are not held; None at no minimum."""
    both = np.logical_or(held[:, :, None], held[:, None, :])
    matrix = np.where(both, np.eye(slope.shape[1]), curvature)
    if not np.isfinite(matrix).all() or not (np.linalg.eigvalsh(matrix) > 0).all():
        return None
    found: Array = np.linalg.solve(matrix, np.where(held, 0.0, slope)[:, :, None])[:, :, 0]
    return found
