"""
A robot from a file
===================

Two motors move the tip of a five-bar linkage. Its file has a tree of joints and a connection that
closes the loop; the loop is exact here. The motors are servos: they follow their signals as far as
their torques reach.
"""

# %%
# The path of a file would do as well as its text. MuJoCo's compiler reads both, from the extra
# ``robots``.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

ROBOT = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>
  <default>
    <geom type="capsule" size="0.015" density="2700" contype="0" conaffinity="0"/>
    <joint axis="0 1 0"/>
    <position kp="60" kv="3" forcerange="-9 9"/>
  </default>
  <worldbody>
    <body name="left"><joint name="left motor" armature="0.02"/>
      <geom fromto="0 0 0 -0.15 0 -0.26"/>
      <body name="left forearm" pos="-0.15 0 -0.26"><joint name="left elbow"/>
        <geom fromto="0 0 0 0.25 0 -0.34"/>
      </body>
    </body>
    <body name="right" pos="0.2 0 0"><joint name="right motor" armature="0.02"/>
      <geom fromto="0 0 0 0.15 0 -0.26"/>
      <body name="right forearm" pos="0.15 0 -0.26"><joint name="right elbow"/>
        <geom fromto="0 0 0 -0.25 0 -0.34"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect name="tip" body1="left forearm" body2="right forearm" anchor="0.25 0 -0.34"/>
  </equality>
  <actuator>
    <position name="left" joint="left motor"/>
    <position name="right" joint="right motor"/>
  </actuator>
</mujoco>
"""

# %%
# The signals of the servos are functions of time here, and parameters where none are given.

controls = {
    "left": lambda t, angle, rate, params: params.sway * ca.sin(params.pace * t),
    "right": lambda t, angle, rate, params: params.sway * ca.sin(params.pace * t + 1.2),
}
robot = lv.bodies.from_mjcf(ROBOT, controls=controls)
system = robot.system(params={"sway": 0.35, "pace": 6.0})
system

# %%
# The start closes the loop, which stays closed to roundoff.

solution = lv.integrate(system, lv.Spark(3), t=(0, 2), h=0.005, **robot.start())
print(f"{max(np.abs(x).max() for x in solution.residuals.values()):.1e}")

# %%
# Elbows and tip are ends of bars, whose centres are in the middle.

feet = np.array([0, 0, 0]), np.array([0.2, 0, 0])
elbows = [
    2 * solution.body(name).position - foot
    for name, foot in zip(("left", "right"), feet, strict=True)
]
tip = 2 * solution.body("left forearm").position - elbows[0]

fig, ax = plt.subplots()
for k in range(0, 200, 20):
    bars = np.array([feet[0], elbows[0][k], tip[k], elbows[1][k], feet[1]])
    ax.plot(bars[:, 0], bars[:, 2], color="0.8")
ax.plot(tip[:, 0], tip[:, 2])
ax.set(aspect="equal", xlabel="x / m", ylabel="z / m", title="the path of the tip")
plt.show()

# %%
# The servos catch up with their signals first. What the connection bears comes out with the motion.

fig, ax = plt.subplots()
for name in ("left motor", "right motor"):
    ax.plot(solution.t, solution.joint(name).effort, label=f"torque of the {name} / Nm")
force = np.linalg.norm(solution.joint("tip").force, axis=1)
ax.plot(solution.t, force, "k", label="force in the tip / N")
ax.set(xlabel="time / s", ylabel="torque / Nm, force / N")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
