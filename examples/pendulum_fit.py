"""
The length of a pendulum from a film
====================================

A pendulum was filmed: every tenth of a second there is a place, a few millimetres off, and some
frames are missing. Its length, its damping and how it was let go are found from that, with the
uncertainty of each.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

system = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
    lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
    q=("x", "y"),
    force=lambda t, q, v, params: -params.c * v,
    params={"l": 0.8, "c": 0.05},
)

# %%
# The film: a run of the true pendulum, 1 m long and damped at 0.12 / s, with noise of 5 mm.

rng = np.random.default_rng(1)
truth = lv.integrate(
    system,
    lv.Spark(3),
    t=(0.0, 6.0),
    h=0.05,
    every=2,
    params={"l": 1.0, "c": 0.12},
    q=[np.sin(0.9), -np.cos(0.9)],
    v=[0.0, 0.0],
)
places = truth.q + 0.005 * rng.standard_normal(truth.q.shape)
places[rng.random(len(places)) < 0.2] = np.nan

# %%
# The fit starts from a rod of 80 cm. Its length is in the constraint, so that the start moves with
# it; residuals and their exact derivatives come from one run.

found = lv.fit(
    system,
    lv.Spark(3),
    {"t": truth.t, "q": places},
    h=0.05,
    params=("l", "c"),
    free=("q", "v"),
    sigma=0.005,
    q=[0.6, -0.5],
    v=[0.0, 0.0],
)
found

# %%
# What was seen, and what was found: residuals are noise.

fig, (above, below) = plt.subplots(2, sharex=True, height_ratios=(2, 1))
above.plot(found.solution.t, found.solution.q[:, 0], label="fitted")
above.plot(truth.t, places[:, 0], ".", label="seen")
above.set(ylabel="x / m")
fig.legend(ncols=2, loc="outside upper left")
below.plot(truth.t, 1e3 * (places - found.solution.q), ".")
below.set(xlabel="time / s", ylabel="residuals / mm")
plt.show()
