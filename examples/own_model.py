"""
A model of your own
===================

A bead slides on a wire bent to a parabola, while the wire is shaken up and down. The script defines
the whole model: the Lagrangian, a constraint that depends on time, and a quantity to observe.
"""

import casadi as ca
import matplotlib.pyplot as plt

import liouville as lv


def lagrangian(t, q, v, params):
    return params.m * (ca.dot(v, v) / 2 - params.g * q[1])


def constraint(t, q, params):
    shaken = params.a * ca.sin(params.w * t)
    return {"wire": q[1] - shaken - q[0] ** 2 / (2 * params.R)}


def friction(t, q, v, params):
    return -params.c * v


def tilt(t, q, v, params):
    return ca.atan(q[0] / params.R)


system = lv.Lagrangian(
    lagrangian,
    constraint,
    q=("x", "y"),
    force=friction,
    params={"m": 0.1, "g": 9.81, "R": 0.5, "a": 0.03, "w": 8.0, "c": 0.002},
)

# %%
# Shaking at twice the bead's own frequency amplifies its oscillation; shaking at another frequency
# hardly affects it. Parameters are changed in the call, without building the model again. The start
# depends on them: at rest in x, the bead has to move with the wire.

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for w in (6.0, 8.8):
    start = system.consistent(params={"w": w}, q=[0.1, 0.0], v=[0.0, 0.0])
    solution = lv.integrate(
        system,
        lv.Spark(stages=3),
        t=(0.0, 20.0),
        h=0.02,
        params={"w": w},
        observe={"tilt": tilt},
        **start,
    )
    ax.plot(solution.t, solution.observed["tilt"], label=f"w = {w:g} rad/s")
ax.set(xlabel="time / s", ylabel="tilt of the wire under the bead / rad")
ax.legend()
plt.show()
