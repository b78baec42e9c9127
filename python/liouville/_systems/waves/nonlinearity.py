"""Potentials that depend on the density of a wave function, and their energies."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.waves.time_functions import TimeFunction

#: The energy is an integral over a part u^6 of the density, at so many of Gauss' points: exact for
#: sums of powers of the density from 1/6 on to 7, in steps of 1/6.
POWER, POINTS = 6, 24


class Nonlinearity:
    r"""A potential :math:`W(t, \rho)` of the density :math:`\rho = |\psi|^2`, and its energy.

    .. math::

        E(t, \rho) = \int_0^\rho W(t, r)\, dr

    Parameters
    ----------
    function : callable
        W as ``function(t, rho, params)``, called once with CasADi symbols.
    params : Parameters
        The parameters it takes.
    """

    def __init__(self, function: Callable[..., Any], params: _trace.Parameters) -> None:
        self.potential = TimeFunction("nonlinearity", function, params, 1, "rho")
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
            energy, nodes = 0.0, np.polynomial.legendre.leggauss(POINTS)
            for x, weight in zip(*(part.tolist() for part in nodes), strict=True):
                u = 0.5 + 0.5 * x
                value = self.potential(t, u**POWER * rho, self._params.namespace)
                energy += 0.5 * weight * POWER * u ** (POWER - 1) * value
            tape = record("the energy of the nonlinearity", inputs, factor * rho * energy)
            self._tapes[factor] = self.potential.tape(factor), tape
        return self._tapes[factor]

    def at(self, t: float, rho: np.ndarray) -> np.ndarray:
        """Return W at a time, one value for each density; ValueError if one is not finite."""
        return self.potential.at(t, rho[:, None])

    def energy(self, t: float, rho: np.ndarray) -> np.ndarray:
        """Return E at a time, one value for each density."""
        return self._mapped(self.tapes(1.0)[1], t, rho)

    def slope(self, t: float, rho: np.ndarray) -> np.ndarray:
        r"""Return :math:`\partial W / \partial \rho` at a time, one value for each density."""
        return self._mapped(self._slope, t, rho)

    @cached_property
    def _slope(self) -> _core.Tape:
        inputs = self.potential.inputs
        found = ca.gradient(self.potential.expression, inputs["rho"])
        return record("the slope of the nonlinearity", inputs, found)

    def _mapped(self, tape: _core.Tape, t: float, rho: np.ndarray) -> np.ndarray:
        args = [np.full((rho.size, 1), float(t)), np.ascontiguousarray(rho)[:, None]]
        found: np.ndarray = tape.map(self._params.values(None), args)[:, 0]
        return found
