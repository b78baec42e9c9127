"""MuJoCo on mechanisms with loops, closed by equality constraints as stiff as the step allows."""

import time
from functools import partial

import mujoco
import numpy as np

from peers import loops

PEERS = (("DISCRETE", 1e-3), ("implicitfast", 1e-3), ("RK4", 1e-3), ("RK4", 1e-4))


def runs(model, begin, records):
    """Yield name, step and what runs each integrator."""
    for integrator, h in PEERS:
        try:
            yield f"MuJoCo {integrator}", h, partial(Loop(model, begin, integrator, h).run, records)
        except ValueError as trouble:  # an older MuJoCo
            print(trouble)


class Loop:
    """A model with one of the integrators."""

    def __init__(self, model, begin, integrator, h):
        self.steps = round(model.seconds / h)
        name = "Euler" if integrator == "DISCRETE" else integrator
        self.model = mujoco.MjModel.from_xml_string(loops.mjcf(model, h, name))
        if integrator == "DISCRETE":
            self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.bodies = [self.model.body(link.name).id for link in model.links]
        # speeds of the joints, by those of the bodies
        rows, wanted = [], []
        for body, v, omega in zip(self.bodies, begin[2], begin[3], strict=True):
            place, turn = np.zeros((2, 3, self.model.nv))
            mujoco.mj_jacBodyCom(self.model, self.data, place, turn, body)
            rows += [place, turn]
            wanted += [v, omega]
        self.start = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]

    def run(self, records):
        """Return seconds and the motion of all bodies."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qvel[:] = self.start
        mujoco.mj_forward(model, data)
        found, seconds = [self.state()], 0.0
        for _ in range(records):
            begin = time.perf_counter()
            mujoco.mj_step(model, data, nstep=self.steps // records)
            seconds += time.perf_counter() - begin
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            found.append(self.state())
        return seconds, [np.array(part) for part in zip(*found, strict=True)]

    def state(self):
        """Return places, turns, velocities and angular velocities of the bodies."""
        speeds, twist = [], np.zeros(6)
        for body in self.bodies:
            kind = mujoco.mjtObj.mjOBJ_BODY
            mujoco.mj_objectVelocity(self.model, self.data, kind, body, twist, 0)
            speeds.append(twist.copy())
        speeds = np.array(speeds)
        turns = self.data.xmat[self.bodies].reshape(-1, 3, 3).copy()
        return self.data.xipos[self.bodies].copy(), turns, speeds[:, 3:], speeds[:, :3]
