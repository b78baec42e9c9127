r"""
A slider-crank whose rod bends
==============================

A crank turns at constant speed and drives a slider through a slender rod. The rod's deflection is a
sum of two modes on its chord, :math:`w(x) = \sum_k e_k \sin(k \pi x / l)`, so with the velocity
:math:`(u_x, u_y)` of the crank pin seen from the rod, whose angle is b,

.. math::

    T = \frac{\rho A}2 \int_0^l (u_x - \dot b w)^2 + (u_y + \dot b x + \dot w)^2 \, dx, \qquad
    U = \frac{EI}2 \int_0^l w''^2 \, dx = \frac{EI\, l}4 \sum_k \Big(\frac{k\pi}l\Big)^4 e_k^2 .

A nearly rigid rod is a stiff system, with modes far faster than a step. HHT takes the same steps
for both rods.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)


def crank_pin(t, params):
    angle = params.speed * t
    return params.r * ca.vertcat(ca.cos(angle), ca.sin(angle))


def lagrangian(t, q, v, params):
    b, e, de, l, w = q[0], q[2:], v[2:], params.l, params.speed  # noqa: E741
    ahead = w * t - b  # the crank's angle seen from the rod
    ux, uy = -params.r * w * ca.sin(ahead), params.r * w * ca.cos(ahead)
    area, moment = 2 * l / ca.pi, l**2 / ca.pi * ca.vertcat(1, -1 / 2)  # of the modes
    along = l * ux**2 - 2 * ux * v[0] * area * e[0] + v[0] ** 2 * l / 2 * ca.dot(e, e)
    across = l * uy**2 + v[0] ** 2 * l**3 / 3 + l / 2 * ca.dot(de, de) + uy * v[0] * l**2
    across += 2 * uy * area * de[0] + 2 * v[0] * ca.dot(moment, de)
    bending = params.EI * l / 4 * (ca.pi / l) ** 4 * (e[0] ** 2 + 16 * e[1] ** 2)
    return params.rhoA / 2 * (along + across) + params.slider / 2 * v[1] ** 2 - bending


def constraint(t, q, params):
    end = crank_pin(t, params) + params.l * ca.vertcat(ca.cos(q[0]), ca.sin(q[0]))
    return {"pin": end[0] - q[1], "guide": end[1]}


params = {
    "r": 0.15,
    "l": 0.3,
    "speed": 150.0,
    "rhoA": 0.39,
    "EI": 42.0,
    "slider": 0.1,
}  # SI
system = lv.Lagrangian(
    lagrangian, constraint, q=("rod", "slider", "e1", "e2"), params=params
)
system

# %%
# Two turns of the crank, with two rods.

start = system.consistent(q=[0.0, 0.45, 0.0, 0.0], v=[-75.0, 0.0, 0.0, 0.0])
turns = 2 * 2 * np.pi / params["speed"]

runs = {
    name: lv.integrate(
        system,
        lv.HHT(alpha=-0.3),
        t=(0.0, turns),
        h=1e-4,
        params={"EI": stiffness},
        **start,
    )
    for name, stiffness in {"slender": params["EI"], "rigid": 1e6 * params["EI"]}.items()
}

# %%
# The slender rod bends in its first mode.

bent = runs["slender"]

fig, ax = plt.subplots()
for mode in (0, 1):
    ax.plot(1e3 * bent.t, 1e3 * bent.q[:, 2 + mode], label=f"mode {mode + 1}")
ax.set(xlabel="time / ms", ylabel="amplitude / mm")
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# The force on the guide of both.

fig, ax = plt.subplots()
for name, run in runs.items():
    ax.plot(1e3 * run.t, run.lam[:, 1], label=f"{name} rod")
ax.set(xlabel="time / ms", ylabel="force on the guide / N")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
