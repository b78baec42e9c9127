"""Exudyn: mechanisms of its own bodies and joints, stepped by its generalised alpha.

Rigid bodies in the plane have three coordinates each, so Andrews' mechanism has 21 with 20
constraints where the library's angles have 7 with 6; mass points are the same. The top has its
centre of mass beside its orientation, by Euler parameters or on the Lie group. The compiled module
without range checks is used, nothing is written or drawn, and only SolveDynamic is timed. A
"tolerance" is a number of steps here; Newton's is set below the discretisation's error.
"""

import sys
import time

import casadi as ca
import numpy as np

from liouville.problems import heavy_top

sys.exudynFast = True

import exudyn  # noqa: E402 - the line above selects its fast module
from exudyn import itemInterface as item  # noqa: E402

exudyn.SetWriteToConsole(False)  # a run that fails says so by an exception

RHO = 0.9


class Plane:
    """A mechanism in the making, out of bodies, joints and loads in the plane."""

    def __init__(self):
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.ground = self.mbs.AddObject(item.ObjectGround())
        self.bodies = []

    def body(self, mass, inertia, centre, angle, velocity=(0.0, 0.0), spin=0.0):
        """Add a rigid body by its centre of mass; return its number."""
        node = self.mbs.AddNode(
            item.NodeRigidBody2D(
                referenceCoordinates=[*centre, angle], initialVelocities=[*velocity, spin]
            )
        )
        body = self.mbs.AddObject(
            item.ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)
        )
        self.bodies.append(body)
        return body

    def point(self, mass, place, velocity):
        """Add a mass point; return its number."""
        node = self.mbs.AddNode(
            item.NodePoint2D(referenceCoordinates=list(place), initialVelocities=list(velocity))
        )
        return self.mbs.AddObject(item.MassPoint2D(physicsMass=mass, nodeNumber=node))

    def at(self, body, *place):
        """Mark a place on a body, in its own axes from its centre of mass."""
        return self.mbs.AddMarker(
            item.MarkerBodyPosition(bodyNumber=body, localPosition=[*place, 0.0])
        )

    def join(self, one, other):
        """Let two marked places coincide."""
        self.mbs.AddObject(item.ObjectJointRevolute2D(markerNumbers=[one, other]))

    def weigh(self, body, force):
        """Let a constant vertical force act on a body's centre of mass."""
        place = self.at(body, 0.0, 0.0)
        self.mbs.AddLoad(item.Force(markerNumber=place, loadVector=[0.0, force, 0.0]))


def chain(system, start):
    p, plane = system.params, Plane()
    q, v = np.reshape(start["q"], (-1, 2)), np.reshape(start["v"], (-1, 2))
    links = len(q)
    before = plane.at(plane.ground, 0.0, 0.0)
    for place, velocity in zip(q, v, strict=True):
        point = plane.point(p["m"] / links, place, velocity)
        here = plane.at(point, 0.0, 0.0)
        plane.mbs.AddObject(
            item.ObjectConnectorDistance(markerNumbers=[before, here], distance=p["l"] / links)
        )
        plane.weigh(point, -p["m"] / links * p["g"])
        before = here
    return plane, lambda x, u: (x, u)


def slider_crank(system, start):
    p, plane = system.params, Plane()
    (a, b, s), (da, db, ds) = start["q"], start["v"]
    l1, l2 = p["l1"], p["l2"]
    pin, turn = l1 * direction(a), l1 * da * direction(a + np.pi / 2)
    crank = plane.body(p["m1"], p["j1"], pin / 2, a, turn / 2, da)
    half, swing = l2 / 2 * direction(b), l2 / 2 * db * direction(b + np.pi / 2)
    rod = plane.body(p["m2"], p["j2"], pin + half, b, turn + swing, db)
    slider = plane.point(p["m3"], (s, 0.0), (ds, 0.0))
    plane.join(plane.at(plane.ground, 0.0, 0.0), plane.at(crank, -l1 / 2, 0.0))
    plane.join(plane.at(crank, l1 / 2, 0.0), plane.at(rod, -l2 / 2, 0.0))
    plane.join(plane.at(rod, l2 / 2, 0.0), plane.at(slider, 0.0, 0.0))
    height = plane.mbs.AddMarker(
        item.MarkerNodeCoordinate(
            nodeNumber=plane.mbs.GetObjectParameter(slider, "nodeNumber"), coordinate=1
        )
    )
    fixed = plane.mbs.AddNode(item.NodePointGround())
    zero = plane.mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=fixed, coordinate=0))
    plane.mbs.AddObject(item.ObjectConnectorCoordinate(markerNumbers=[zero, height]))
    plane.weigh(crank, -p["m1"] * p["g"])
    plane.weigh(rod, -p["m2"] * p["g"])
    return plane, lambda x, u: (x[[2, 5, 6]], u[[2, 5, 6]])


