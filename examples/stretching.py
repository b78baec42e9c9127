"""
Stretching in the ABC flow
==========================

Neighbouring tracers of a chaotic flow part, in some places faster than in others. The finite-time
exponent of a place is the logarithm of the largest stretching from there, over the time; its ridges
part regions that mix from those that do not.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import abc_flow as problem

plt.style.use(plot.STYLE)

# %%
# A grid of tracers on the plane z = 0, each with the tangents along the three axes. They are the
# derivatives of the very steps that the tracers make, eight directions side by side.

side = (np.arange(36) + 0.5) * 2 * np.pi / 36
x, y = np.meshgrid(side, side)
starts = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
tracers = lv.ensemble(
    problem.system,
    lv.VolumeSplitting(composition="BM4"),
    t=(0.0, 8.0),
    h=0.1,
    every=80,
    x=starts,
    tangents={"x": np.eye(3)},
)
tracers.tangents["x"]

# %%
# Stretchings are the singular values of the derivative of the flow. Their product is one, as the
# volume of a drop of dye is kept while it becomes a thread or a sheet.

derivative = tracers.tangents["x"].x[-1]
stretchings = np.linalg.svd(derivative, compute_uv=False)
print(f"volume of a drop kept to {np.abs(stretchings.prod(axis=1) - 1).max():.0e}")

fig, ax = plt.subplots(figsize=(5.6, 4.8))
exponent = np.log(stretchings[:, 0]) / 8.0
shown = ax.pcolormesh(x, y, exponent.reshape(x.shape), cmap="magma", rasterized=True)
fig.colorbar(shown, label="finite-time exponent, over 8 units of time")
ax.set(xlabel="x / rad", ylabel="y / rad", aspect="equal")
plt.show()

# %%
# Over a long time all chaotic tracers have the same exponents, which sum to zero; their tangents
# are made orthogonal on the way.

found = lv.analysis.lyapunov(
    problem.system,
    lv.VolumeSplitting(composition="BM4"),
    t=(0.0, 400.0),
    h=0.1,
    x=[5.0, 1.0, 0.0],
)
print(found.exponents, f"sum {found.exponents.sum():.0e}")

fig, ax = plt.subplots()
ax.plot(found.t, found.history)
ax.set(xlabel="time", ylabel="mean growth rates until then")
plt.show()
