"""Cases with known solutions that ocean-tracking codes are tested with, on the grids of the tests.

Three eddies uniform in space (Fabbroni 2009), the flow around a peninsula (North, Gallego and
Petitgas 2009), Stommel's gyre, and two moving eddies. Grids, times, starts and steps are those of
the examples and tests of OceanParcels 2 and 3, in metres and seconds, and so are the errors that
these tests accept: of positions relative to their size, and of the stream function.
"""

import warnings

import numpy as np
from report import publish
from scipy.integrate import solve_ivp

import liouville as lv

DAY, HOUR, MINUTE = 86400.0, 3600.0, 60.0
CORIOLIS, SPEED, DRIFT = 1e-4, 0.3, 0.04
DECAY, SLOW = 1 / (2.89 * DAY), 1 / (28.9 * DAY)


def tracked(field, x, t1, h, t0=0.0):
    """Return the ends of tracers."""
    run = lv.ensemble(field, lv.VolumeSplitting(), t=(t0, t1), h=h, every=10**6, x=x)
    return run.x[-1]


def decaying(t, speed, drift, decay, slow):
    """Return the velocity of an inertial eddy with a mean drift, and how far they have carried."""
    f, d = CORIOLIS, CORIOLIS**2 + decay**2
    fade, angle = np.exp(-decay * t), CORIOLIS * t
    mean = drift * (-np.expm1(-slow * t) / slow if slow else t)
    own, ratio = speed - drift, decay / f
    u = drift * np.exp(-slow * t) + own * fade * np.cos(angle)
    v = -own * fade * np.sin(angle)
    x = mean + f * own / d * (ratio + fade * (np.sin(angle) - ratio * np.cos(angle)))
    y = -f * own / d * (1 - fade * (np.cos(angle) + ratio * np.sin(angle)))
    return (u, v), (x, y)


def eddy(axes, times, h, start, *rates):
    """Return the largest relative error of a position in an eddy that is uniform in space."""
    x, y = axes
    u, v = decaying(times, *rates)[0]
    shape = (times.size, x.size, y.size)
    velocity = [np.broadcast_to(each[:, None, None], shape) for each in (u, v)]
    field = lv.GriddedField(x, y, t=times, velocity=velocity)
    end = np.array(start) + decaying(times[-1], *rates)[1]
    return np.abs(tracked(field, [start], times[-1], h) / end - 1).max()


def stationary_eddy():
    nodes = np.linspace(0, 25e3, 100)
    times = np.linspace(0, 6 * HOUR, 361)
    return eddy((nodes, nodes), times, 3 * MINUTE, (12e3, 12.5e3), SPEED, 0.0, 0.0, 0.0)


def moving_eddy():
    nodes = np.linspace(0, 25e3, 100)
    times = np.linspace(0, 6 * HOUR, 361)
    return eddy((nodes, nodes), times, 3 * MINUTE, (12e3, 12.5e3), SPEED, DRIFT, 0.0, 0.0)


def decaying_eddy():
    # two nodes an axis there: splines of degree 3 take five
    axes = np.linspace(0, 20e3, 5), np.linspace(5e3, 12e3, 5)
    times = np.linspace(0, 2 * DAY, 577)
    return eddy(axes, times, 5 * MINUTE, (10e3, 10e3), SPEED, DRIFT, DECAY, SLOW)


def peninsula(refined=1, given="potential"):
    """Return the largest change of the stream function along five lines past a half circle."""
    x, y = np.linspace(1e3, 1e5, 100 * refined), np.linspace(1e3, 5e4, 50 * refined)
    middle, radius = 5e4, 0.32 * 5e4

    def stream(x, y):
        return radius**2 * y / ((x - middle) ** 2 + y**2) - y

    grid = np.meshgrid(x, y, indexing="ij")
    is_land = stream(*grid) >= 0
    if given == "potential":
        field = lv.GriddedField(x, y, potential=-stream(*grid), mask=is_land)
    else:
        along, square = grid[0] - middle, (grid[0] - middle) ** 2 + grid[1] ** 2
        u = 1 - radius**2 * (along**2 - grid[1] ** 2) / square**2
        v = -2 * radius**2 * along * grid[1] / square**2
        with warnings.catch_warnings():  # the divergence of what is cut off at the land
            warnings.simplefilter("ignore", UserWarning)
            field = lv.GriddedField(x, y, velocity=[np.where(is_land, np.nan, c) for c in (u, v)])
    start = np.column_stack([np.full(5, 3e3), np.linspace(4e3, 4.7e4, 5)])
    end = tracked(field, start, DAY, 5 * MINUTE)
    return np.abs(stream(*end.T) - stream(*start.T)).max()


