"""OpenMM's Reference platform on the library's polymer: the same beads, bonds, angles and trap.

Its units are nm, ps and u, in which the model's are one each. Two integrators: its own leapfrog, which
constrains positions once a step, and velocity Verlet with both constraints, which is RATTLE,
written in its integrator language. The platform is plain C++ in double precision on one thread.
"""

import time

import numpy as np
import openmm


def integrator(kind: str, h: float) -> openmm.Integrator:
    """Return "leapfrog" or "rattle"."""
    if kind == "leapfrog":
        return openmm.VerletIntegrator(h)
    rattle = openmm.CustomIntegrator(h)
    rattle.addPerDofVariable("before", 0)
    rattle.addUpdateContextState()
    rattle.addComputePerDof("v", "v + 0.5 * dt * f / m")
    rattle.addComputePerDof("before", "x")
    rattle.addComputePerDof("x", "x + dt * v")
    rattle.addComputePerDof("before", "x - 0 * before")
    rattle.addConstrainPositions()
    rattle.addComputePerDof("v", "v + 0.5 * dt * f / m + (x - before) / dt")
    rattle.addConstrainVelocities()
    return rattle


class Polymer:
    """A polymer in a context of its own; ``run(steps)`` returns seconds."""

    def __init__(self, params, start, h, tolerance, kind="leapfrog", forces=True):
        beads = len(start["q"]) // 3
        system = openmm.System()
        for _ in range(beads):
            system.addParticle(params["m"])
        for i in range(beads - 1):
            system.addConstraint(i, i + 1, params["l"])
        if forces:
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
        moving = integrator(kind, h)
        moving.setConstraintTolerance(tolerance)
        platform = openmm.Platform.getPlatformByName("Reference")
        self._context = openmm.Context(system, moving, platform)
        self._context.setPositions(np.reshape(start["q"], (-1, 3)))
        self._context.setVelocities(np.reshape(start["v"], (-1, 3)))
        self._integrator = moving

    def run(self, steps):
        """Make some steps; return how long they took."""
        begin = time.perf_counter()
        self._integrator.step(steps)
        return time.perf_counter() - begin

    def energy(self):
        """Return kinetic and potential energy."""
        state = self._context.getState(energy=True)
        return sum(
            x.value_in_unit(openmm.unit.kilojoule_per_mole)
            for x in (state.getKineticEnergy(), state.getPotentialEnergy())
        )