def andrews(system, start):
    """Build Andrews' mechanism; each body's first axis is the one its angle is counted from."""
    p, plane = system.params, Plane()
    beta, theta, gamma, phi, delta, omega, epsilon = start["q"]
    e1 = direction
    origin, a, b = np.zeros(2), np.array([p["xa"], p["ya"]]), np.array([p["xb"], p["yb"]])
    quarter = np.pi / 2

    def body(number, pivot, angle, centre):
        """Place a body by its pivot, where its centre of mass is seen from it in its own axes."""
        c, s = np.cos(angle), np.sin(angle)
        there = pivot + np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1]])
        return plane.body(p[f"m{number}"], p[f"i{number}"], there, angle)

    # Angle, centre of mass and joints by the formulas of the problem's loops.
    crank_pin = p["rr"] * e1(beta)
    left = a + p["zt"] * e1(delta)
    right = a + p["u"] * e1(epsilon - quarter)
    k1 = body(1, origin, beta, (p["ra"], 0.0))
    k2 = body(2, crank_pin, beta + theta, (-p["da"], 0.0))
    k3 = body(3, b, gamma, (p["sb"], -p["sa"]))
    k4 = body(4, left, phi + delta - quarter, (p["e"] - p["ea"], 0.0))
    k5 = body(5, a, delta, (p["ta"], p["tb"]))
    k6 = body(6, right, omega + epsilon, (p["zf"] - p["fa"], 0.0))
    k7 = body(7, a, epsilon - quarter, (p["ua"], p["ub"]))
    joint = plane.at(k2, p["da"] - p["d"], 0.0)

    def ground(place):
        return plane.at(plane.ground, *place)

    plane.join(ground(origin), plane.at(k1, -p["ra"], 0.0))
    plane.join(plane.at(k1, p["rr"] - p["ra"], 0.0), plane.at(k2, p["da"], 0.0))
    plane.join(ground(b), plane.at(k3, -p["sb"], p["sa"]))
    plane.join(joint, plane.at(k3, -p["sb"], p["sa"] - p["ss"]))
    plane.join(ground(a), plane.at(k5, -p["ta"], -p["tb"]))
    plane.join(plane.at(k5, p["zt"] - p["ta"], -p["tb"]), plane.at(k4, p["ea"] - p["e"], 0.0))
    plane.join(joint, plane.at(k4, p["ea"], 0.0))
    plane.join(ground(a), plane.at(k7, -p["ua"], -p["ub"]))
    plane.join(plane.at(k7, p["u"] - p["ua"], -p["ub"]), plane.at(k6, p["fa"] - p["zf"], 0.0))
    plane.join(joint, plane.at(k6, p["fa"], 0.0))
    hook = plane.at(k3, p["sd"] - p["sb"], p["sa"] - p["sc"])
    plane.mbs.AddObject(
        item.ObjectConnectorSpringDamper(
            markerNumbers=[ground((p["xc"], p["yc"])), hook],
            referenceLength=p["l0"],
            stiffness=p["c0"],
        )
    )
    turning = plane.mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=k1))
    plane.mbs.AddLoad(item.Torque(markerNumber=turning, loadVector=[0.0, 0.0, p["mom"]]))

    def angles(x):
        """Return the library's angles (or their rates) from those of the bodies."""
        one, two, three, four, five, six, seven = x[2::3]
        return np.array([one, two - one, three, four - five, five, six - seven, seven])

    return plane, lambda x, u: (angles(x), angles(u))


