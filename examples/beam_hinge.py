"""
A beam on a hinge
=================

scikit-fem assembles a beam, clamped on its left; a constraint hinges the middle of its right end to
the ground, and a load is applied suddenly. The mesh has modes far faster than a step. With the
trapezoidal rule they oscillate on in the force of the hinge; HHT damps them and leaves the slow
vibration of the beam.
"""

import matplotlib.pyplot as plt
import numpy as np
import skfem

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

LENGTH, HEIGHT, LOAD = 1.0, 0.05, 1e5  # m, m, N per metre of width

sides = {
    "left": lambda x: x[0] == 0,
    "tip": lambda x: (x[0] == LENGTH) & (abs(x[1]) < 1e-9),
    "middle": lambda x: (abs(x[0] - LENGTH / 2) < 1e-9) & (x[1] == HEIGHT / 2),
}
x, y = np.linspace(0, LENGTH, 41), np.linspace(-HEIGHT / 2, HEIGHT / 2, 5)
basis = skfem.Basis(
    skfem.MeshQuad.init_tensor(x, y), skfem.ElementVector(skfem.ElementQuad2())
)
nodes = {
    name: basis.get_dofs(nodes=basis.mesh.nodes_satisfying(at))
    for name, at in sides.items()
}
left = basis.get_dofs(basis.mesh.facets_satisfying(sides["left"], boundaries_only=True))

body = lv.fem.Body.elastic(basis, young=210e9, poisson=0.0, density=7800.0, clamped=left)
along, across = body.at(nodes["tip"])
(loaded,) = body.at(nodes["middle"].all("u^2"))

# %%
# The hinge is a constraint on both displacements of a node, and the load a force on one of another.


def hinge(t, q, params):
    return {"along": q[along], "across": q[across]}


def load(t, q, v, params):
    return {body.names[loaded]: -params.load}


beam = body.structure(force=load, constraint=hinge, params={"load": LOAD})
beam

# %%
# From rest, with the trapezoidal rule and with HHT.

rest = np.zeros(len(body.names))
runs = {
    name: lv.integrate(beam, method, t=(0.0, 0.02), h=1e-4, q=rest, v=rest)
    for name, method in {
        "trapezoidal rule": lv.HHT(alpha=0.0),
        "HHT": lv.HHT(alpha=-0.3),
    }.items()
}

# %%
# At rest, a beam clamped and hinged at its ends carries 5/16 of a load in its middle on the hinge.

fig, ax = plt.subplots()
for name, run in runs.items():
    ax.plot(1e3 * run.t, -1e-3 * run.lam[:, 1], lw=1, label=name)
ax.axhline(1e-3 * LOAD * 5 / 16, color="gray", ls=":", label="at rest")
ax.set(xlabel="time / ms", ylabel="force of the hinge / kN")
fig.legend(ncols=3, loc="outside upper left")
plt.show()

# %%
# The beam bends in the first 5 ms, dark to light.

line = basis.get_dofs(nodes=basis.mesh.nodes_satisfying(lambda x: abs(x[1]) < 1e-9)).all(
    "u^2"
)
line = line[np.argsort(basis.doflocs[0, line])]
swing = runs["HHT"]

fig, ax = plt.subplots()
for i in range(0, 60, 10):
    bent = body.values(swing.q[i])[line]
    label = f"{1e3 * swing.t[i]:.0f} ms"
    ax.plot(basis.doflocs[0, line], 1e3 * bent, color=plt.cm.viridis(i / 60), label=label)
ax.set(xlabel="x / m", ylabel="deflection / mm")
fig.legend(ncols=6, loc="outside upper left")
plt.show()
