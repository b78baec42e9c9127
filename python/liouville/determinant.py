"""How well a method keeps volume: the determinant of the Jacobian of its steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import check_memory
from liouville.integrate import run
from liouville.methods import VolumeSplitting
from liouville.planner import Plan
from liouville.routes import Asked, FieldRoute, route
from liouville.solution import Solution
from liouville.splitting import crossed
from liouville.systems import PolynomialField


def determinant(
    system: PolynomialField,
    method: VolumeSplitting | Plan,
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    every: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Callable[[float, float], None] | None = None,
    x: ArrayLike,
) -> Solution:
    r"""Measure the volume that a run keeps: det of the Jacobian of its steps, by forward tangents.

    The tangents of each step start from the identity, so that the determinant of a step is known to
    roundoff however chaotic the flow is; that of the run is the product of those of its steps. The
    trajectory is that of :func:`liouville.integrate`, bit for bit.

    Parameters
    ----------
    system, method, t, h, steps, every, params, progress
        As for :func:`liouville.integrate`.
    x : array_like, shape (n,)
        Start.

    Returns
    -------
    Solution
        Beside ``x`` has ``observed["log_determinant"]``, the sum of :math:`\ln|\det D\Phi_h|` over
        the steps so far, and ``observed["defect"]``, the largest :math:`|\det D\Phi_h - 1|` so far,
        both of shape (k,).

    Raises
    ------
    TypeError, ValueError, MemoryError, IntegrationError
        As for :func:`liouville.integrate`.

    Notes
    -----
    A step costs about n / 8 + 1 times as much as without tangents, and an LU factorisation of order
    n: this is for fields of up to a few hundred variables.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import euler_top
    >>> found = lv.determinant(
    ...     euler_top.system, lv.VolumeSplitting(), t=(0, 1), steps=10, x=[1.0, 0.5, 0.2]
    ... )
    >>> bool(found.observed["defect"][-1] < 1e-14)
    True
    """
    if not isinstance(system, PolynomialField):
        raise TypeError(f"determinants are those of a PolynomialField, not of {system!r}")
    asked = Asked(
        t=t, h=h, steps=steps, control={}, every=every,
        observe=None, params=params, states=True, start={"x": x},
    )  # fmt: skip
    path = route(system, method, asked)
    assert isinstance(path, FieldRoute)
    return run(_DeterminantRoute(path), progress)


class _DeterminantRoute(FieldRoute):
    """A field's route, with tangents."""

    def __init__(self, path: FieldRoute) -> None:
        vars(self).update(vars(path))
        n = len(path.system.coordinates)
        self.columns = {"x": n, "observed log_determinant": 1, "observed defect": 1}
        hint = "this is for fields of up to a few hundred variables: take a smaller one of the kind"
        check_memory(f"the Jacobian of {n} variables", 8.0 * n * n, hint)

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""
        pace, parts, method = self.pace, self.split, self.plan.method
        return _core.determinant_run(
            crossed(parts), method.composition, np.ascontiguousarray(parts.inward(self.x)[0]),
            (len(self.system.coordinates), parts.outward),
            (pace.t0, pace.t1, pace.count, self.every), method.compensated,
        )  # fmt: skip

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""
        if trouble.get("quantity") == "observable":
            return (
                "the Jacobian of the step is singular to roundoff, its determinant unknown",
                "the step stretches some directions too much over others: try a smaller h",
                "determinant",
            )
        return super().describe(trouble)
