"""
A robot from a file
===================

Two motors move the tip of a five-bar linkage. The file has a tree of joints and a connection that
closes the loop, which is exact here. The motors are servos: they follow their signals as far as
their forces reach.
"""

# %%
# A path would do as well as the text. MuJoCo's compiler reads it, ``pip install
# "liouville[robots]"``.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv

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

controls = {
    "left": lambda t, angle, rate, params: params.sway * ca.sin(params.pace * t),
    "right": lambda t, angle, rate, params: params.sway * ca.sin(params.pace * t + 1.2),
}
robot = lv.bodies.from_mjcf(ROBOT, controls=controls)
system = robot.system(params={"sway": 0.35, "pace": 6.0})
print(system)

# %%
# Starts close the loop, and the force in the connection comes out with the motion.

solution = lv.integrate(system, lv.Spark(3), t=(0, 4), h=0.005, **robot.start())
print(f"the loop is open by {max(np.abs(x).max() for x in solution.residuals.values()):.1e}")

# elbow and tip are the ends of bars, whose centres are in the middle
elbow = 2 * solution.body("left").position
tip = 2 * solution.body("left forearm").position - elbow
other = 2 * solution.body("right").position - [0.2, 0, 0]
force = solution.joint("tip").force

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
for k in range(0, 200, 20):
    bars = np.array([[0, 0, 0], elbow[k], tip[k], other[k], [0.2, 0, 0]])
    left.plot(bars[:, 0], bars[:, 2], color="0.8")
left.plot(tip[:, 0], tip[:, 2])
left.set(aspect="equal", xlabel="x / m", ylabel="z / m", title="path of the tip")

for name in ("left motor", "right motor"):
    right.plot(solution.t, solution.joint(name).effort, label=f"torque of the {name} / Nm")
right.plot(solution.t, np.linalg.norm(force, axis=1), "k", label="force in the tip / N")
right.set(xlabel="time / s", xlim=(0, 2))
right.legend()
plt.show()
