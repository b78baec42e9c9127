"""
A platform on six legs
======================

A Stewart platform carries a plate on six legs, and each leg's force or length moves it. Here all
legs have springs and dampers, and a motor each that pulls to and fro. The view turns under the
mouse.
"""

# %%
# A leg has two halves: the lower one stands on a universal joint, the upper one slides along it and
# carries the plate on a ball joint. Bodies and joints are places and directions as drawn.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)


def ring(radius, height, *degrees):
    """Return points on a circle."""
    turn = np.radians(degrees)
    return np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), np.full(6, height)], axis=1
    )


feet = ring(1.0, 0.0, -20, 20, 100, 140, 220, 260)
heads = ring(0.6, 1.0, -45, 45, 75, 165, 195, 285)

m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
m.body("plate", mass=20, inertia=(1.0, 1.0, 1.9), at=(0, 0, 1))
for k, (foot, head) in enumerate(zip(feet, heads, strict=True)):
    leg = head - foot
    along = leg / np.linalg.norm(leg)
    flat = np.cross(along, (0, 0, 1)) / np.hypot(along[0], along[1])
    across = np.cross(along, flat)
    # moments along the leg are small
    thin = np.diag([1.0, 1.0, 1.0]) - 0.9 * np.outer(along, along)
    m.body(f"lower {k}", mass=2, inertia=0.05 * thin, at=foot + 0.25 * leg)
    m.body(f"upper {k}", mass=1, inertia=0.03 * thin, at=foot + 0.7 * leg)
    m.universal(f"foot {k}", m.ground, f"lower {k}", at=foot, axes=(flat, across))
    m.prismatic(
        f"leg {k}",
        f"lower {k}",
        f"upper {k}",
        axis=along,
        spring=6000.0,
        damping=40.0,
        force=lambda t, slide, rate, params, k=k: params.pull * ca.sin((2 + 0.3 * k) * t),
    )
    m.spherical(f"head {k}", f"upper {k}", "plate", at=head)
system = m.system(params={"pull": 400.0})

# %%
# Thirteen bodies have 91 coordinates and 85 constraints: the six freedoms of the plate are left.

solution = lv.integrate(system, lv.Spark(3), t=(0, 8), h=0.02, **m.start())
print(len(system.coordinates), "coordinates,", len(system.constraints), "constraints")
print(f"constraints off by {solution.residuals['constraint'].max():.1e}")

# %%
# Drag the picture to turn it, scroll to come nearer after a click on it; space stops the motion. A
# body shows the box that has its mass and inertia, and lines between its joints. The page needs no
# network: ``plot.view(solution, path="platform.html")`` writes it.

plot.view(solution, trace="plate")

# %%
# What each ball joint bears comes out with the motion.

fig, ax = plt.subplots()
for k in range(6):
    force = np.linalg.norm(solution.joint(f"head {k}").force, axis=1)
    ax.plot(solution.t, force, label=f"leg {k}")
ax.set(xlabel="time / s", ylabel="force / N", title="force between leg and plate")
fig.legend(ncols=6, loc="outside upper right")
plt.show()
