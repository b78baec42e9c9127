"""
A bowling ball
==============

A ball is thrown with a spin of its own: it slides along a parabola until its slip is zero, then
rolls straight on. Friction is Coulomb's, against a slip of two directions, and nothing is smoothed:
when, where and which way it rolls is known in closed form.
"""

# %%
# The ball flies but for the lane, on which it has friction.

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.bodies import Assembly, Plane, Sphere

plt.style.use(plot.STYLE)

R, MASS, MU, G = 0.108, 6.8, 0.2, 9.81

m = Assembly(gravity=(0, 0, -G))
ball = m.body("ball", mass=MASS, inertia=[0.4 * MASS * R**2] * 3, at=(0, 0, R))
m.free("flight", ball)
m.contact("lane", Sphere(ball, R), Plane("ground"), friction=MU)
lane = m.system()

# %%
# Three throws at 8 m/s, of which the first spins back and the others to the side.

throws = {"back": (0, -30), "left": (-30, 10), "more to the left": (-60, 10)}  # rad/s
runs = {}
for name, (across, along) in throws.items():
    start = m.start(rates={"flight": (8, -0.5, 0, across, along, 0)})
    runs[name] = lv.integrate(lane, lv.Spark(4), t=(0, 2.3), h=0.02, **start)
plot.view(runs["more to the left"], trace="ball")

# %%
# The slip :math:`s` keeps its direction and falls by :math:`\frac72 \mu g` a second. So the ball
# rolls from :math:`2 |s| / 7 \mu g` on, with a velocity that is less by :math:`\frac27 s`.

fig, ax = plt.subplots()
for name, run in runs.items():
    x, y, _ = run.body("ball").position.T
    (line,) = ax.plot(x, y, label=name)
    (across, along), change = throws[name], run.contacts["lane"].changes[-1]
    slip = np.array([8 - R * along, -0.5 + R * across])
    rolls, v = 2 * np.hypot(*slip) / (7 * MU * G), np.array([8, -0.5]) - 2 / 7 * slip
    ax.plot(
        np.interp(rolls, run.t, x),
        np.interp(rolls, run.t, y),
        "o",
        color=line.get_color(),
    )
    off = np.abs(run.body("ball").velocity[-1, :2] - v).max()
    print(
        f"{name}: rolls at {change.t:.6f} s, off by {abs(change.t - rolls):.0e} s, {off:.0e} m/s"
    )
ax.set(xlabel="along the lane / m", ylabel="across / m")
fig.legend(ncols=3, loc="outside upper left")
plt.show()
