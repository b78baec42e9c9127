"""
A crane over an obstacle
========================

A crane takes a load of 1 t over an obstacle and hoists it by a metre on the way, in four seconds,
with the least effort of its trolley and its winch. The load may sway by half a metre, and has to
clear the obstacle.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# Tonnes, metres and kilonewtons. The length of the rope is a coordinate, on which the winch pulls;
# its drum has the inertia of 200 kg at the rope.

TROLLEY, LOAD, DRUM, g = 2.0, 1.0, 0.2, 9.81

system = lv.Lagrangian(
    lambda t, q, v, params: (
        (TROLLEY * v[0] ** 2 + LOAD * (v[1] ** 2 + v[2] ** 2) + DRUM * v[3] ** 2) / 2
        - LOAD * g * q[2]
    ),
    lambda t, q, params: {"rope": (q[1] - q[0]) ** 2 + q[2] ** 2 - q[3] ** 2},
    q=("trolley", "x", "y", "rope"),
    force=lambda t, q, v, params: [params.drive, 0, 0, params.winch],
    params={"drive": 0.0, "winch": -LOAD * g},
)

# %%
# What holds along the path: the load sways by half a metre at most, and stays outside of an ellipse
# around the obstacle.

CENTRE, HALF = np.array([2.0, -3.2]), np.array([0.9, 1.2])
path = {
    "sway": (lambda t, q, v, params: q[1] - q[0], -0.5, 0.5),
    "clear": (
        lambda t, q, v, params: (
            ((q[1] - CENTRE[0]) / HALF[0]) ** 2 + ((q[2] - CENTRE[1]) / HALF[1]) ** 2
        ),
        1.0,
        None,
    ),
}


def effort(t, q, v, params):
    """Squares of what the trolley drives, and of what the winch pulls beyond the weight."""
    return params.drive**2 + (params.winch + LOAD * g) ** 2


call = {
    "controls": ("drive", "winch"),
    "cost": effort,
    "t": (0.0, 4.0),
    "steps": 40,
    "q": [0.0, 0.0, -3.0, 3.0],
    "v": np.zeros(4),
    "final": {"q": [4.0, 4.0, -2.0, 2.0], "v": np.zeros(4)},
}
free = lv.optimal_control(system, lv.Spark(2), **call)
found = lv.optimal_control(system, lv.Spark(2), path=path, guess=free, **call)
found

# %%
# The ways of the load, with and without what the path asks for.

fig, (way, forces) = plt.subplots(1, 2, width_ratios=(3, 2))
angle = np.linspace(0, 2 * np.pi, 200)
way.fill(
    *(CENTRE[:, None] + HALF[:, None] * [np.cos(angle), np.sin(angle)]), color="0.85"
)
for run, label in ((free, "without limits"), (found, "within limits")):
    way.plot(run.q[:, 1], run.q[:, 2], label=label)
for k in range(0, 41, 5):
    way.plot([found.q[k, 0], found.q[k, 1]], [0, found.q[k, 2]], color="0.6", lw=0.8)
way.set(xlabel="x / m", ylabel="y / m", ylim=(-3.4, 0.2), aspect="equal")
fig.legend(ncols=2, loc="outside upper left")
for name in ("drive", "winch"):
    forces.plot(found.t, found.controls[name], label=name)
forces.set(xlabel="time / s", ylabel="force / kN")
forces.legend(ncols=2, loc="upper right")
plt.show()
