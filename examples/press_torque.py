"""
The torque of a press
=====================

A crank pushes a ram by a rod, against a workpiece whose force was measured. Which torque does its
motor need to turn evenly? Inverse dynamics answers from the motion alone, at every time.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

work = lv.table(
    [-0.12, -0.10, -0.08, -0.06, 0.0, 0.1], [900.0, 500.0, 120.0, 0.0, 0.0, 0.0]
)


def press(**motor):
    """Draw the press with its crank to the right, and a motor in joint A."""
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    m.planar_body("crank", mass=2.0, inertia=0.01, at=(0.05, 0))
    m.planar_body(
        "rod", mass=1.5, inertia=0.02, at=(0.05, -0.2), angle=np.arctan2(-0.4, -0.1)
    )
    m.point_mass("ram", mass=8.0, at=(0, -0.4, 0))
    m.revolute("A", "ground", "crank", at=(0, 0, 0), axis=(0, 0, 1), **motor)
    m.revolute("B", "crank", "rod", at=(0.1, 0, 0), axis=(0, 0, 1))
    m.spherical("C", "rod", "ram", at=(0, -0.4, 0))
    m.prismatic(
        "D",
        "ground",
        "ram",
        axis=(0, 1, 0),
        force=lambda t, slide, rate, params: work(slide),
    )
    return m


# %%
# The crank is prescribed; its motion is a run as any other.

driven = press(motion=lambda t, params: 2 * np.pi * t)
motion = lv.integrate(driven.system(), lv.Spark(3), t=(0, 2), h=0.005, **driven.start())

# %%
# The same press has a motor in place of the motion: its torque is what is asked for.

found = lv.analysis.inverse_dynamics(press().system(), motion, ["A"])
angle = np.degrees(motion.joint("A").angle)

fig, (left, right) = plt.subplots(1, 2)
left.plot(angle, found.efforts["A"])
left.set(xlabel="angle of the crank / degrees", ylabel="torque / N m")
slide = motion.joint("D").slide
right.plot(slide, work(slide))
right.set(xlabel="way of the ram / m", ylabel="force of the workpiece / N")
plt.show()

# %%
# It is the multiplier of the prescribed motion, found another way.

apart = np.abs(found.efforts["A"] - motion.joint("A").torque[:, 2]).max()
print(f"apart by {apart:.0e} of {np.abs(found.efforts['A']).max():.0f} N m")
