"""How well a method keeps volume: the determinant of the Jacobian of its steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from liouville._basics.progress import Progress
from liouville._methods import VolumeSplitting
from liouville._runs.choice import named, no_runner
from liouville._runs.execute import execute
from liouville._runs.runner import Request
from liouville._solution.solution import Solution
from liouville._systems import Field, PolynomialField

if TYPE_CHECKING:
    from liouville._methods.planner import FieldPlan


def determinant(
    system: Field,
    method: VolumeSplitting | FieldPlan | str = "auto",
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    every: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
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
    >>> found = lv.analysis.determinant(
    ...     euler_top.system, lv.VolumeSplitting(), t=(0, 1), steps=10, x=[1.0, 0.5, 0.2]
    ... )
    >>> bool(found.observed["defect"][-1] < 1e-14)
    True
    """
    if not isinstance(system, Field):
        raise TypeError(
            f"determinants must be those of a field without divergence, not of {system!r}"
        )
    from liouville._methods.planner import FieldPlan
    from liouville._runs.fields.determinant import (
        DeterminantRunner,
        Determinants,
        ParticleDeterminantRunner,
        PlaneDeterminantRunner,
    )
    from liouville._systems.fields.particles import ChargedParticles

    method = named(system, method)
    if not isinstance(method, VolumeSplitting | FieldPlan):
        raise no_runner(method, "field", "polynomial fields")
    request = Request(t=t, h=h, steps=steps, every=every, params=params, start={"x": x})
    kind: type[Determinants] = PlaneDeterminantRunner
    if isinstance(system, ChargedParticles):
        kind = ParticleDeterminantRunner
    elif isinstance(system, PolynomialField):
        kind = DeterminantRunner
    return execute(kind(system, method, request), progress)
