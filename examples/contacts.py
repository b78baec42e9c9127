"""
Contacts that give way
======================

Three problems of textbooks: a ladder slides down a wall and leaves it, the foot of a falling rod
slips, and so does a block on a table that shakes. Where and when is known in closed form, and found
to roundoff: in each mode of its contacts a body obeys smooth equations, and nothing is regularised.
"""

# %%
# A uniform ladder of length and mass 1 leans on a wall, both smooth. A contact is a gap: the places
# of its ends, by its centre and its angle to the wall.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

G = 9.81


def uniform(t, q, v, params):
    return (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 / 12) / 2 - G * q[1]


floor = lv.Contact(lambda t, q, params: q[1] - ca.cos(q[2]) / 2)
wall = lv.Contact(lambda t, q, params: q[0] - ca.sin(q[2]) / 2)
names = ("x", "y", "angle")
ladder = lv.Lagrangian(uniform, q=names, contacts={"floor": floor, "wall": wall})
ladder

# %%
# It slides from rest until it lies. At its last touch of the wall the height of its centre is two
# thirds of the first one, wherever it starts.

lies = {"lies": lv.Event(lambda t, q, v, lam, params: q[2] - np.pi / 2, terminal=True)}
start = {"q": [np.sin(0.3) / 2, np.cos(0.3) / 2, 0.3], "v": [0.0, 0.0, 0.0]}
slide = lv.integrate(ladder, lv.Spark(3), t=(0, 3), h=0.01, events=lies, **start)
(left,) = [
    change.t for change in slide.contacts["wall"].changes if change.kind == "leave"
]
print(slide(left).q[1] / slide.q[0, 1])

# %%
# It is drawn at equal angles, dark to light, and in red where it leaves the wall.


def draw(ax, q, **how):
    reach = np.array([np.sin(q[2]), -np.cos(q[2])]) / 2
    ax.plot(*np.transpose([q[:2] - reach, q[:2] + reach]), **how)


fig, ax = plt.subplots()
for angle in np.linspace(0.3, np.pi / 2, 14):
    t = np.interp(angle, slide.q[:, 2], slide.t)
    draw(ax, slide(t).q, color=plt.cm.viridis(t / slide.t[-1]))
draw(ax, slide(left).q, color="tab:red", lw=2.5)
ax.plot(*slide.q[:, :2].T, "k:", label="its centre")
ax.axhline(
    slide.q[0, 1] * 2 / 3, color="tab:red", lw=0.8, label="two thirds of its height"
)
ax.plot([0, 0, 1.3], [1.05, 0, 0], "k")
ax.set(aspect="equal", xlabel="x / m", ylabel="y / m")
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# A rod stands on a rough floor and topples from 0.1 rad. Friction is a parameter: an ensemble has a
# member for each coefficient.

foot = lv.Contact(
    lambda t, q, params: q[1] - ca.cos(q[2]) / 2,
    friction=lambda params: params.mu,
    slip=lambda t, q, v, params: v[0] - ca.cos(q[2]) / 2 * v[2],
)
rod = lv.Lagrangian(uniform, q=names, contacts={"foot": foot}, params={"mu": 0.3})
start = {"q": [np.sin(0.1) / 2, np.cos(0.1) / 2, 0.1], "v": [0.0, 0.0, 0.0]}
mu = np.array([0.2, 0.3, 0.45, 0.8])
falls = lv.ensemble(
    rod, lv.Spark(3), t=(0, 3), h=0.005, params={"mu": mu}, events=lies, **start
)
falls

# %%
# While the foot holds, the ratio of friction and normal force depends on the angle alone. With
# little friction the foot slips back and later forwards, with more it slips forwards only.


def ratio(angle, first=0.1):
    c, s, fallen = np.cos(angle), np.sin(angle), np.cos(first) - np.cos(angle)
    return 0.75 * s * (c - 2 * fallen) / (1 - 0.75 * s**2 - 1.5 * c * fallen)


fig, ax = plt.subplots()
angle = np.linspace(0.1, 1.1, 300)
ax.plot(np.degrees(angle), ratio(angle), "k", lw=4, alpha=0.15, label="while it holds")
for k in range(len(mu)):
    run = falls.member(k)
    contact = run.contacts["foot"]
    pressed = contact.normal > 1e-9
    load = contact.friction[pressed] / contact.normal[pressed]
    ax.plot(np.degrees(run.q[pressed, 2]), load, label=f"$\\mu$ = {mu[k]}")
ax.set(xlabel="angle / degrees", ylabel="friction / normal force", ylim=(-1, 0.6))
fig.legend(ncols=5, loc="outside upper left")
plt.show()

# %%
# A block lies on a table that moves as :math:`a \sin \omega t`. It goes along until the table's
# acceleration :math:`a \omega^2 \sin \omega t` exceeds :math:`\mu g`, then slides.

A, OMEGA, MU = 0.02, 20.0, 0.5
table = lv.Contact(
    lambda t, q, params: q[1],
    friction=MU,
    slip=lambda t, q, v, params: v[0] - A * OMEGA * ca.cos(OMEGA * t),
)
block = lv.Lagrangian(
    lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
    q=("x", "y"),
    contacts={"table": table},
)
start = {"q": [0.0, 0.0], "v": [A * OMEGA, 0.0]}
shaken = lv.integrate(block, lv.Spark(2), t=(0, 1), h=0.005, **start)
(slip, *_) = [
    change.t for change in shaken.contacts["table"].changes if change.kind == "slip"
]
print(slip, np.arcsin(MU * G / (A * OMEGA**2)) / OMEGA)

# %%
# Its velocity has the slope :math:`\mp \mu g`, until that of the table comes by again.

fig, ax = plt.subplots()
t = np.linspace(0, 1, 600)
ax.plot(t, A * OMEGA * np.cos(OMEGA * t), color="0.7", lw=3, label="table")
ax.plot(shaken.t, shaken.v[:, 0], label="block")
ax.set(xlabel="time / s", ylabel="velocity / (m/s)")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
