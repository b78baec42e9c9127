"""
A model of SymPy
================

An engine's crank and piston, written down with SymPy: its object becomes a system as it is, with
the constraint that SymPy leaves to the integrator.
"""

import matplotlib.pyplot as plt
import numpy as np
import sympy
from sympy.physics.mechanics import LagrangesMethod, ReferenceFrame, dynamicsymbols

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

turn, way = dynamicsymbols("turn way")
t, inertia, mass, crank, rod, gas = dynamicsymbols._t, *sympy.symbols("I m r l F")

# %%
# The rod without mass keeps crank pin and piston at its length.

energy = (inertia * turn.diff(t) ** 2 + mass * way.diff(t) ** 2) / 2
length = (way - crank * sympy.cos(turn)) ** 2 + (crank * sympy.sin(turn)) ** 2 - rod**2
frame = ReferenceFrame("N")
engine = LagrangesMethod(
    energy - gas * way, [turn, way], hol_coneqs=[length], frame=frame
)

numbers = {"I": 0.02, "m": 0.5, "r": 0.05, "l": 0.15, "F": 40.0}
system = lv.from_sympy(engine, params=numbers)
start = system.consistent(q=[0.5, 0.19], v=[60.0, 0.0])
solution = lv.integrate(system, lv.Spark(4), t=(0, 0.4), h=1e-3, **start)
print(solution)

# %%
# The force in the rod is its multiplier times twice its length.

fig, (left, right) = plt.subplots(1, 2)
left.plot(np.degrees(solution.q[:, 0]), solution.v[:, 0])
left.set(xlabel="angle of the crank / degrees", ylabel="its rate / (rad/s)")
right.plot(solution.t, 2 * numbers["l"] * solution.lam[:, 0])
right.set(xlabel="time / s", ylabel="force in the rod / N")
plt.show()
