"""Exudyn on mechanisms with loops: rigid bodies by Euler parameters, joints, generalised alpha.

The closing hinge of a chain is a joint as the others are. Where joints hold more than the loop
needs, the singular matrix is left to Eigen, as its manual advises.
"""

import sys
import time
from functools import partial

import numpy as np

sys.exudynFast = True

import exudyn  # noqa: E402 - the line above selects its fast module
import exudyn.utilities as tools  # noqa: E402

exudyn.SetWriteToConsole(False)  # a run that fails says so by an exception

RHO = 0.9
STEPS = (2e-3, 1e-3)


def runs(model, begin, records):
    """Yield name, step and what runs it."""
    for h in STEPS:
        yield "Exudyn", h, partial(Loop(model, begin, h).run, records)


class Loop:
    """A model with a step."""

    def __init__(self, model, begin, h):
        self.model, self.begin, self.h = model, begin, h

    def build(self):
        """Make bodies and joints anew."""
        model, (x, _, v, omega) = self.model, self.begin
        self.container = exudyn.SystemContainer()
        mbs = self.mbs = self.container.AddSystem()
        bodies = {"world": mbs.CreateGround(referencePosition=[0.0, 0.0, 0.0])}
        for k, link in enumerate(model.links):
            bodies[link.name] = mbs.CreateRigidBody(
                referencePosition=list(x[k]),
                initialVelocity=list(v[k]),
                initialAngularVelocity=list(omega[k]),
                inertia=tools.RigidBodyInertia(mass=link.mass, inertiaTensor=link.inertia),
                gravity=list(model.gravity),
            )
        self.bodies = [bodies[link.name] for link in model.links]
        for link in model.links:
            self.join(bodies[link.parent], bodies[link.name], link)
        if len(model.closings) != 2:  # two are a hinge
            for a, b, point in model.closings:
                mbs.CreateSphericalJoint(bodyNumbers=[bodies[a], bodies[b]], position=list(point))
        else:
            (a, b, first), (_, _, second) = model.closings
            pair, middle = [bodies[a], bodies[b]], list((first + second) / 2)
            mbs.CreateRevoluteJoint(bodyNumbers=pair, position=middle, axis=list(second - first))
        mbs.Assemble()

    def join(self, a, b, link):
        """Join two bodies by a hinge, a universal joint or a slide with its spring."""
        mbs, pair = self.mbs, [a, b]
        kinds = [kind for _, kind, _, _ in link.joints]
        _, _, axis, point = link.joints[0]
        if kinds == ["hinge"]:
            mbs.CreateRevoluteJoint(bodyNumbers=pair, position=list(point), axis=list(axis))
        elif kinds == ["hinge", "hinge"]:
            second = link.joints[1][2]
            frame = np.array([axis, second, np.cross(axis, second)]).T
            mbs.CreateGenericJoint(
                bodyNumbers=pair,
                position=list(point),
                rotationMatrixAxes=frame,
                constrainedAxes=[1, 1, 1, 0, 0, 1],
            )
        elif kinds == ["slide"]:
            mbs.CreatePrismaticJoint(bodyNumbers=pair, position=list(link.at), axis=list(axis))
            mbs.CreateSpringDamper(
                bodyNumbers=pair,
                localPosition0=[0.0, 0.0, 0.0],
                localPosition1=[0.0, 0.0, 0.0],
                stiffness=link.stiffness,
            )

    def run(self, records):
        """Return seconds of a run, and the motion of all bodies by another one."""
        seconds = self.solve(None)
        found = []
        self.solve(max(1, round(self.model.seconds / self.h / records)), found)
        return seconds, [np.array(part) for part in zip(*found, strict=True)]

    def solve(self, every, found=None):
        """Integrate, and note the state every so many steps."""
        self.build()
        settings = exudyn.SimulationSettings()
        settings.solutionSettings.writeSolutionToFile = False
        stepping = settings.timeIntegration
        stepping.endTime, stepping.numberOfSteps = (
            self.model.seconds,
            round(self.model.seconds / self.h),
        )
        stepping.verboseMode = 0
        stepping.generalizedAlpha.spectralRadius = RHO
        stepping.newton.relativeTolerance = 1e-8
        stepping.newton.useModifiedNewton = True
        settings.linearSolverType = exudyn.LinearSolverType.EigenDense
        settings.linearSolverSettings.ignoreSingularJacobian = True
        if every is not None:
            count = iter(range(10**9))

            def note(mbs, _):
                if next(count) % every == 0:
                    found.append(self.state())
                return True

            self.mbs.SetPreStepUserFunction(note)
        begin = time.perf_counter()
        self.mbs.SolveDynamic(settings)
        seconds = time.perf_counter() - begin
        if found is not None:
            found.append(self.state())
        return seconds

    def state(self):
        """Return places, turns, velocities and angular velocities of the bodies."""
        kind = exudyn.OutputVariableType
        rows = []
        for what in (kind.Position, kind.RotationMatrix, kind.Velocity, kind.AngularVelocity):
            rows.append(
                np.array(
                    [
                        self.mbs.GetObjectOutputBody(body, what, [0.0, 0.0, 0.0])
                        for body in self.bodies
                    ]
                )
            )
        rows[1] = rows[1].reshape(-1, 3, 3)
        return rows
