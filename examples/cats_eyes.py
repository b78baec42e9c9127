"""
Cat's eyes in a shear layer
===========================

A shear layer rolls up into a row of vortices, and Stuart's stream function is an exact flow of that
kind. While it is steady, fluid turns in the eyes or flows past them. A small wave that passes over
the row mixes the fluid at the rims of the eyes. The stream function is no polynomial and is on no
grid: a ``PotentialField`` takes it as it stands.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# Stuart's vortices with periodic cores at x = pi, and a wave of the size ``wave``.


def psi(t, x, params):
    layer = ca.log(ca.cosh(x[1]) + params.eccentricity * ca.cos(x[0]))
    return layer + params.wave * ca.sin(x[0] - t) / ca.cosh(x[1])


field = lv.PotentialField(psi, x=("x", "y"), params={"eccentricity": 0.5, "wave": 0.0})
field

# %%
# Where tracers are once a period of the wave, without it and with it.

start = np.column_stack([np.full(24, np.pi), np.linspace(0.05, 2.4, 24)])
sections = [
    lv.section(
        field,
        lv.VolumeSplitting(),
        t=(0, 300 * 2 * np.pi),
        h=np.pi / 16,
        plane="t",
        period=2 * np.pi,
        x=start,
        params={"wave": wave},
    )
    for wave in (0.0, 0.03)
]
sections[1]

# %%
# Without the wave they stay on streamlines, and with it those at the rim wander from eye to eye.

fig, axes = plt.subplots(2, 1, sharex=True, figsize=(6.0, 5.5))
for ax, section in zip(axes, sections, strict=True):
    for member in range(len(start)):
        own = section.x[section.member == member]
        ax.plot(own[:, 0] % (2 * np.pi), own[:, 1], ".", markersize=1.0)
    ax.set(ylabel="y", ylim=(-2.5, 2.5))
axes[1].set(xlabel="x")
plt.show()
