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
from liouville.problems import chaplygin_sleigh as problem

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
for a, style in ((0.5, ":"), (1.0, "-"), (2.0, "--")):
    start = problem.system.consistent(params={"a": a}, q=[0.0, 0.0, 0.0], v=[-0.995, 0.0, 0.0825])
    solution = lv.integrate(
        problem.system, lv.Spark(stages=3), t=(0.0, 40.0), h=0.1, params={"a": a}, **start
    )
    (line,) = left.plot(*solution.q[:, :2].T, style, lw=1, label=f"a = {a:g}")
    right.semilogy(solution.t, np.abs(solution.v[:, 2]), style, color=line.get_color())
    drift = np.ptp(solution.invariants["energy"]) / solution.invariants["energy"][0]
    held = np.abs(solution.residuals["nonholonomic"]).max()
    print(f"a = {a:g}: energy within {drift:.1e}, slip at most {held:.1e}")

left.set(title="path of the blade", aspect="equal", xlim=(-9, 3), ylim=(-10, 2))
left.legend(title="centre of mass ahead by")
right.set(title="rate of turning", xlabel="time")
plt.show()
