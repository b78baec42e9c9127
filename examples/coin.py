"""
A coin that is spun
===================

A coin is spun on a table, on which its edge slides at first. Dry friction brings the place where it
touches to rest, and from then on it rolls without loss, round and round: what later stops Euler's
disc is none of this.
"""

# %%
# The coordinates are the centre, the heading of the line in which the coin's plane meets the table,
# its tilt, and its turn about its own axis.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

A, G = 0.012, 9.81  # the radius, and gravity, in m; the mass is one


def axial(q, v):
    return v[5] + v[3] * ca.cos(q[4])


def lagrangian(t, q, v, params):
    across = v[4] ** 2 + (v[3] * ca.sin(q[4])) ** 2
    turning = A**2 / 4 * across + A**2 / 2 * axial(q, v) ** 2
    return (ca.sumsqr(v[:3]) + turning) / 2 - G * q[2]


def slip(t, q, v, params):
    along = ca.vertcat(ca.cos(q[3]), ca.sin(q[3]))
    beside = ca.vertcat(-ca.sin(q[3]), ca.cos(q[3]))
    return [
        ca.dot(along, v[:2]) + A * axial(q, v),
        ca.dot(beside, v[:2]) + A * ca.sin(q[4]) * v[4],
    ]


table = lv.Contact(lambda t, q, params: q[2] - A * ca.sin(q[4]), friction=0.2, slip=slip)
coin = lv.Lagrangian(
    lagrangian, q=("x", "y", "z", "heading", "tilt", "turn"), contacts={"table": table}
)
coin

# %%
# It stands at 75 degrees, and is spun and thrown forwards.

tilt = np.radians(75)
start = {
    "q": [0, 0, A * np.sin(tilt), 0, tilt, 0],
    "v": [0.1, 0, 0, 60, 0, 0],
}
run = lv.integrate(coin, lv.Spark(4), t=(0, 1.5), h=0.002, **start)
run

# %%
# Its energy falls as long as it slides.

(rests,) = (x.t for x in run.contacts["table"].changes if x.kind == "stick")
print(f"it rolls from {rests:.3f} s on")
fig, ax = plt.subplots()
ax.plot(run.t, run.invariants["energy"] / G / A)
ax.set(xlabel="time / s", ylabel="energy / weight times radius")
plt.show()

# %%
# The place on the table where it touches.

x, y, _, heading, lean, _ = run.q.T
x, y = x + A * np.cos(lean) * np.sin(heading), y - A * np.cos(lean) * np.cos(heading)
fig, ax = plt.subplots()
for which, label in ((run.t <= rests, "slides"), (run.t >= rests, "rolls")):
    ax.plot(1000 * x[which], 1000 * y[which], label=label)
ax.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
