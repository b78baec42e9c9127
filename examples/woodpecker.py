"""
A woodpecker toy
================

A woodpecker on a spring pecks its way down a pole: its sleeve is wider than the pole, slides, jams
as it tilts, and lets go when the bird swings back. Measures are those of Glocker's thesis (TU
München, 1995), who found the motion of such toys; its geometry is not linearised here.
"""

# %%
# Sleeve and bird move in a plane. The sleeve's centre is on the axis of the pole, and the spring is
# a hinge with a stiffness.

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.bodies import Assembly, Plane, Sphere

plt.style.use(plot.STYLE)

POLE, INNER, HALF = 0.0025, 0.0031, 0.0058  # radii of pole and sleeve, half its height
HINGE, BIRD = 0.010, 0.015  # from the axis to the hinge, on to the bird
BEAK, HIGH = 0.0201, 0.02  # from the bird back to its beak, and up

toy = Assembly(gravity=(0, -9.81, 0))
sleeve = toy.planar_body("sleeve", mass=0.3e-3, inertia=5e-9)
bird = toy.planar_body("bird", mass=4.5e-3, inertia=0.7e-6, at=(HINGE + BIRD, 0))
toy.guide("pole", "ground", sleeve, lambda position, params: [position[0]])
toy.revolute("spring", sleeve, bird, at=(HINGE, 0), spring=0.0056)
toy

# %%
# Two corners of the sleeve and the beak touch the pole, with friction; the beak rebounds.

wood = Plane("ground", at=(POLE, 0), normal=(1, 0))
toy.contact("top", Sphere(sleeve, at=(INNER, HALF)), wood, friction=0.3)
toy.contact("bottom", Sphere(sleeve, at=(INNER, -HALF)), wood, friction=0.3)
beak = Sphere(bird, at=(HINGE + BIRD - BEAK, HIGH))
toy.contact("beak", beak, wood, friction=0.3, restitution=0.5)
system = toy.system()

# %%
# The bird is let go a bit below its rest. Each change of a contact begins a new stretch of smooth
# motion, in which nothing is regularised.

start = toy.start(values={"spring": -0.15})
solution = lv.integrate(system, lv.Spark(3), t=(0, 2), h=0.001, **start)
solution

# %%
# Its sleeve falls, jams and falls again.

plot.view(solution.sel(time=slice(0, 0.4)), trace="bird")

# %%
# After some pecks the motion is periodic: the time from one peck to the next, and the way down.

pecks = np.array([x.t for x in solution.contacts["beak"].changes if x.kind == "hit"])
height = np.interp(pecks, solution.t, solution.body("sleeve").position[:, 1])
print("time / s:", np.diff(pecks)[-3:].round(5))
print("fall / mm:", -1000 * np.diff(height)[-3:].round(6))

# %%
# One period: the bird swings while the sleeve sticks at its lower corner, slips down, and is thrown
# on its upper corner as the beak hits.

shown = (solution.t > pecks[-3]) & (solution.t < pecks[-1])
fig, ax = plt.subplots()
for body, values in {
    "sleeve": solution.body("sleeve").rotation,
    "bird": solution.body("bird").rotation,
}.items():
    angle = 2 * np.arctan2(values[:, 3], values[:, 0])
    ax.plot(solution.t[shown], angle[shown], label=f"angle of the {body}")
ax.set(xlabel="time / s", ylabel="angle / rad")
fig.legend(ncols=2, loc="outside upper right")
plt.show()
