"""MuJoCo on the library's hanging chain, twice: links on hinges, and mass points on equalities.

With hinges the links' angles are the coordinates, so no joint can open. With equalities each point
has its two coordinates, and tendons between neighbours keep their lengths as MuJoCo's constraints
do, softly: by springs and dampers whose time constant is here the least it allows, two steps. The
points have a billionth of m l^2 as inertia, because a body needs one; contacts are off.
"""

import time

import mujoco
import numpy as np

JOINTS = ("hinges", "equalities")
INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4")


def hinges(links, mass, length):
    """Return the bodies of a chain of links, each on a hinge at the end of the one before."""
    inertia = 1e-9 * mass * length**2
    body, ends = "", ""
    for i in range(links):
        place = f"0 0 {-length if i else 0}"
        body += f'<body pos="{place}"><joint type="hinge" axis="0 -1 0"/>'
        body += f'<inertial pos="0 0 {-length}" mass="{mass}" diaginertia="{(f"{inertia} " * 3)}"/>'
        ends += "</body>"
    return f"<worldbody>{body}{ends}</worldbody>"


def equalities(links, mass, length):
    """Return mass points and the tendons that keep the distances between them."""
    inertia = 1e-9 * mass * length**2
    bodies, tendons, kept = '<site name="p0"/>', "", ""
    for i in range(1, links + 1):
        bodies += f'<body pos="0 0 {-i * length}"><site name="p{i}"/>'
        bodies += '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        bodies += (
            f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{(f"{inertia} " * 3)}"/></body>'
        )
        tendons += f'<spatial name="t{i}"><site site="p{i - 1}"/><site site="p{i}"/></spatial>'
        kept += f'<tendon tendon1="t{i}" solref="1e-9 1" solimp="0.9999 0.9999 1e-3"/>'
    return f"<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon><equality>{kept}</equality>"


class Chain:
    """A chain with one of the ways to join its links, integrator and step."""

    def __init__(self, params, start, joints, integrator, h):
        self.start = np.reshape(start["q"], (-1, 2)), np.reshape(start["v"], (-1, 2))
        self.links, self.joints = len(self.start[0]), joints
        self.length = params["l"] / self.links
        option = f'gravity="0 0 {-params["g"]}" timestep="{h}" integrator="{integrator}"'
        flags = '<flag contact="disable"/>'
        make = hinges if joints == "hinges" else equalities
        parts = make(self.links, params["m"] / self.links, self.length)
        text = f"<mujoco><option {option}>{flags}</option>{parts}</mujoco>"
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def run(self, records, steps):
        """Make so many steps between records; returns seconds and all q, v, of (records + 1, n)."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        if self.joints == "hinges":
            along = np.diff(self.start[1][:, 0], prepend=0.0) / self.length
            data.qvel[:] = np.diff(along, prepend=0.0)
        else:
            data.qvel[:] = self.start[1].ravel()
        found, seconds = [self.state()], 0.0
        for _ in range(records):
            begin = time.perf_counter()
            mujoco.mj_step(model, data, nstep=steps)
            seconds += time.perf_counter() - begin
            found.append(self.state())
        return seconds, *(np.array(part) for part in zip(*found, strict=True))

    def state(self):
        """Return q and v of the points, from the coordinates."""
        if self.joints == "equalities":
            rest = np.stack([np.zeros(self.links), -self.length * np.arange(1, self.links + 1)], 1)
            return rest.ravel() + self.data.qpos, self.data.qvel.copy()
        angle, rate = np.cumsum(self.data.qpos), np.cumsum(self.data.qvel)
        arm = self.length * np.stack([np.sin(angle), -np.cos(angle)], 1)
        swing = self.length * np.stack([np.cos(angle), np.sin(angle)], 1) * rate[:, None]
        return np.cumsum(arm, 0).ravel(), np.cumsum(swing, 0).ravel()
