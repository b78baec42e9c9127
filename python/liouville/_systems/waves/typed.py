"""Types of Schrödinger equations for checkers: with and without a potential of the density."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from typing_extensions import TypeVar

    #: Nothing for a linear equation, a nonlinearity for another one.
    Density = TypeVar("Density", default=Any)
else:
    from typing import TypeVar

    Density = TypeVar("Density")


class Options(TypedDict, total=False):
    """Arguments of an equation but for its nonlinearity."""

    bounds: tuple[float, float] | str
    hbar: float
    drive: Sequence[tuple[Callable[..., Any] | ArrayLike, Any]]
    times: ArrayLike | None
    order: int
    points: ArrayLike
    params: Mapping[str, ArrayLike] | None
    components: int
    coupling: ArrayLike | None
    absorber: Callable[..., Any] | ArrayLike | None
