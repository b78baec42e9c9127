"""OpenMM's Reference platform on the library's polymer: the same beads, bonds, angles and trap.

Its units are nm, ps and u, in which the model's are one each. Two integrators: its own leapfrog,
which constrains positions once a step, and velocity Verlet with both constraints, which is RATTLE,
in its integrator language. The platform is plain C++ in double precision on one thread.
"""

import time

import numpy as np
import openmm

INTEGRATORS = ("leapfrog", "RATTLE")


def integrator(kind, h):
    """Return one of its integrators."""
    if kind == "leapfrog":
        return openmm.VerletIntegrator(h)
    rattle = openmm.CustomIntegrator(h)
    rattle.addPerDofVariable("free", 0)
    rattle.addUpdateContextState()
    rattle.addComputePerDof("v", "v + 0.5 * dt * f / m")
    rattle.addComputePerDof("x", "x + dt * v")
    rattle.addComputePerDof("free", "x")
    rattle.addConstrainPositions()
    rattle.addComputePerDof("v", "v + 0.5 * dt * f / m + (x - free) / dt")
    rattle.addConstrainVelocities()
    return rattle


class Polymer:
    """A polymer in a context of its own."""

    def __init__(self, params, start, h, tolerance, kind):
        beads, system = len(start["q"]) // 3, openmm.System()
        for _ in range(beads):
            system.addParticle(params["m"])
        for i in range(beads - 1):
            system.addConstraint(i, i + 1, params["l"])
        angles = openmm.CustomAngleForce("0.5 * k * (cos(theta) + c)^2")
        trap = openmm.CustomExternalForce("0.5 * a * (x*x + y*y + z*z)")
        for force, names in ((angles, "kc"), (trap, "a")):
            for name in names:
                force.addGlobalParameter(name, params[name])
            system.addForce(force)
        for i in range(beads - 2):
            angles.addAngle(i, i + 1, i + 2, [])
        for i in range(beads):
            trap.addParticle(i, [])
        self._integrator = integrator(kind, h)
        self._integrator.setConstraintTolerance(tolerance)
        platform = openmm.Platform.getPlatformByName("Reference")
        self._context = openmm.Context(system, self._integrator, platform)
        self._context.setPositions(np.reshape(start["q"], (-1, 3)))
        self._context.setVelocities(np.reshape(start["v"], (-1, 3)))

    def run(self, steps):
        """Make some steps; return the seconds they took."""
        begin = time.process_time()
        self._integrator.step(steps)
        return time.process_time() - begin

    def stretch(self):
        """Return the largest relative error of a bond's length."""
        places = self._context.getState(positions=True).getPositions(asNumpy=True)
        bonds = np.diff(np.asarray(places.value_in_unit(openmm.unit.nanometer)), axis=0)
        return float(np.abs(np.linalg.norm(bonds, axis=1) - 1).max())
