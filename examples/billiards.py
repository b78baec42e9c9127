"""
Hits that count to pi
=====================

A heavy block slides towards a light one that stands before a wall, and nothing is lost: how often
do they hit? With masses 1 to 100 the answer is 31, with 1 to 10,000 it is 314 (Galperin 2003). Then
ten discs in a box, whose hits share the energy out.
"""

# %%
# Both gaps are contacts that give back all; hits are found to roundoff, and not by steps.

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.bodies import Assembly, Plane, Sphere

plt.style.use(plot.STYLE)

blocks = lv.Lagrangian(
    lambda t, q, v, params: (v[0] ** 2 + params.heavy * v[1] ** 2) / 2,
    q=("light", "heavy"),
    contacts={
        "wall": lv.Contact(lambda t, q, params: q[0], restitution=1.0),
        "blocks": lv.Contact(lambda t, q, params: q[1] - q[0], restitution=1.0),
    },
    params={"heavy": 1.0},
)
runs = {}
for heavy in (1, 100, 10_000):
    call = {"t": (0, 10), "h": 0.05, "params": {"heavy": heavy}}
    runs[heavy] = lv.integrate(blocks, lv.Spark(2), q=[1, 2], v=[0, -1], **call)
    hits = sum(len(contact.changes) for contact in runs[heavy].contacts.values())
    print(f"1 to {heavy}: {hits} hits")

# %%
# Times the roots of the masses, velocities are points on the circle of the energy. A hit of the
# wall mirrors the point, and each hit of the blocks is a chord with the same slope, so that they
# take equal angles, twice the arctangent of 1/10, until none is left.

v = runs[100].v * np.sqrt([1, 100])
fig, ax = plt.subplots()
ax.plot(v[:, 1], v[:, 0], "o-", lw=0.8)
ax.set(
    aspect="equal",
    xlabel="10 times the velocity of the heavy block",
    ylabel="that of the light one",
)
plt.show()

# %%
# Ten discs in a box: one comes in, and the others rest.

box = Assembly()
discs = []
for k in range(10):
    at = (0.3 + 0.35 * (k % 4), 0.3 + 0.35 * (k // 4))
    body = box.planar_body(f"disc {k}", mass=1.0, inertia=0.005, at=at)
    box.free(f"flight {k}", body)
    discs.append(Sphere(body, 0.1))
walls = [Plane("ground", at=(0, 0), normal=n) for n in ((1, 0), (0, 1))]
walls += [Plane("ground", at=(1.6, 1.6), normal=n) for n in ((-1, 0), (0, -1))]
for i, disc in enumerate(discs):
    for j, other in enumerate((*walls, *discs[:i])):
        box.contact(f"{i} and {j}", disc, other, restitution=1.0)
start = box.start(rates={"flight 0": (3, 1, None, None, None, None)})
run = lv.integrate(box.system(), lv.Spark(2), t=(0, 100), h=0.05, **start)
plot.view(run.sel(time=slice(0, 5)))

# %%
# After many hits all directions of the velocities together are equally likely. A disc then has more
# than a share x of the energy with the probability :math:`(1 - x)^9`.

speeds = np.stack([run.body(f"disc {k}").velocity for k in range(10)])
share = np.sum(speeds**2, axis=-1) / np.sum(speeds**2, axis=(0, -1))
hits = sum(len(contact.changes) for contact in run.contacts.values())
x = np.linspace(0, 0.6, 61)
fig, ax = plt.subplots()
ax.semilogy(x, [np.mean(share > least) for least in x], "o", label=f"in {hits} hits")
ax.semilogy(x, (1 - x) ** 9, "k:", label="equally likely")
ax.set(xlabel="share of the energy", ylabel="part of the time above it")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
