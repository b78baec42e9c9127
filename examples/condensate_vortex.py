"""
A vortex in a condensate
========================

A rotating condensate carries its angular momentum in vortices: points where the density vanishes
and the phase winds once. One that is off the centre of a trap goes around it, in the sense of its
winding. The equation of Gross and Pitaevskii has a potential g times the density, whose flow is
exact, so the split operator keeps the norm, and the energy stays within a narrow band.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)
grid = lv.Grid(
    (-9, -9), (9, 9), (96, 96), potential=lambda t, x, params: (x[0] ** 2 + x[1] ** 2) / 2
)
condensate = lv.Schrodinger(
    grid, nonlinearity=lambda t, rho, params: params.g * rho, params={"g": 400.0}
)
ground = lv.analysis.ground_state(condensate)
ground

# %%
# Lengths are those of the trap, and times its inverse frequency. The vortex is written into the
# ground state: a phase that winds about a point, and a hole as wide as the healing length.

x, y = grid.points.T
mu = ground.chemical_potential
z = x - 1.5 + 1j * y
psi = ground.psi * z / np.sqrt(np.abs(z) ** 2 + 1 / mu)
psi /= np.linalg.norm(psi)
solution = lv.integrate(
    condensate, lv.SplitOperator("RKN6s11"), t=(0, 24), h=0.04, every=25, psi=psi
)
solution

# %%
# The density at four times: a small hole goes around, and sound that its making left behind.

fig, axes = plt.subplots(1, 4, figsize=(9, 2.6), sharey=True)
for ax, k in zip(axes, (0, 8, 16, 24), strict=True):
    density = np.abs(solution.psi_on_grid[k]) ** 2 / grid.cell
    ax.imshow(density.T, origin="lower", extent=(-9, 9, -9, 9), cmap="viridis")
    ax.set(title=f"t = {solution.t[k]:g}", xlim=(-6, 6), ylim=(-6, 6))
plt.show()

# %%
# Its place is where real and imaginary part vanish, between the points of the grid. In a trap of
# the radius R it goes around with the frequency ln(2^(3/2) pi mu) / (R^2 - r^2), for a strong
# interaction (Navarro et al., Phys. Rev. Lett. 110 (2013) 225301).


def place(psi):
    """Return where a plane through the points about the deepest hole is zero."""
    near = np.hypot(x, y) < 3.5
    centre = np.argmin(np.where(near, np.abs(psi), np.inf))
    around = np.hypot(x - x[centre], y - y[centre]) < 0.3
    columns = np.column_stack([np.ones(around.sum()), x[around], y[around]])
    value, by_x, by_y = np.linalg.lstsq(columns, psi[around], rcond=None)[0]
    slopes = np.array([[by_x.real, by_y.real], [by_x.imag, by_y.imag]])
    return np.linalg.solve(slopes, [-value.real, -value.imag])


places = np.array([place(each) for each in solution.psi])
angle = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
frequency = np.polyfit(solution.t, angle, 1)[0]
radius2 = 2 * mu
formula = np.log(2**1.5 * np.pi * mu) / (
    radius2 - np.mean(places[:, 0] ** 2 + places[:, 1] ** 2)
)
print(f"frequency {frequency:.4f}, formula {formula:.4f}")

fig, ax = plt.subplots()
ax.plot(places[:, 0], places[:, 1], "o-")
ax.add_patch(plt.Circle((0, 0), np.sqrt(radius2), fill=False))
ax.set(aspect="equal", xlabel="x", ylabel="y", title="path of the vortex in the trap")
plt.show()

# %%
# What is conserved: the norm to roundoff, the energy to the error of the method.

for name, values in solution.invariants.items():
    print(f"{name}: {values[0]:.6f}, moved by {np.ptp(values) / values[0]:.1e}")
