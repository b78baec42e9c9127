"""
A leg that walks
================

Theo Jansen's beasts walk on legs of rods: as a crank turns, the foot goes flat along the ground and
lifts on its way back. The library has the leg as a problem, with seven bodies and ten hinges.
"""

# %%
# Its bodies are drawn at an angle of the crank, and a start is found from the crank's speed.

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import jansen_leg as leg

plt.style.use(plot.STYLE)

leg.assembly

# %%
# The crank is a flywheel and turns freely, so that the leg's weight and inertia make it uneven.

solution = lv.integrate(leg.system, lv.Spark(4), t=(0, 4), h=0.01, **leg.start)
solution

# %%
# The foot leaves a trace: nearly a line below, and an arch.

plot.view(solution, trace={"lower": leg.FOOT})

# %%
# How long the foot is on the ground: the part of a turn in which it is lower than 2 cm, where the
# arch is 22 cm high.

foot = solution.body("lower").point(leg.FOOT)
low = foot[:, 1] - foot[:, 1].min() < 0.02
stride = np.ptp(foot[low, 0])
f"{100 * low.mean():.0f} % of the time, a stride of {100 * stride:.0f} cm"

# %%
# The crank's rate, and the height of the foot. Energy is kept, so the crank is slow where the leg
# is heavy to lift.

fig, ax = plt.subplots()
ax.plot(solution.t, solution.joint("A").rate, label="rate of the crank / rad/s")
ax.plot(
    solution.t, 100 * (foot[:, 1] - foot[:, 1].min()), label="height of the foot / cm"
)
ax.set(xlabel="time / s")
fig.legend(ncols=2, loc="outside upper right")
plt.show()