pendulum = chain  # of one link


def top(make):
    """Hang a body with this node from the ground, by its own place opposite its centre of mass."""

    def build(system, start):
        p, plane = system.params, Plane()
        arm, q, v = np.array(p["X"]), np.array(start["q"]), np.array(start["v"])
        omega = np.array(heavy_top.angular_velocity(ca.DM(q), ca.DM(v)))[:, 0]
        node, ends = make(plane.mbs, arm, np.cross(omega, arm), q, v, omega)
        body = plane.mbs.AddObject(
            item.ObjectRigidBody(
                physicsMass=p["m"], physicsInertia=[*p["J"], 0.0, 0.0, 0.0], nodeNumber=node
            )
        )
        place = [
            plane.mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=of, localPosition=list(at)))
            for of, at in ((plane.ground, np.zeros(3)), (body, -arm), (body, np.zeros(3)))
        ]
        plane.mbs.AddObject(item.ObjectJointSpherical(markerNumbers=place[:2]))
        weight = [0.0, 0.0, -p["m"] * p["g"]]
        plane.mbs.AddLoad(item.Force(markerNumber=place[2], loadVector=weight))
        return plane, ends

    return build


@top
def euler_parameters(mbs, centre, motion, q, v, omega):
    node = item.NodeRigidBodyEP(referenceCoordinates=[*centre, *q], initialVelocities=[*motion, *v])
    return mbs.AddNode(node), lambda x, u: (x[3:], u[3:])


@top
def lie_group(mbs, centre, motion, q, v, omega):
    """Start in axes along those of space; of two quaternions that with q0 > 0 comes out."""
    node = item.NodeRigidBodyRotVecLG(
        referenceCoordinates=[*centre, 0.0, 0.0, 0.0], initialVelocities=[*motion, *omega]
    )

    def quaternions(x, u):
        angle = np.linalg.norm(x[3:])
        q = np.append(np.cos(angle / 2), np.sinc(angle / 2 / np.pi) / 2 * x[3:])
        spin = np.append(-q[1:] @ u[3:], q[0] * u[3:] + np.cross(q[1:], u[3:])) / 2
        return np.sign(q[0]) * q, np.sign(q[0]) * spin

    return mbs.AddNode(node), quaternions


def direction(angle):
    return np.array([np.cos(angle), np.sin(angle)])


class Exudyn:
    """One mechanism, solved with a number of equal steps."""

    def __init__(self, build, system, start, span, solver="dense"):
        self.plane, self.ends = build(system, start)
        self.mbs = self.plane.mbs
        self.mbs.Assemble()
        self.span = span
        settings = exudyn.SimulationSettings()
        solution, stepping = settings.solutionSettings, settings.timeIntegration
        solution.writeSolutionToFile = False
        stepping.startTime, stepping.endTime = span
        stepping.verboseMode = 0
        stepping.generalizedAlpha.spectralRadius = RHO
        stepping.newton.relativeTolerance = 1e-6
        stepping.newton.modifiedNewtonJacUpdatePerStep = True  # faster here than its default
        if solver == "sparse":
            settings.linearSolverType = exudyn.LinearSolverType.EigenSparse
        self.settings = settings
        zero = self.mbs.systemData.GetODE2Coordinates
        self.reference = np.array(zero(exudyn.ConfigurationType.Reference))
        self.offset = np.array(start["q"]) - self.ends(self.reference, self.reference)[0]

    def run(self, steps):
        """Integrate with a number of equal steps."""
        self.settings.timeIntegration.numberOfSteps = steps
        begin = time.perf_counter()
        exudyn.SolveDynamic(self.mbs, self.settings)
        seconds = time.perf_counter() - begin
        data = self.mbs.systemData
        x = self.reference + data.GetODE2Coordinates()
        q, v = self.ends(x, np.array(data.GetODE2Coordinates_t()))
        return seconds, self.offset + q, v
