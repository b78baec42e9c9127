"""
How a four-bar vibrates
=======================

A four-bar linkage with a spring along its diagonal, drawn as bodies in space, whose loop holds more
than it needs. Where does it rest, how fast does it vibrate there, and how soon is it still?
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
    along = np.subtract(POINTS[second], POINTS[first])
    length, angle = np.hypot(*along), np.arctan2(along[1], along[0])
    middle = (*np.add(POINTS[first], POINTS[second]) / 2, 0)
    inertia = (1e-3, length**3 / 6, length**3 / 6)
    turn = (np.cos(angle / 2), 0, 0, np.sin(angle / 2))
    m.body(name, mass=2 * length, inertia=inertia, at=middle, rotation=turn)
for name, (a, b) in {
    "A": ("ground", "crank"),
    "B": ("crank", "coupler"),
    "C": ("coupler", "rocker"),
    "D": ("ground", "rocker"),
}.items():
    damping = 0.3 if name == "C" else 0.0
    m.revolute(name, a, b, at=(*POINTS[name], 0), axis=(0, 0, 1), damping=damping)
ends = ((*POINTS["B"], 0), (*POINTS["D"], 0))
m.spring("spring", "crank", "ground", at=ends, stiffness=200.0, rest=1.0)

system = m.system()
system

# %%
# The loop is closed in space, so three of the 23 constraints follow from the others.

rest = lv.analysis.equilibrium(system, **m.start())
rest

# %%
# Two linear equations are left of 21 coordinates, with one mode.

lv.analysis.linearize(system, **rest.start).state

# %%
# Its frequency, how soon it is still, and what it moves.

modes = lv.analysis.modes(system, **rest.start)
modes

# %%
# The shape of the mode is in the coordinates of the system; ``consistent`` moves what is
# drawn of it onto the constraints.

shape = modes.shapes[:, 0].real
drawn = {"as drawn": m.start()["q"], "at rest": rest.start["q"]}
drawn |= {
    f"swing {sign}": rest.start["q"] + k * shape for sign, k in (("+", 0.2), ("-", -0.2))
}

fig, ax = plt.subplots()
for (label, q), colour in zip(drawn.items(), ("0.8", "k", "C0", "C1"), strict=True):
    still = system.consistent(q=q, v=0 * q)
    pose = lv.integrate(system, lv.Spark(1), t=(0, 1e-9), steps=1, **still)
    for bar, (a, b) in BARS.items():
        reach = np.hypot(*np.subtract(POINTS[a], POINTS[b])) / 2
        ends = [pose.body(bar).point((x, 0, 0))[0, :2] for x in (-reach, reach)]
        ax.plot(
            *np.transpose(ends), color=colour, label=label if bar == "crank" else None
        )
ax.set(aspect="equal", xlabel="x / m", ylabel="y / m")
fig.legend(ncols=4, loc="outside upper left")
plt.show()

# %%
# Let go a tenth as far away, the linkage vibrates and comes to rest as the mode says.

start = system.consistent(q=rest.start["q"] + 0.02 * shape, v=rest.start["v"])
solution = lv.integrate(system, lv.Spark(3), t=(0, 3), h=0.01, **start)
angle, t = solution.joint("A").angle, solution.t
away = 0.02 * modes.body("crank")[1][2, 0].real
off, decay = angle - angle[0] + away, np.exp(modes.eigenvalues[0].real * t)

fig, ax = plt.subplots()
ax.plot(t, np.degrees(off), label="run")
ax.plot(t, np.degrees(away * decay), "k:", label="decay of the mode")
ax.set(xlabel="time / s", ylabel="angle of the crank / degrees")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
