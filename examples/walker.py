"""
A walker without a motor
========================

Two straight legs with a mass at the hip and light feet walk down a slope, driven by gravity alone:
the simplest walker of Garcia, Chatterjee, Ruina and Coleman (1998). A foot that lands loses its
velocity and sticks, and the other one leaves. Each foot has a floor of its own, with hollows where
it swings past the other: legs without knees would scuff a flat one.
"""

# %%
# The coordinates are the hip, with x down the slope, and the angles of both legs. Hip, legs and
# gravity have size one, and a foot has the mass `m`.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)


def foot(q, k):
    return q[:2] + ca.vertcat(ca.sin(q[2 + k]), -ca.cos(q[2 + k]))


def lagrangian(t, q, v, params):
    feet = [foot(q, k) for k in (0, 1)]
    up = ca.vertcat(-ca.sin(params.slope), ca.cos(params.slope))
    kinetic = [ca.sumsqr(ca.jtimes(place, q, v)) for place in feet]
    kinetic, place = (
        ca.sumsqr(v[:2]) + params.m * sum(kinetic),
        q[:2] + params.m * sum(feet),
    )
    return kinetic / 2 - ca.dot(up, place)


def floor(k):
    def gap(t, q, params):
        x, y = ca.vertsplit(foot(q, k))
        return (
            y + 0.1 * ca.fmax(0, (-1) ** (1 + k) * ca.cos(np.pi * x / params.step)) ** 3
        )

    def slip(t, q, v, params):
        return ca.jtimes(foot(q, k)[0], q, v)

    return lv.Contact(gap, friction=1.0, slip=slip)


system = lv.Lagrangian(
    lagrangian,
    q=("x", "y", "left", "right"),
    contacts={"left": floor(0), "right": floor(1)},
    params={"m": 1e-3, "slope": 0.009, "step": 0.4},
)
system

# %%
# It starts as the right foot has left the ground, near the cycle of the paper.

angle, rate = 0.2, -0.2
q = [-np.sin(angle), np.cos(angle), angle, -angle]
v = [-np.cos(angle) * rate, -np.sin(angle) * rate, rate, np.cos(2 * angle) * rate]
params = {"step": 2 * np.sin(angle)}
walk = lv.integrate(system, lv.Spark(4), t=(0, 120), h=0.02, q=q, v=v, params=params)
walk

# %%
# In three steps its legs stand as drawn: the hip goes from one circle to the next.

sides = enumerate(("left", "right"))
hits = sorted(
    (x.t, k) for k, side in sides for x in walk.contacts[side].changes if x.kind == "hit"
)
times, legs = (np.array(part) for part in zip(*hits, strict=True))
fig, ax = plt.subplots()
for t in np.linspace(0, times[2], 31):
    x, y, *angles = walk(t).q
    for angle, color in zip(angles, ("tab:blue", "tab:orange"), strict=True):
        ax.plot([x, x + np.sin(angle)], [y, y - np.cos(angle)], color=color, lw=0.8)
ax.set(xlabel="x, down the slope", ylabel="y", aspect="equal")
plt.show()

# %%
# The angle of the leg that lands becomes that of a cycle, which is 0.200161072170 for such feet by
# Bhounsule's program passivewalker (Cornell, 2009): perturbations die out by 0.59 a step.

angles = walk(times).q[np.arange(len(times)), 2 + legs]
print(f"angle {angles[-1]:.8f}, a step takes {np.diff(times)[-1]:.6f}")
fig, ax = plt.subplots()
ax.semilogy(abs(angles - 0.200161072169750), "o-", label="measured")
ax.semilogy(5e-3 * 0.59 ** np.arange(len(times)), "k:", label="0.59 a step")
ax.set(xlabel="step", ylabel="angle off that of the cycle")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
