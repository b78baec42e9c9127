"""Exudyn on scenes of discs: spheres on quads and on one another, as stiff as the step allows.

Contacts are springs, with dampers where there is no restitution; friction is regularised below a
velocity that falls with the step. Bodies have Euler parameters, and generalised alpha steps them.
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
STEPS = (1e-3, 1e-4)


def runs(scene, records):
    """Yield name, step and what runs it."""
    for h in STEPS:
        yield "Exudyn", h, partial(run, scene, h, records)


def build(scene, h):
    """Return the container, its system and the bodies."""
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    stiffness = (0.03 if scene.restitution else 0.003) / h**2
    law = {
        "contactStiffness": stiffness,
        "contactDamping": 0.0 if scene.restitution else 2 * np.sqrt(stiffness),
        "dynamicFriction": scene.friction,
        "frictionProportionalZone": h,
    }
    ground = mbs.CreateGround()
    bodies, discs = [], []
    for body in scene.bodies:
        x, y, angle = body.at
        vx, vy, spin = body.velocity
        bodies.append(
            mbs.CreateRigidBody(
                referencePosition=[x, y, 0.0],
                referenceRotationMatrix=tools.RotationMatrixZ(angle),
                initialVelocity=[vx, vy, 0.0],
                initialAngularVelocity=[0.0, 0.0, spin],
                inertia=tools.RigidBodyInertia(
                    mass=body.mass, inertiaTensor=body.inertia * np.eye(3)
                ),
                gravity=[0.0, -scene.gravity, 0.0],
            )
        )
        discs += [(bodies[-1], [px, py, 0.0], radius) for px, py, radius in body.discs]
    for k, (body, place, radius) in enumerate(discs):
        for point, normal in scene.planes:
            mbs.CreateSphereQuadContact(
                itemNumbers=[body, ground],
                localPosition0=place,
                sphereRadius=radius,
                quadPoints=quad(np.array([*point, 0.0]), np.array([*normal, 0.0])),
                **law,
            )
        for other, there, more in discs[:k]:
            if other != body:
                mbs.CreateSphereSphereContact(
                    itemNumbers=[body, other],
                    localPosition0=place,
                    localPosition1=there,
                    spheresRadii=[radius, more],
                    **law,
                )
    mbs.Assemble()
    return container, mbs, bodies


def quad(point, normal):
    """Return the corners of a large square with this normal."""
    along, z = 9.0 * np.array([normal[1], -normal[0], 0.0]), np.array([0.0, 0.0, 9.0])
    # off the middle, so that nothing touches the edge of both triangles
    middle = point + along / 3 + z / 7
    return [middle - along + z, middle + along + z, middle + along - z, middle - along - z]


def run(scene, h, records):
    """Return seconds of a run, and places and angles at the records by another one."""
    seconds, found = solve(scene, h, None)[0], []
    solve(scene, h, max(1, round(scene.seconds / h / records)), found)
    return seconds, np.array(found)


def solve(scene, h, every, found=None):
    """Integrate, and note the state every so many steps."""
    container, mbs, bodies = build(scene, h)
    settings = exudyn.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    stepping = settings.timeIntegration
    stepping.endTime, stepping.numberOfSteps = scene.seconds, round(scene.seconds / h)
    stepping.verboseMode = 0
    stepping.generalizedAlpha.spectralRadius = RHO
    stepping.newton.relativeTolerance = 1e-8
    stepping.newton.useModifiedNewton = True
    settings.linearSolverType = exudyn.LinearSolverType.EigenDense
    if every is not None:
        count = iter(range(10**9))

        def note(mbs, _):
            if next(count) % every == 0:
                found.append(places(mbs, bodies))
            return True

        mbs.SetPreStepUserFunction(note)
    begin = time.perf_counter()
    mbs.SolveDynamic(settings)
    seconds = time.perf_counter() - begin
    if found is not None:
        found.append(places(mbs, bodies))
    return seconds, container


def places(mbs, bodies):
    """Return places and angles of the bodies."""
    kind, rows = exudyn.OutputVariableType, []
    for body in bodies:
        x, y, _ = mbs.GetObjectOutputBody(body, kind.Position, [0.0, 0.0, 0.0])
        turn = mbs.GetObjectOutputBody(body, kind.RotationMatrix, [0.0, 0.0, 0.0])
        rows.append((x, y, np.arctan2(turn[3], turn[0])))
    return rows
