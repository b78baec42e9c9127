"""
The forces in a four-bar
========================

Three bars and four hinges, drawn as bodies and joints. The motor of the crank is given by its
motion; its torque and the forces in the hinges come out with the motion, at full order.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

POINTS = {"A": (0.0, 0.0), "B": (0.0, 0.5), "C": (0.9, 0.9), "D": (1.1, 0.0)}  # m
BARS = {"crank": "AB", "coupler": "BC", "rocker": "DC"}

m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
for name, (first, second) in BARS.items():
    length = np.hypot(*np.subtract(POINTS[second], POINTS[first]))
    m.bar(name, POINTS[first], POINTS[second], mass=2 * length)

# %%
# The joints; the crank turns at 4 rad/s.

for name, (a, b) in {
    "A": ("ground", "crank"),
    "B": ("crank", "coupler"),
    "C": ("coupler", "rocker"),
    "D": ("ground", "rocker"),
}.items():
    motion = (lambda t, params: params.speed * t) if name == "A" else None
    m.revolute(name, a, b, at=POINTS[name], motion=motion)

system = m.system(params={"speed": 4.0})
system

# %%
# Two turns. A body knows where its points are.

solution = lv.integrate(system, lv.Spark(4), t=(0, np.pi), h=0.01, **m.start())

fig, ax = plt.subplots()
for name in BARS:
    body = solution.body(name)
    reach = np.hypot(*np.subtract(*(POINTS[point] for point in BARS[name]))) / 2
    ends = np.array([body.point((x, 0, 0)) for x in (-reach, reach)])
    for k in range(0, 157, 12):
        ax.plot(*ends[:, k, :2].T, color=plt.cm.viridis(k / 157))
ax.set(
    aspect="equal", xlabel="x / m", ylabel="y / m", title="the first turn, dark to light"
)
plt.show()

# %%
# A joint knows what it bears. The hinges bear most where the rotation of the rocker
# changes fastest.

fig, ax = plt.subplots()
for name in "BCD":
    force = solution.joint(name).force
    ax.plot(solution.t, np.hypot(force[:, 0], force[:, 1]), label=f"force in {name} / N")
ax.plot(
    solution.t, solution.joint("A").torque[:, 2], "k", label="torque of the motor / Nm"
)
ax.set(xlabel="time / s", ylabel="force / N, torque / Nm")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
