"""
A cam and its follower
======================

A spring presses a flat follower onto an eccentric disc. Above a certain speed of the shaft neither
gravity nor the spring slows the follower down as fast as the cam does: it lifts off, falls back and
bounces. The contact has no stiffness, so these times are those of the model, and not of a penalty.
"""

# %%
# A motor turns the disc about a point beside its centre. The follower slides along a guide, and the
# plane of its lower face touches the disc.

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.bodies import Assembly, Plane, Sphere

plt.style.use(plot.STYLE)

RADIUS, OFF = 0.03, 0.01  # of the disc, and from the shaft to its centre, in m
MASS, STIFFNESS, PRESSED, G = 0.2, 200.0, 0.01, 9.81

m = Assembly(gravity=(0, -G, 0))
cam = m.planar_body("cam", mass=0.5, inertia=2e-4, at=(0, -OFF))
follower = m.planar_body("follower", mass=MASS, inertia=1e-4, at=(0, 0.06))
m.revolute("shaft", "ground", cam, at=(0, 0), motion=lambda t, params: params.speed * t)
m.prismatic("guide", "ground", follower, axis=(0, 1, 0), spring=STIFFNESS, rest=-PRESSED)
face = Plane(follower, at=(0, RADIUS - OFF), normal=(0, -1))
m.contact("touch", Sphere(cam, RADIUS), face, restitution=0.3)
system = m.system(params={"speed": 40.0})
m

# %%
# Two turns at three speeds, the first below that at which the contact begins to open.

limit = np.sqrt((STIFFNESS * (2 * OFF + PRESSED) + MASS * G) / (MASS * OFF))
runs = {}
for speed in (55.0, 70.0, 90.0):
    params = {"speed": speed}
    t = (0, 4 * np.pi / speed)
    runs[speed] = lv.integrate(
        system, lv.Spark(3), t=t, steps=400, params=params, **m.start(params=params)
    )
print(f"limit: {limit:.2f} rad/s")
runs[70.0]

# %%
# The motion at 90 rad/s, slowed down.

plot.view(runs[90.0])

# %%
# The cam lifts the follower by :math:`e (1 - \cos \omega t)`. Where the follower is above it, it
# flies.

fig, ax = plt.subplots()
for speed, run in runs.items():
    turns = speed * run.t / (2 * np.pi)
    lift = 1e3 * run.joint("guide").slide
    ax.plot(turns, lift, label=f"at {speed:.0f} rad/s")
turns = np.linspace(0, 2, 300)
ax.plot(turns, 1e3 * OFF * (1 - np.cos(2 * np.pi * turns)), "k:", label="cam")
ax.set(xlabel="turns of the shaft", ylabel="lift / mm")
fig.legend(ncols=4, loc="outside upper left")
plt.show()

# %%
# On the cam the normal force is a cosine of the angle, and it lifts off where that is zero.

fig, ax = plt.subplots()
for speed, run in runs.items():
    ax.plot(speed * run.t / (2 * np.pi), run.contacts["touch"].normal)
    load = MASS * G + STIFFNESS * (OFF + PRESSED)
    lost = load / (OFF * (MASS * speed**2 - STIFFNESS))
    if lost < 1:
        closed = np.arccos(-lost) / speed
        (left, *_) = [x.t for x in run.contacts["touch"].changes if x.kind == "leave"]
        print(
            f"at {speed:.0f} rad/s it lifts off at {left:.12f} s, {closed:.12f} s in closed form"
        )
ax.set(xlabel="turns of the shaft", ylabel="normal force / N")
plt.show()
