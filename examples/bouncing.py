"""
Bouncing in a bowl
==================

A ball falls into a bowl and bounces without loss. Each bounce is an event that ends the run, found
to roundoff; the next run starts with the reflected velocity. In a parabolic bowl paths are regular
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
wall = lv.Event(depth, direction="down", terminal=True)
ball

# %%
# At a bounce the velocity along the normal changes its sign.


def reflected(q, v, n):
    normal = np.array([-np.sign(q[0]) * abs(q[0]) ** (n - 1), 1.0])
    return v - 2 * (normal @ v) * normal / (normal @ normal)


def bounce(x, n):
    """Return the path and the places of the bounces, and print the error of the energy."""
    t, q, v, path, places = 0.0, np.array([x, 1.5]), np.zeros(2), [], []
    for _ in range(BOUNCES):
        run = lv.integrate(
            ball, lv.Spark(stages=2), t=(t, t + 20.0), h=0.1, events={"wall": wall},
            params={"n": n}, q=q, v=v,
        )  # fmt: skip
        path.append(run(np.linspace(run.t[0], run.t[-1], 30)).q)
        t, q, v = run.t[-1], run.q[-1], reflected(run.q[-1], run.v[-1], n)
        places.append(q)
    print(f"n = {n:g}: relative error of the energy {v @ v / 3 + q[1] / 1.5 - 1:.1e}")
    return np.concatenate(path), np.array(places)


# %%
# For each bowl two paths, the starts of which are a billionth apart.

runs = {n: (bounce(0.6, n), bounce(0.6 + 1e-9, n)) for n in (2.0, 4.0)}

# %%
# The first of each.

fig, axes = plt.subplots(1, 2, figsize=(6.4, 3.4), sharey=True)
x = np.linspace(-2, 2, 200)
for ax, (n, ((path, _), _)) in zip(axes, runs.items(), strict=True):
    ax.plot(x, np.abs(x) ** n / n, "k")
    ax.plot(*path.T, lw=0.6)
    ax.set(title=f"bowl of degree {n:g}", ylim=(-0.1, 2), xlabel="x")
axes[0].set_ylabel("y")
plt.show()

# %%
# The distance of the two, at each bounce.

fig, ax = plt.subplots()
for n, ((_, places), (_, others)) in runs.items():
    ax.semilogy(np.linalg.norm(places - others, axis=1), label=f"degree {n:g}")
ax.set(xlabel="bounce", ylabel="distance of two paths")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
