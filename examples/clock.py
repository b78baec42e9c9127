"""
A clock with an anchor
======================

A weight turns a wheel, and a pendulum lets one tooth of it pass at a time. Every tick is a tooth
that hits a pallet of the anchor and pushes it, until it escapes past the pallet's end and the wheel
falls on to the other one. What the weight gives is lost in these hits and in the air: the motion
comes to a cycle of its own, however it begins.
"""

# %%
# The wheel has twelve teeth, and two straight pallets span two and a half of them. They lean by 45
# degrees against the way of the teeth.

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.analysis import power_balance
from liouville.bodies import Assembly, Capsule, Sphere

plt.style.use(plot.STYLE)

TEETH, RADIUS, THICK, G = 12, 0.04, 4e-4, 9.81
PITCH = 2 * np.pi / TEETH
SPAN, LENGTH = 1.25 * PITCH, 0.25  # half the angle between the pallets, of the pendulum

clock = Assembly(gravity=(0, -G, 0))
wheel = clock.planar_body("wheel", mass=0.05, inertia=2e-5, at=(0, 0))
clock.revolute(
    "axle",
    "ground",
    wheel,
    at=(0, 0),
    torque=lambda t, angle, rate, params: -params.torque,
)
pivot = np.array([0, RADIUS / np.cos(SPAN)])
bob = pivot - [0, LENGTH]
anchor = clock.planar_body("anchor", mass=0.2, inertia=1e-4, at=bob)
clock.revolute("pivot", "ground", anchor, at=pivot, damping=2e-3)

for pallet, angle in (("entry", np.pi / 2 + SPAN), ("exit", np.pi / 2 - SPAN)):
    out = np.array([np.cos(angle), np.sin(angle)])
    up = (out - [out[1], -out[0]]) / np.sqrt(2)  # along the pallet
    ends = [RADIUS * out - 0.0015 * up, RADIUS * out + 0.01 * up]
    for k in range(TEETH):
        place = np.pi / 2 + SPAN + (k + 0.3) * PITCH
        tooth = Sphere(wheel, at=RADIUS * np.array([np.cos(place), np.sin(place)]))
        clock.contact(f"{pallet} {k}", tooth, Capsule(anchor, ends, THICK))
system = clock.system(params={"torque": 2e-3})
clock

# %%
# It is let go with a small and with a large swing.

runs = {
    swing: lv.integrate(
        system, lv.Spark(3), t=(0, 30), h=0.01, **clock.start(values={"pivot": swing})
    )
    for swing in (0.06, 0.25)
}
plot.view(runs[0.06].sel(time=slice(0, 4)))

# %%
# Both come to one cycle.

fig, ax = plt.subplots()
for swing, run in runs.items():
    ax.plot(run.t, run.joint("pivot").angle, label=f"let go at {swing} rad")
ax.set(xlabel="time / s", ylabel="angle of the anchor / rad")
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# From one hit on the entry pallet to the next the wheel turns by a pitch. What the weight gives in
# this time, the torque times the pitch, is lost in the hits and, by damping, in the air.

run = runs[0.06]
hits = sorted(
    x.t
    for name, record in run.contacts.items()
    for x in record.changes
    if x.kind == "hit" and name.startswith("entry")
)
balance, at = power_balance(run), np.searchsorted(run.t, hits)
given = -2e-3 * run.joint("axle").angle
parts = {
    "given": given,
    "lost in hits": -balance.work["impacts"],
    "lost in the air": given - balance.work["forces"],
}
fig, ax = plt.subplots()
for name, work in parts.items():
    ax.plot(hits[1:], 1000 * np.diff(work[at]), ".-", label=name)
ax.axhline(1000 * 2e-3 * PITCH, color="k", ls=":", label="torque times pitch")
ax.set(xlabel="time / s", ylabel="work in a beat / mJ", ylim=0)
fig.legend(ncols=4, loc="outside upper left")
plt.show()
print(f"a beat takes {np.diff(hits)[-1]:.5f} s")
