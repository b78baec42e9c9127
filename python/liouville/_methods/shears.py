"""Methods for the Schrödinger equation of a fixed number of shears a step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from liouville import _core
from liouville._basics.arguments import count
from liouville._basics.errors import hinted
from liouville._methods.brief import Brief


@dataclass(frozen=True, repr=False)
class StabilitySplitting(Brief):
    r"""Shears made for the longest stable steps, between a processor and its inverse.

    The cosine of a step of 2m shears is the polynomial in :math:`x^2` of degree m that agrees with
    :math:`\cos x` to :math:`x^{order}` and stays within :math:`\pm 1` up to the largest
    :math:`x^*` there is, :math:`x = h (\lambda - \sigma)`. A step K is conjugate to a rotation,
    :math:`K = P^{-1} R P`; the processor P takes 2d more products for each state that is kept. For
    coarse runs that stability limits: at a tolerance, :class:`SchrodingerSplitting` takes fewer
    products.

    Parameters
    ----------
    order : {2, 4, 6, 8}
        Order of the cosine, and with it of R.
    stages : int
        m, half the number of shears.
    processed : bool, default True
        Whether to begin with the inverse of a processor and look at states through it. Without, a
        state that is kept is off by as much as P is from 1. Orders 4 and 8 have processors of
        very high degree, or none, but for few stages.

    Raises
    ------
    TypeError, ValueError
        There is no such method; the message has those there are.

    References
    ----------
    :cite:t:`mclachlan1997`, :cite:t:`lopezmarcos1996`.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> chain = lv.Schrodinger(lv.Lattice(100))
    >>> psi = np.eye(100)[50]
    >>> method = lv.StabilitySplitting(order=6, stages=8)
    >>> run = lv.integrate(chain, method, t=(0, 10), steps=20, psi=psi)
    >>> f"{method.limit:.2f}", f"{abs(run.psi[-1, 50]):.6f}"
    ('12.46', '0.167025')
    """

    form: ClassVar[str] = "wave"
    order: int = field(default=2, metadata={"help": "order of its cosine, 2 to 8"})
    stages: int = field(default=8, metadata={"help": "half the number of shears of a step"})
    processed: bool = field(default=True, metadata={"help": "between a processor and its inverse"})

    def __post_init__(self) -> None:
        """Refuse what is not in the table."""
        shears_of("stability", self.order, self.stages)
        if not isinstance(self.processed, bool):
            raise TypeError(f"processed must be True or False, not {self.processed!r}")

    @property
    def limit(self) -> float:
        """The longest stable step in units of 1/beta, half the width of the spectrum."""
        return float(shears_of("stability", self.order, self.stages)["limit"])


@dataclass(frozen=True, repr=False)
class GrayManolopoulos(Brief):
    """Shears of an order in h, as many as the order takes.

    For steps of a size given by something else; at a tolerance, :class:`SchrodingerSplitting`
    takes fewer products.

    Parameters
    ----------
    order : int, default 6
        Order of a step, from 2 to 6, and half the number of its shears.

    Raises
    ------
    TypeError, ValueError
        There is no such method.

    References
    ----------
    :cite:t:`gray1996`.

    Examples
    --------
    >>> import liouville as lv
    >>> import numpy as np
    >>> chain = lv.Schrodinger(lv.Lattice(100))
    >>> psi = np.eye(100)[50]
    >>> run = lv.integrate(chain, lv.GrayManolopoulos(6), t=(0, 10), steps=20, psi=psi)
    >>> run.stats["products"]  # six for each step
    120.0
    """

    form: ClassVar[str] = "wave"
    order: int = field(default=6, metadata={"help": "order of a step, 2 to 6"})

    def __post_init__(self) -> None:
        """Refuse what is not in the table."""
        shears_of("gray-manolopoulos", self.order, self.order)


def shears_of(kind: str, order: Any, stages: Any) -> dict[str, Any]:
    """Return a method of the core's table; ValueError has those there are."""
    wanted = count("order", order), count("stages", stages)
    known = {(m["order"], m["stages"]): m for m in _core.stability() if m["kind"] == kind}
    if wanted not in known:
        sentence = f"there is no method of order {order} with {stages} stages"
        there = ", ".join(f"{a} with {b}" for a, b in known)
        raise ValueError(hinted(sentence, f"there are {there}"))
    return known[wanted]
