"""
A model of your own
===================

A bead slides on a wire bent to a parabola, while the wire is shaken up and down. The script defines
the whole model: the Lagrangian, a constraint that depends on time, and a quantity to observe.
"""

import casadi as ca
import matplotlib.pyplot as plt

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)


def lagrangian(t, q, v, params):
    return params.m * (ca.dot(v, v) / 2 - params.g * q[1])


def constraint(t, q, params):
    shaken = params.a * ca.sin(params.w * t)
    return {"wire": q[1] - shaken - q[0] ** 2 / (2 * params.R)}


def friction(t, q, v, params):
    return -params.c * v


def tilt(t, q, v, params):
    return ca.atan(q[0] / params.R)


# %%
# The functions are called once, with CasADi's symbols, and give a system in SI units.

system = lv.Lagrangian(
    lagrangian,
    constraint,
    q=("x", "y"),
    force=friction,
    params={"m": 0.1, "g": 9.81, "R": 0.5, "a": 0.03, "w": 8.0, "c": 0.002},
)
system

# %%
# Parameters are changed in the call, without building the model again. The start depends on them:
# it is moved to the nearest point and velocity on the wire, which turns.

runs = {}
for w in (6.0, 8.8):
    start = system.consistent(params={"w": w}, q=[0.1, 0.0], v=[0.0, 0.0])
    runs[w] = lv.integrate(
        system,
        lv.Spark(stages=3),
        t=(0.0, 20.0),
        h=0.02,
        params={"w": w},
        observe={"tilt": tilt},
        **start,
    )
runs[8.8]

# %%
# Shaking at twice the bead's own frequency amplifies its oscillation; shaking at another frequency
# hardly affects it.

fig, ax = plt.subplots()
for w, solution in runs.items():
    ax.plot(solution.t, solution.observed["tilt"], label=f"w = {w:g} rad/s")
ax.set(xlabel="time / s", ylabel="tilt of the wire under the bead / rad")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
