"""Compositions: steps of fractions of h that raise the order of a method."""

from __future__ import annotations

from dataclasses import dataclass, field

from liouville import _core
from liouville._basics.errors import hinted, meant
from liouville._methods.brief import Brief
from liouville._methods.lobatto import LobattoPair
from liouville._methods.spark import Spark

#: The schemes of :func:`liouville._core.compositions`, by name.
SCHEMES = _core.compositions()

#: Schemes of a symmetric method alone; the others want a method and its adjoint.
SYMMETRIC = tuple(name for name, scheme in SCHEMES.items() if scheme["kind"] == "symmetric")


def scheme_name(value: object, names: tuple[str, ...]) -> str:
    """Return the name of a scheme; ValueError has the nearest one."""
    if not isinstance(value, str):
        raise TypeError(f"a composition must be the name of a scheme, not {value!r}")
    if value not in names:
        near, known = meant(value, names), f"There are {', '.join(names)}"
        hint = f"{near} {known}" if near.endswith("?") else near
        sentence = f"no composition is called {value!r}, or not for such a method"
        raise ValueError(hinted(sentence, hint))
    return value


@dataclass(frozen=True, repr=False)
class Composition(Brief):
    r"""A symmetric method, composed to a higher order.

    .. math::

        \Psi_h = \Phi_{\gamma_s h} \circ \dots \circ \Phi_{\gamma_2 h} \circ \Phi_{\gamma_1 h},
        \qquad \sum_i \gamma_i = 1, \quad \gamma_{s + 1 - i} = \gamma_i

    keeps whatever the method keeps: symmetry, constraints, the symplectic form. Its order is the
    larger of the scheme's and the method's, for the schemes are made for methods of order 2.

    Parameters
    ----------
    base : Spark or LobattoPair
        The method :math:`\Phi_h`, symmetric and of order 2: ``Spark(1)`` or ``LobattoPair(2)``.
    scheme : str, default "SS6s11"
        Name of the :math:`\gamma_i`: order 4 ``Y4``, ``SU4``; order 6 ``Y6``, ``KL6``, ``SS6s11``,
        ``SS6s13``; order 8 ``Y8D``, ``SU8``, ``KL8``, ``SS8s21``; order 10 ``SS10s35``.

    Raises
    ------
    TypeError, ValueError
        The method is not symmetric, or there is no such scheme for it.

    See Also
    --------
    VolumeSplitting : has its composition as a parameter.

    References
    ----------
    :cite:t:`hairer2006`, section V.3; see :doc:`/theory/composition`.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.Composition(lv.Spark(1), "SS6s11").order
    6
    """

    base: Spark | LobattoPair
    scheme: str = field(default="SS6s11", metadata={"help": f"one of {', '.join(SYMMETRIC)}"})

    def __post_init__(self) -> None:
        """Refuse what is no composition."""
        if not isinstance(self.base, Spark | LobattoPair):
            raise TypeError(
                "only a symmetric method can be composed, such as Spark(1) or LobattoPair(2), not "
                f"{self.base!r}\nhint: VolumeSplitting takes composition= itself"
            )
        if not self.base.is_symmetric:
            raise ValueError(
                f"only a symmetric method is composed, and {self.base!r} is not: a step back does "
                "not undo a step\nhint: Spark(1) and LobattoPair(2) are symmetric, and symplectic"
            )
        scheme_name(self.scheme, SYMMETRIC)

    @property
    def form(self) -> str:
        """The form of the systems it steps, that of its base."""
        return self.base.form

    @property
    def order(self) -> int:
        """Order of the method."""
        return max(int(SCHEMES[self.scheme]["order"]), self.base.order)
