"""
A sleigh that turns round
=========================

Chaplygin's sleigh glides on ice, carried by a blade that moves along itself only. The constraint is
on velocities, and no constraint on positions implies it. Energy is constant and the motion is
reversible in time. All the same the sleigh, started with its centre of mass behind the blade,
always turns round, and the rotation then decays exponentially.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import chaplygin_sleigh as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# Three sleighs, the centres of mass of which are ahead of the blade by a.

runs = {}
for a in (0.5, 1.0, 2.0):
    start = problem.system.consistent(
        params={"a": a}, q=[0.0, 0.0, 0.0], v=[-0.995, 0.0, 0.0825]
    )
    solution = lv.integrate(
        problem.system, lv.Spark(stages=3), t=(0.0, 40.0), h=0.1, params={"a": a}, **start
    )
    drift = np.ptp(solution.invariants["energy"]) / solution.invariants["energy"][0]
    held = np.abs(solution.residuals["nonholonomic"]).max()
    print(f"a = {a:g}: energy within {drift:.1e}, slip at most {held:.1e}")
    runs[a] = solution

# %%
# All start to the left, and turn at a cusp.

fig, ax = plt.subplots()
for (a, solution), style in zip(runs.items(), (":", "-", "--"), strict=True):
    ax.plot(*solution.q[:, :2].T, style, label=f"a = {a:g}")
ax.set(xlabel="x of the blade", ylabel="y of the blade", aspect="equal")
ax.set(xlim=(-9, 3), ylim=(-6, 2))
fig.legend(ncols=3, loc="outside upper left")
plt.show()

# %%
# The rotation decays.

fig, ax = plt.subplots()
for (a, solution), style in zip(runs.items(), (":", "-", "--"), strict=True):
    ax.semilogy(solution.t, np.abs(solution.v[:, 2]), style, label=f"a = {a:g}")
ax.set(xlabel="time", ylabel="rate of turning")
fig.legend(ncols=3, loc="outside upper left")
plt.show()
