"""
The forces in a slider-crank
============================

A crank turns a rod, the rod pushes a slider; two constraints close the loop. Their multipliers have
the full order of the method, and give the force on the guide along with the motion.
"""

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville.problems import slider_crank as problem

solution = lv.integrate(
    problem.system, lv.Spark(stages=3), t=problem.interval, h=problem.h, **problem.start
)
guide = solution.lam[:, solution.names["constraints"].index("guide")]

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
params = SimpleNamespace(**solution.params)
for i in np.linspace(0, len(solution.t) - 1, 12).round().astype(int):
    for line in problem.outline(solution.q[i], params):
        left.plot(*line.T, color=plt.cm.viridis(i / len(solution.t)), lw=1.5)
left.set(aspect="equal", xlabel="x / m", ylabel="y / m", title="twelve instants, dark to light")

right.plot(1e3 * solution.t, guide)
right.set(xlabel="time / ms", ylabel="force of the guide / N", title="the multiplier of the guide")
plt.show()
