"""Potentials that depend on the density of a wave function, and their energies."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.waves.time_functions import TimeFunction

#: The energy is an integral over a part u^6 of the density, at so many of Gauss' points: exact for
#: sums of powers of the density from 1/6 on to 7, in steps of 1/6.
POWER, POINTS = 6, 24

#: Derivatives of W may be unsymmetric by this part of the largest: by roundoff.
SYMMETRIC = 1e-9


class Nonlinearity:
    r"""A potential :math:`W(t, \rho)` of the density :math:`\rho = |\psi|^2`, and its energy.

    Each component has a potential of the densities of all.

    .. math::

        W_a = \frac{\partial E}{\partial \rho_a}, \qquad
        E(t, \rho) = \int_0^1 \sum_a \rho_a W_a(t, s \rho)\, ds

    Parameters
    ----------
    function : callable
        W as ``function(t, rho, params)``, called once with CasADi symbols.
    params : Parameters
        The parameters it takes.
    components : int
        Their number.
    """

    def __init__(
        self, function: Callable[..., Any], params: _trace.Parameters, components: int
    ) -> None:
        self.potential = TimeFunction(
            "nonlinearity", function, params, components, "rho", components
        )
        self._params = params
        self._tapes: dict[float, tuple[_core.Tape, _core.Tape]] = {}

    @property
    def is_driven(self) -> bool:
        """Whether W depends on time."""
        return self.potential.is_driven

    def with_params(self, params: _trace.Parameters) -> Self:
        """Return the same function of the same parameters with other values."""
        other = copy(self)
        other.potential, other._params = self.potential.with_params(params), params
        return other

    def tapes(self, factor: float) -> tuple[_core.Tape, _core.Tape]:
        """Return the tapes of W and of E times a number: t, the density and parameters in."""
        if factor not in self._tapes:
            inputs = self.potential.inputs
            t, rho = inputs["t"], inputs["rho"]
            energy, nodes = ca.SX(0), np.polynomial.legendre.leggauss(POINTS)
            for x, weight in zip(*(part.tolist() for part in nodes), strict=True):
                u = 0.5 + 0.5 * x
                value = self.potential(t, u**POWER * rho, self._params.namespace)
                energy += 0.5 * weight * POWER * u ** (POWER - 1) * ca.dot(rho, value)
            tape = record("the energy of the nonlinearity", inputs, factor * energy)
            self._tapes[factor] = self.potential.tape(factor), tape
        return self._tapes[factor]

    def at(self, t: float, rho: np.ndarray) -> np.ndarray:
        """Return W at a time, of densities as rows; ValueError if one is not finite."""
        return self.potential.at(t, rho)

    def energy(self, t: float, rho: np.ndarray) -> np.ndarray:
        """Return E at a time, of densities as rows."""
        return self._mapped(self.tapes(1.0)[1], t, rho)

    def slope(self, t: float, rho: np.ndarray) -> np.ndarray:
        r"""Return :math:`\partial W_a / \partial \rho_b` at a time, a matrix for each row.

        Raises
        ------
        ValueError
            It is not symmetric, so that there is no energy; the message has the components.
        """
        found = self._mapped(self._slope, t, rho).reshape(len(rho), rho.shape[1], -1)
        off = np.abs(found - np.swapaxes(found, 1, 2))
        at = np.unravel_index(int(np.nanargmax(off)) if off.size else 0, off.shape)
        if off[at] > SYMMETRIC * np.nanmax(np.abs(found)):
            k, a, b = (int(place) for place in at)
            sentence = (
                "nonlinearity must be the derivative of one energy by the densities, but "
                f"dW[{a}] / d rho[{b}] is {found[k, a, b]:g}, and with both exchanged it is "
                f"{found[k, b, a]:g}"
            )
            raise ValueError(hinted(sentence, "g[a, b] and g[b, a] are the same number"))
        return found

    @cached_property
    def _slope(self) -> _core.Tape:
        inputs = self.potential.inputs
        found = ca.jacobian(self.potential.expression, inputs["rho"])
        return record("the slope of the nonlinearity", inputs, ca.vec(found.T))

    def _mapped(self, tape: _core.Tape, t: float, rho: np.ndarray) -> np.ndarray:
        args = [np.full((len(rho), 1), float(t)), np.ascontiguousarray(rho)]
        found: np.ndarray = tape.map(self._params.values(None), args)
        return found
