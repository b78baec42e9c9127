"""
A heavy top for a long time
===========================

A disc on a rod spins about a fixed point at 150 rad/s and precesses under its weight. Its attitude
is a unit quaternion, whose length is the one constraint; energy, the angular momentum about the
vertical and the spin about the rod are constant, and stay so for a thousand revolutions.
"""

import matplotlib.pyplot as plt

import liouville as lv
from liouville import plot
from liouville.problems import heavy_top as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# The centre of the disc is a function of the attitude, which the core evaluates at each kept state.


def disc(t, q, v, params):
    return problem.rotate(q, params.X)


solution = lv.integrate(
    problem.system,
    lv.Spark(stages=4),
    t=(0.0, 60.0),
    h=1e-3,
    every=10,
    observe={"disc": disc},
    **problem.start,
)
solution

# %%
# The rod is 1 m long, so the path is on a sphere of that radius.

fig, ax = plt.subplots(figsize=(5, 4.6), subplot_kw={"projection": "3d"})
shown = solution.t <= 4.0
ax.plot(*solution.observed["disc"][shown].T, lw=1)
ax.set(
    xlabel="x / m", ylabel="y / m", zlabel="z / m", title="path of the disc's centre, 4 s"
)
ax.set_box_aspect((1, 1, 1), zoom=0.9)
ax.locator_params(nbins=5)
plt.show()

# %%
# What is constant, after a thousand revolutions and more.

fig, ax = plt.subplots()
plot.invariants(solution, ax=ax)
ax.set(xlabel="time / s")
plt.show()
