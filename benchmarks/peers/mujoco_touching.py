"""MuJoCo on scenes of discs: as it comes, and with contacts as stiff as smaller steps allow."""

import time
from functools import partial

import mujoco
import numpy as np

#: Steps; the first has all settings as they come.
STEPS = (2e-3, 1e-4, 1e-5)


def runs(scene, records):
    """Yield name, step and what runs it."""
    for h in STEPS:
        name = "MuJoCo, defaults" if h == STEPS[0] else "MuJoCo, stiff"
        yield name, h, partial(run, scene, h, records)


def mjcf(scene, h):
    """Return the scene as a file, in the plane of x and y."""
    solver = "" if h == STEPS[0] else 'cone="elliptic" tolerance="1e-12" iterations="200"'
    stiff = "" if h == STEPS[0] else f'solref="{2 * h} 1" solimp="0.9999 0.9999 0.001 0.5 2"'
    if scene.restitution:  # a spring without a damper
        stiff = f'solref="{-0.03 / h**2} 0" solimp="0.9999 0.9999 0.001 0.5 2"'
    law = f'condim="3" friction="{scene.friction} 0 0"' if scene.friction else 'condim="1"'
    parts = []
    for (x, y), (nx, ny) in scene.planes:
        parts.append(f'<geom type="plane" size="9 9 1" pos="{x} {y} 0" zaxis="{nx} {ny} 0"/>')
    for body in scene.bodies:
        x, y, angle = body.at
        j = body.inertia
        parts.append(
            f'<body pos="{x} {y} 0" euler="0 0 {angle}">'
            f'<inertial pos="0 0 0" mass="{body.mass}" diaginertia="{j} {j} {j}"/>'
        )
        # the slides are along the axes of the world, so they stand in a frame that does not turn
        c, s = np.cos(angle), np.sin(angle)
        parts.append(
            f'<joint type="slide" axis="{c} {-s} 0"/><joint type="slide" axis="{s} {c} 0"/>'
        )
        parts.append('<joint type="hinge" axis="0 0 1"/>')
        for px, py, radius in body.discs:
            parts.append(f'<geom type="sphere" size="{radius}" pos="{px} {py} 0"/>')
        parts.append("</body>")
    return f"""<mujoco><compiler angle="radian"/>
      <option timestep="{h}" gravity="0 {-scene.gravity} 0" {solver}/>
      <default><geom {law} {stiff}/></default>
      <worldbody>{"".join(parts)}</worldbody></mujoco>"""


def run(scene, h, records):
    """Return seconds, and places and angles at the records."""
    model = mujoco.MjModel.from_xml_string(mjcf(scene, h))
    data = mujoco.MjData(model)
    data.qvel[:] = np.concatenate([body.velocity for body in scene.bodies])
    at = np.array([body.at for body in scene.bodies])
    found, seconds = [at], 0.0
    steps = round(scene.seconds / h / records)
    for _ in range(records):
        begin = time.perf_counter()
        mujoco.mj_step(model, data, nstep=steps)
        seconds += time.perf_counter() - begin
        found.append(at + data.qpos.reshape(-1, 3))
    return seconds, np.array(found)
