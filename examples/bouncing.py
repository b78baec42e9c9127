"""
Bouncing in a bowl
==================

A ball falls into a bowl and bounces without loss. Each bounce is an event with a reset, found to
roundoff: the run goes on with the velocity after the impact. In a parabolic bowl paths are regular
and avoid a region; in a bowl of degree 4 they fill it, and two starts a billionth apart diverge.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

BOUNCES = 60


def depth(t, q, v, lam, params):
    return q[1] - ca.fabs(q[0]) ** params.n / params.n


ball = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - q[1], q=("x", "y"), params={"n": 2.0}
)
wall = lv.Event(depth, direction="down", reset=lv.Impact(), terminal=BOUNCES)
ball

# %%
# For each bowl there are two paths whose starts are a billionth apart, members of one ensemble.
# Each ends with its last bounce.

runs = lv.ensemble(
    ball, lv.Spark(stages=2), t=(0, 200), h=0.1, events={"wall": wall},
    params={"n": [2.0, 2.0, 4.0, 4.0]}, q=[[0.6, 1.5], [0.6 + 1e-9, 1.5]] * 2, v=[0.0, 0.0],
)  # fmt: skip
print(
    f"largest relative error of the energy: {np.nanmax(runs.invariant_drift('energy')):.1e}"
)
runs.member(0).message

# %%
# The first path in each bowl, drawn with dense output: between bounces it is interpolated on each
# side by itself.

fig, axes = plt.subplots(1, 2, figsize=(6.4, 3.4), sharey=True)
x = np.linspace(-2, 2, 200)
for ax, k in zip(axes, (0, 2), strict=True):
    run = runs.member(k)
    times = np.linspace(run.t[0], run.t[-1], 2000)
    n = run.params["n"]
    ax.plot(x, np.abs(x) ** n / n, "k")
    ax.plot(*run(times).q.T, lw=0.6)
    ax.set(title=f"bowl of degree {n:g}", ylim=(-0.1, 2), xlabel="x")
axes[0].set_ylabel("y")
plt.show()

# %%
# The distance of the two paths grows linearly in one bowl and exponentially in the other.

fig, ax = plt.subplots()
for k in (0, 2):
    places = [runs.member(member).events["wall"].q for member in (k, k + 1)]
    label = f"degree {runs.member(k).params['n']:g}"
    ax.semilogy(np.linalg.norm(places[0] - places[1], axis=1), label=label)
ax.set(xlabel="bounce", ylabel="distance of two paths")
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# With loss there are infinitely many bounces in a finite time. The run ends where they can no
# longer be told apart, and its message says when they would end.

lossy = lv.integrate(
    ball, lv.Spark(stages=2), t=(0, 200), h=0.1, q=[0.6, 1.5], v=[0.0, 0.0],
    events={"wall": lv.Event(depth, direction="down", reset=lv.Impact(0.8))},
)  # fmt: skip
lossy.message

# %%
# The energy falls at each bounce and is constant in between.

hits = lossy.events["wall"]
fig, ax = plt.subplots()
ax.plot(lossy.t, lossy.invariants["energy"], label="energy")
ax.plot(hits.t, hits.q[:, 1], ".", label="height of a bounce")
ax.set(xlabel="t")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
