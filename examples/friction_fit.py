"""
Dry friction from two films
===========================

A block on a spring slides on a table and was filmed twice, from two starts that nobody measured.
Stiffness, friction and both starts are found from the places in the films; a frame that was read
wrongly does not matter.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

system = lv.Lagrangian(
    lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
    q=("x",),
    force=lambda t, q, v, params: -params.mu * 9.81 * ca.sign(v[0]),
    params={"k": 30.0, "mu": 0.15},
)

# %%
# Friction changes its sign where the block turns. The event ends a step there, and its reset
# changes nothing.

turns = {
    "turn": lv.Event(
        lambda t, q, v, lam, params: v[0], reset=lambda t, q, v, lam, params: {}
    )
}

# %%
# The films: 25 frames a second, places good to 2 mm, and in each one frame off by 10 cm.

rng = np.random.default_rng(3)
truths = [{"q": [0.60], "v": [-0.8]}, {"q": [0.05], "v": [2.2]}]
trials = []
for k, truth in enumerate(truths):
    film = lv.integrate(
        system,
        lv.Spark(3),
        t=(0.0, 1.6),
        h=0.04,
        params={"k": 40.0, "mu": 0.1},
        events=turns,
        **truth,
    )
    places = film.q[:, 0] + 0.002 * rng.standard_normal(film.t.size)
    places[12 + 7 * k] += 0.1
    guess = {"q": [places[0]], "v": [(places[1] - places[0]) / 0.04]}
    trials.append(lv.Trial({"t": film.t, "x": places}, guess))

# %%
# Both films have the parameters in common, and a start each. Huber's loss counts a residual beyond
# its deviation by its size, not by its square.

found = lv.fit(
    system,
    lv.Spark(3),
    trials,
    h=0.04,
    params=("k", "mu"),
    free=("q", "v"),
    sigma=0.002,
    loss="huber",
    events=turns,
)
found

# %%
# Residuals are noise but for the two frames.

plot.fit(found)

# %%
# What was seen, and what was found.

fig, panels = plt.subplots(2, sharex=True, sharey=True)
for ax, film, trial in zip(panels, trials, found.trials, strict=True):
    ax.plot(trial.solution.t, trial.solution.q[:, 0], label="fitted")
    ax.plot(film.data["t"], film.data["x"], ".", label="seen")
    ax.set(ylabel="x / m")
panels[0].legend(ncols=2)
panels[1].set(xlabel="time / s")
plt.show()
