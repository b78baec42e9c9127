"""Monitors: functions for the size of steps, with their rate along the motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.mechanics.form import total_derivative
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Symbols


def traced(s: Symbols, velocity: ca.SX, function: Callable[..., Any]) -> tuple[_core.Tape, bool]:
    r"""Record (t, y, z, z') :math:`\mapsto` s, ds/dt, and return whether z' is in it.

    .. math:: ds/dt = s_t + s_y v + s_z z'
    """
    expression = _trace.scalar("monitor", function, s.args)
    u = ca.SX.sym("u", s.z.numel())
    rate = total_derivative(expression, s, velocity) + ca.jtimes(expression, s.z, u)
    return record("monitor", s.inputs(z=s.z, u=u), expression, rate), ca.depends_on(rate, u)
