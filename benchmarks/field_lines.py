"""Field lines of a stellarator-like field by its potential, beside the classical RK4.

The field has a toroidal part that falls as 1/R and a flux that turns five times around the axis,
so that lines lie on nested tubes without any current in the plasma. For each line: by how much the
tube of the last third of its passages is wider than that of the first, as a part of the radius, and
how far passages are from a smooth curve. Both methods take about 63 steps a turn.
"""

import argparse

import casadi as ca
import numpy as np

import liouville as lv

STEPS, ORDER = 63, 7


def flux(t, x, params):
    """Return A in the coordinates q = R^2/2, phi, Z."""
    q, phi, z = ca.vertsplit(x)
    across = ca.sqrt(2 * q) - 1
    turning = (across**2 - z**2) * ca.cos(5 * phi) + 2 * across * z * ca.sin(5 * phi)
    return {"phi": turning / 2, "Z": -ca.log(2 * q) / 2}


def wider(q, z):
    """Return the change of a tube's radius, and the distance of points from a smooth curve."""
    across = np.sqrt(2 * q) - 1
    angle, radius, third = np.arctan2(z, across), np.hypot(across, z), len(q) // 3
    waves = [f(k * angle) for k in range(1, ORDER + 1) for f in (np.cos, np.sin)]
    columns = np.column_stack([np.ones_like(angle), *waves])
    curve = np.linalg.lstsq(columns[:third], radius[:third], rcond=None)[0]
    apart = (radius - columns @ curve) / radius
    return apart[-third:].mean(), apart[:third].std()


def passages(field, start, turns):
    """Return q and Z of each turn by RK4 in phi, of shape (turns, lines)."""

    def rate(phi, y):
        q, z = y
        v = field.velocity(np.stack([q, np.full_like(q, phi), z], axis=-1))
        return np.array([v[:, 0], v[:, 2]]) / v[:, 1]

    y, found, h = start[:, [0, 2]].T, [], 2 * np.pi / STEPS
    for _ in range(turns):
        for k in range(STEPS):
            k1 = rate(k * h, y)
            k2 = rate((k + 0.5) * h, y + h / 2 * k1)
            k3 = rate((k + 0.5) * h, y + h / 2 * k2)
            k4 = rate((k + 1) * h, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        found.append(y)
    return np.array(found).swapaxes(0, 1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--end", type=float, default=3e3)
    end = parser.parse_args().end
    field = lv.PotentialField(flux, x=("q", "phi", "Z"))
    start = np.array([[(1 + a) ** 2 / 2, 0.0, 0.0] for a in (0.04, 0.08, 0.12)])
    section = lv.section(
        field, lv.VolumeSplitting(), t=(0, end), h=0.1, plane="phi", period=2 * np.pi, x=start
    )
    q, z = passages(field, start, len(section.x) // len(start))
    for line in range(len(start)):
        own = section.x[section.member == line]
        print("BM4", line, *(f"{value:9.1e}" for value in wider(own[:, 0], own[:, 2])))
        print(
            "RK4", line, *(f"{value:9.1e}" for value in wider(q[:, line], z[:, line])), flush=True
        )
