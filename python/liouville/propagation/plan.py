"""The plan of a propagation: method, steps, products and the bound of the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from liouville.errors import hinted
from liouville.systems import Schrodinger

#: What to try where a plan does not fit.
AGAIN = "make one for this run with lv.propagation(...)"


@dataclass(frozen=True, repr=False)
class Propagation:
    r"""How a wave function is propagated, with nothing left to choose, and why.

    :func:`liouville.propagation` makes it, :func:`liouville.integrate` takes it as a method.

    Attributes
    ----------
    method : str
        The method in words, such as ``"L32_9.4 (stable splitting of 32 shears)"``.
    tol : float or None
        The tolerance it keeps to; None where steps are given instead.
    t0 : float
        Time of the start.
    stops : tuple of (float, int)
        Times of the states that are kept, and the steps to each from the one before.
    theta : float
        Length of the longest step in units of :math:`1/\beta`, with :math:`\beta` half the width
        of the spectrum.
    bounds : tuple of float
        Smallest and largest eigenvalue it is safe for, in units of :math:`\hbar/t`.
    products : float
        Products :math:`H \psi` it takes, two real ones each; for Lanczos an estimate.
    bound : float or None
        A-priori bound of the error at the end, relative to the norm, roundings included; None
        where none is known.
    reasons : tuple of str
        Why, and what else there was.
    """

    form: ClassVar[str] = "wave"
    method: str
    tol: float | None
    t0: float
    stops: tuple[tuple[float, int], ...]
    theta: float
    bounds: tuple[float, float]
    products: float
    bound: float | None
    reasons: tuple[str, ...] = ()
    core: tuple[Any, ...] = field(default=(), repr=False)

    @property
    def steps(self) -> int:
        """Number of steps in all."""
        return sum(steps for _, steps in self.stops)

    def check(self, times: Sequence[float], system: Schrodinger) -> None:
        """Refuse another equation, or other times, than it was made for."""
        if (self.t0, *(t for t, _ in self.stops)) != tuple(times):
            raise ValueError(hinted("the plan was made for other times", AGAIN))
        if self.bounds != system.bounds:
            raise ValueError(hinted("the plan was made for another spectrum", AGAIN))
        if system.is_driven:
            raise ValueError("the plan was made for an H without time")
        is_complex = self.core[0] == "chebyshev" and self.core[-1]
        if is_complex == system.is_real:
            kind = "complex" if is_complex else "real"
            raise ValueError(hinted(f"the plan was made for a {kind} H", AGAIN))

    def __repr__(self) -> str:
        """Name the method, steps and products."""
        return f"<Propagation by {self.method}: {self.steps} steps, {self.products:g} products>"

    def __str__(self) -> str:
        """Explain the plan."""
        low, high = self.bounds
        to = self.stops[-1][0]
        kept = f", {len(self.stops)} states kept" if len(self.stops) > 1 else ""
        bound = "not known beforehand" if self.bound is None else f"{self.bound:.1e}"
        lines = [
            self.method,
            f"  t = {self.t0:g} to {to:g} in {self.steps} steps{kept}; "
            f"{self.products:g} products H psi",
            f"  spectrum within [{low:.6g}, {high:.6g}], theta = {self.theta:.4g} a step",
            f"  error at most {bound}",
            "why",
            *(f"  {reason}" for reason in self.reasons),
        ]
        return "\n".join(lines)
