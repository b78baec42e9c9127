"""Finite-time Lyapunov exponents: how much the neighbourhoods of many starts are stretched."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import Suggesting, hinted, misshapen
from liouville._basics.progress import Progress
from liouville._methods import VolumeSplitting
from liouville._runs.ensemble import ensemble
from liouville._solution.failure import Failure
from liouville._systems import Field

if TYPE_CHECKING:
    from liouville._methods.planner import FieldPlan

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Stretching(Suggesting):
    """How much the neighbourhoods of starts are stretched.

    Attributes
    ----------
    exponents : ndarray, shape (...)
        Of each start, in one over the system's unit of time; NaN where its run failed.
    directions : ndarray, shape (..., n)
        The unit vectors at the starts along which neighbours part the most.
    x : ndarray, shape (..., n)
        The states at the end, NaN where there is none.
    failures : dict of int to Failure
        Starts that failed, by number in the order of memory.
    """

    exponents: Array
    directions: Array
    x: Array
    failures: Mapping[int, Failure]

    def __repr__(self) -> str:
        """Return how many there are, and the largest."""
        known = self.exponents[np.isfinite(self.exponents)]
        largest = f"up to {known.max():.4g}" if known.size else "all failed"
        return f"<Stretching of {self.exponents.size} starts: {largest}>"


def ftle(
    system: Field,
    method: VolumeSplitting | FieldPlan | str = "auto",
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
    threads: int | None = None,
    x: ArrayLike,
) -> Stretching:
    r"""Compute finite-time Lyapunov exponents of a field, for a grid of starts or any others.

    .. math::

        \sigma(x_0) = \frac{1}{|t_1 - t_0|} \ln \| D \varphi(x_0) \|

    with the derivative of the flow from :math:`t_0` to :math:`t_1`, by tangents of the steps: no
    neighbours are followed, and the exponents are those of the starts themselves. Ridges of
    :math:`\sigma` are where trajectories part; those of a run backwards in time are where they come
    together.

    Parameters
    ----------
    system : PolynomialField, GriddedField, PotentialField or ChargedParticles
        What moves. On a sphere or a cylinder lengths are those of space, with the heights of levels
        in the unit of the radius.
    method, t, h, steps, params, progress, threads
        As for :func:`liouville.ensemble`; t may run backwards.
    x : array_like, shape (..., n)
        Starts, such as the nodes of a grid, of shape (nx, ny, 2).

    Returns
    -------
    Stretching
        Exponents of shape (...), the directions that are stretched most, and the ends.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As for :func:`liouville.ensemble`.
    IntegrationError
        The start of none can be taken.

    References
    ----------
    :cite:t:`shadden2005`.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> saddle = lv.PolynomialField(lambda t, x, params: [2 * x[0], -2 * x[1]], x=2)
    >>> x = np.zeros((4, 5, 2))
    >>> found = lv.analysis.ftle(saddle, lv.VolumeSplitting(), t=(0, 3), h=0.1, x=x)
    >>> found.exponents.shape, bool(abs(found.exponents - 2).max() < 1e-13)
    ((4, 5), True)
    """
    if not isinstance(system, Field):
        sentence = f"exponents must be those of a field without divergence, not of {system!r}"
        raise TypeError(
            hinted(sentence, "lv.analysis.lyapunov has exponents of mechanical systems")
        )
    n, starts = len(system.coordinates), np.asarray(x, dtype=float)
    if starts.ndim < 2 or starts.shape[-1] != n:
        raise misshapen("x", starts.shape, f"(P, {n}) or more axes before the last")
    rows, shape = starts.reshape(-1, n), starts.shape[:-1]
    run = ensemble(
        system, method, t=t, h=h, steps=steps, every=2**31, params=params, progress=progress,
        threads=threads, tangents={"x": np.eye(n)}, x=rows,
    )  # fmt: skip
    assert run.tangents is not None
    # the change of each coordinate at the end by each at the start, in lengths
    change = run.tangents["x"].x[-1].swapaxes(-1, -2)
    change = system.lengths(run.x[-1])[..., None] * change / system.lengths(rows)[:, None, :]
    known = np.isfinite(change).all(axis=(-1, -2))
    known[[*run.failures]] = False  # where all have failed, the last record is before the end
    exponents, directions = np.full(len(rows), np.nan), np.full((len(rows), n), np.nan)
    ends = np.where(known[:, None], run.x[-1], np.nan)
    _, sizes, vectors = np.linalg.svd(change[known])
    if known.any():
        exponents[known] = np.log(sizes[:, 0]) / abs(run.t[-1] - run.t[0])
    directions[known] = vectors[:, 0]
    return Stretching(
        exponents.reshape(shape), directions.reshape(starts.shape),
        ends.reshape(starts.shape), run.failures,
    )  # fmt: skip