def stommel_gyre():
    """Return the largest change of the scaled stream function in 600 days of Stommel's gyre."""
    size = 1e7
    layer = 1 / (11.6 * DAY) / (2e-11 * size)

    def stream(x, y):
        across = 1 - np.exp(-x / (layer * size)) - x / size
        return across * np.pi * np.sin(np.pi * y / size) * 0.05

    nodes = np.linspace(0, size, 200)
    psi = -size * stream(*np.meshgrid(nodes, nodes, indexing="ij"))
    field = lv.GriddedField(nodes, nodes, potential=psi, walls=("x", "y"))
    start = np.array([[1e4, 5e6], [1e5, 5e6]])
    end = tracked(field, start, 600 * DAY, HOUR)
    return np.abs(stream(*end.T) - stream(*start.T)).max()


EDDY_NODES = np.array([200, 350])
EDDY_AXES = np.linspace(0, 4e5, 200), np.linspace(0, 7e5, 350)


def eddy_stream(t, x, y):
    """Return the stream function of two Gaussian eddies that move by 0.1 m/s."""
    widths = [size * axis[1] for size, axis in zip(EDDY_NODES, EDDY_AXES, strict=True)]
    moved, total = 0.1 * t, 0.0
    for place, turns in ((1 / 7, 0), (3 / 7, 1)):
        right = (x + moved - 0.75 * widths[0]) / (widths[0] / 8)
        up = (y - turns * moved - place * widths[1]) / (widths[1] / 14)
        total = total + np.exp(-(right**2) - up**2)
    return 10 / CORIOLIS * total


def two_eddies():
    """Return ends of two tracers on the grid and without it, and how near they come back."""
    (x, y), days = EDDY_AXES, np.arange(8) * DAY
    psi = eddy_stream(days[:, None, None], x[:, None], y)
    field = lv.GriddedField(x, y, t=days, potential=psi)
    start = np.array([[3.3e5, 1e5], [3.3e5, 2.8e5]])
    there = tracked(field, start, DAY, 5 * MINUTE)
    back = tracked(field, there, 0.0, 5 * MINUTE, t0=DAY)

    def velocity(t, states):
        (x, y), e = states.reshape(2, 2).T, 10.0
        u = (eddy_stream(t, x, y + e) - eddy_stream(t, x, y - e)) / (2 * e)
        v = (eddy_stream(t, x - e, y) - eddy_stream(t, x + e, y)) / (2 * e)
        return np.column_stack([u, v]).ravel()

    exact = solve_ivp(velocity, (0, 7 * DAY), start.ravel(), "DOP853", rtol=1e-9, atol=1e-3)
    end = tracked(field, start, 7 * DAY, HOUR)
    return end, exact.y[:, -1].reshape(2, 2), np.abs(back / start - 1).max()


#: Each case with what the tests of Parcels accept.
CASES = {
    "stationary eddy": (stationary_eddy, 1e-5),
    "moving eddy": (moving_eddy, 1e-5),
    "decaying eddy": (decaying_eddy, 1e-2),
    "peninsula, stream function": (peninsula, 1.0),
    "peninsula, velocities": (lambda: peninsula(given="velocity"), 1.0),
    "peninsula, velocities, a quarter of the cells": (lambda: peninsula(4, given="velocity"), 1.0),
    "Stommel's gyre": (stommel_gyre, 1e-1),
    "two moving eddies, there and back": (lambda: two_eddies()[2], 1e-5),
}

if __name__ == "__main__":
    rows = [
        {"case": name, "error": f"{case():.1e}", "accepted": f"{accepted:.0e}"}
        for name, (case, accepted) in CASES.items()
    ]
    publish("ocean_cases", rows)
    for what, ends in zip(("on the grid", "without it"), two_eddies()[:2], strict=True):
        print(f"two moving eddies after a week, {what}: km", *(ends / 1e3).round(1).tolist())
