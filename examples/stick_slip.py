"""
Friction that sticks and slips
==============================

A block on a belt, held back by a spring that pulls it down too. Friction is higher at slow slips
(Stribeck), so the block goes along with the belt until the spring tears it off, and slips back.
The normal force is the reaction of the joint: it changes as the spring leans.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
m.planar_body("belt", mass=5.0, inertia=1.0, at=(0, 0))
m.planar_body("block", mass=1.0, inertia=0.01, at=(0, 0.1))

# %%
# The belt moves as it is told. Friction belongs to the joint of block and belt.

friction = lv.bodies.Stribeck(
    mu=lambda params: params.mu,
    mu_static=lambda params: params.mu_static,
    v_stribeck=0.1,
    v_s=2e-3,
)
m.prismatic(
    "drive", m.ground, "belt", axis=(1, 0, 0), motion=lambda t, params: params.speed * t
)
m.prismatic("contact", "belt", "block", at=(0, 0, 0), axis=(1, 0, 0), friction=friction)
m.spring("spring", m.ground, "block", at=((-0.5, -0.1, 0), (0, 0.1, 0)), stiffness=100.0)

system = m.system(params={"mu": 0.2, "mu_static": 0.4, "speed": 0.2})
solution = lv.integrate(system, lv.Spark(2), t=(0, 4), h=1e-3, **m.start())
contact = solution.joint("contact")

# %%
# The block sticks where its velocity is that of the belt.

fig, ax = plt.subplots()
block = solution.body("block")
ax.plot(solution.t, block.position[:, 0], label="place of the block / m")
ax.plot(solution.t, block.velocity[:, 0], label="its velocity / (m/s)")
ax.axhline(0.2, color="k", lw=0.8)
ax.set(xlabel="time / s")
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# The normal force is the weight and what the spring pulls down. Friction in its size falls with
# the slip; the branch at zero is the load that sticking bears, at slips below v_s.

normal = np.abs(contact.force[:, 1])

fig, (left, right) = plt.subplots(1, 2)
left.plot(solution.t, normal)
left.axhline(9.81, color="k", lw=0.8)
left.set(xlabel="time / s", ylabel="normal force / N")
right.plot(contact.rate, contact.effort / normal)
right.set(xlabel="slip / (m/s)", ylabel="friction / normal force")
plt.show()
