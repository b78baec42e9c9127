"""A mechanical system as an explicit ordinary differential equation: its index reduced twice.

The multipliers come from the derivative of the hidden constraint, (g_q M^-1 g_q^T) lam = ..., by
symbols: q' = v, v' = a(t, q, v). Nothing but the accuracy of a run then keeps the constraints. The
top has Euler's equations too, as anyone would write them: its quaternion, its angular velocity in
the body, no multiplier. `translate` brings the rate to whatever computes with operators.
"""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from liouville.problems import heavy_top

from .implicit import equations

UNARY = {
    ca.OP_ASSIGN: lambda x, _: x,
    ca.OP_NEG: lambda x, _: -x,
    ca.OP_SQ: lambda x, _: x * x,
    ca.OP_TWICE: lambda x, _: x + x,
    ca.OP_INV: lambda x, _: 1.0 / x,
    ca.OP_SIN: lambda x, space: space.sin(x),
    ca.OP_COS: lambda x, space: space.cos(x),
    ca.OP_SQRT: lambda x, space: space.sqrt(x),
}
BINARY = {
    ca.OP_ADD: lambda x, y, _: x + y,
    ca.OP_SUB: lambda x, y, _: x - y,
    ca.OP_MUL: lambda x, y, _: x * y,
    ca.OP_DIV: lambda x, y, _: x / y,
    ca.OP_HYPOT: lambda x, y, space: space.sqrt(x * x + y * y),
}


@dataclass(frozen=True)
class Reduced:
    """x' = rate(t, x, params) with its start; `ends` returns q, v and what should be zero."""

    time: ca.SX
    state: ca.SX
    rate: ca.SX
    start: np.ndarray
    ends: ca.Function | None
    params: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    def split(self, t, x):
        """Return coordinates, velocities and the largest residual of the constraints."""
        q, v, g = (np.array(part)[:, 0] for part in self.ends(t, x))
        return q, v, float(np.abs(g).max())


def reduced(system, start, params=None):
    """Return a system's equations without multipliers, with numbers or symbols for parameters."""
    q0, v0 = (np.array(start[key], dtype=float) for key in "qv")
    t, q, v, lam, mass, force, reaction, g, hidden = equations(system, params)
    by_lam, by_v = ca.jacobian(reaction, lam), ca.jacobian(hidden, v)
    free, answers = solved(mass, force), solved(mass, by_lam)
    rest = ca.jtimes(hidden, ca.vertcat(t, q), ca.vertcat(1, v)) + ca.mtimes(by_v, free)
    multipliers = solved(-ca.mtimes(by_v, answers), rest)
    state = ca.vertcat(q, v)
    rate = ca.vertcat(v, free + ca.mtimes(answers, multipliers))
    start = np.concatenate([q0, v0])
    if params is not None:
        return Reduced(t, state, rate, start, None, params)
    return Reduced(t, state, rate, start, ca.Function("ends", [t, state], [q, v, g]))


def solved(matrix, right):
    """Solve with a symmetric matrix of symbols."""
    return ca.ldl_solve(right, *ca.ldl(matrix))


def euler(system, start):
    """Return the top's equations in its quaternion and its angular velocity in the body."""
    q0, v0 = (np.array(start[key], dtype=float) for key in "qv")
    p = {key: ca.DM(value) for key, value in system.params.items()}
    t, q, omega, arm = ca.SX.sym("t"), ca.SX.sym("q", 4), ca.SX.sym("omega", 3), p["X"]
    turned = ca.vertcat(q[0], -q[1:])
    inertia = ca.diag(p["J"]) + p["m"] * (ca.dot(arm, arm) * ca.DM.eye(3) - arm @ arm.T)
    weight = heavy_top.rotate(turned, ca.DM([0, 0, -1])) * p["m"] * p["g"]
    torque = ca.cross(arm, weight) - ca.cross(omega, inertia @ omega)
    spun = ca.vertcat(-ca.dot(q[1:], omega), q[0] * omega + ca.cross(q[1:], omega)) / 2
    state, rate = ca.vertcat(q, omega), ca.vertcat(spun, ca.inv(inertia) @ torque)
    ends = ca.Function("ends", [t, state], [q, spun, (ca.dot(q, q) - 1) / 2])
    start = np.concatenate([q0, np.array(heavy_top.angular_velocity(ca.DM(q0), ca.DM(v0)))[:, 0]])
    return Reduced(t, state, rate, start, ends)


def translate(equation, time, state, space, params=()):
    """Return the rates as a list, of other symbols or numbers, with the functions of a space."""
    own = [equation.time, equation.state, equation.params]
    function = ca.Function("rate", own, [equation.rate]).expand()
    inputs, work = ([time], state, params), [None] * function.sz_w()
    found = [0.0] * equation.rate.numel()
    places = function.sparsity_out(0).row()
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_CONST:
            work[target[0]] = function.instruction_constant(k)
        elif code == ca.OP_INPUT:
            work[target[0]] = inputs[source[0]][source[1]]
        elif code == ca.OP_OUTPUT:
            found[places[target[1]]] = work[source[0]]
        elif code in UNARY:
            work[target[0]] = UNARY[code](work[source[0]], space)
        else:
            work[target[0]] = BINARY[code](*(work[j] for j in source), space)
    return found
