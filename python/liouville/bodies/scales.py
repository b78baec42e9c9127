"""Units of a mechanism: its coordinates and constraints are lengths or angles.

A search compares them with each other and with limits, so that it measures lengths in a unit of the
mechanism's own: a power of 1024, one for sizes from three centimetres to thirty metres in metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from liouville._systems.mechanics.singular import unit
from liouville.bodies.body import PARTS
from liouville.bodies.joints import MOTION
from liouville.bodies.turns import row_name

if TYPE_CHECKING:
    from liouville.bodies.mechanism import Mechanism

Array = NDArray[np.float64]

#: Rows of joints, after their names, that are lengths, and those that are angles.
LENGTHS = ("x", "y", "z", "off_x", "off_y", "off_z", "thread", "length", "height")
ANGLES = ("tilt_x", "tilt_y", "lock_x", "lock_y", "lock_z", "cross")
#: Gradients below this part of the largest are roundoff.
ROUNDOFF = 1e-12


def size_of(system: Mechanism, params: Array) -> float:
    """Return the size of a mechanism: the largest distance of its centres of mass and points."""
    still = np.zeros(len(system.coordinates))
    drawn, points = (
        system.output(name, params, 0.0, still, still)[0] for name in ("drawn", "points")
    )
    centres = np.append(drawn.reshape(-1, 3), np.zeros((1, 3)), axis=0)  # the ground's is last
    return float(max(np.ptp(centres, axis=0).max(), np.abs(points).max(initial=0.0))) or 1.0


def length_of(size: float) -> float:
    """Return the unit of length of a mechanism of some size."""
    return float(1 / unit(np.array(size)))


def of_coordinates(system: Mechanism, length: float) -> Array:
    """Return the unit of each coordinate."""
    layout, units = system.body_layout, []
    for kind in layout.kinds:
        units += [length if part in ("x", "y", "z") else 1.0 for part in PARTS[kind]]
    for name in layout.own:
        units += [1.0 if turns else length for turns, _ in system.place(name).axes]
    return np.array(units + [1.0] * len(layout.counted))


def of_rows(system: Mechanism, length: float, sizes: Array) -> Array:
    """Return the unit of each holonomic constraint.

    Of guides, couplings and motions it is that of `sizes`, shape (m,): how much the constraints
    change at most by coordinates or moves, each in its unit.
    """
    known = {f"{name}.unit": 1.0 for name in system.bodies}
    known |= {row_name(*angle): 1.0 for angle in system.body_layout.counted}
    for name in system.joints:
        for row in system.place(name).rows:
            what = row.removeprefix(f"{name}.")
            if MOTION not in row and what in (*LENGTHS, *ANGLES):
                known[row] = length if what in LENGTHS else 1.0
    found = 1 / unit(np.where(sizes > ROUNDOFF * sizes.max(initial=0.0), sizes, 0.0))
    names = system.holonomic
    return np.array([known.get(name, x) for name, x in zip(names, found, strict=True)])
