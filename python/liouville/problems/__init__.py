"""The library of test problems, one module each: a system, its start, and what should come out.

Every module has

``system``
    the system, see :doc:`/api/systems`;
``start``, ``interval``, ``h``
    start values by name, the times to begin and end at, a sensible step: of a mechanical system for
    ``Spark(stages=3)``, which a method of order 2 takes eighths of, and of a polynomial field for
    ``VolumeSplitting(composition="BM4")``;
``conserved``
    names of the invariants that are constant along the motion;
``reference``
    states at some times, ``{time: {"q": ..., "v": ...}}`` or ``{time: {"x": ...}}``, exact to the
    digits given;
``source``
    where the problem and the reference come from;

of a Schrödinger equation instead of `h`, ``tol``, a sensible tolerance, and references
``{time: {"psi": ...}}``, of a grid with a closed form whole states, else a dict of some components;
where it is a mechanism that is not made by :mod:`liouville.bodies`, ``outline(q, params)``: the
polylines of its bodies, in the plane or in space, with parameters ``params.name`` as a model's
functions see them;
and, where the number of coordinates is free, ``build`` and ``start_for``: the system and its start
for any.

Examples
--------
>>> from liouville.problems import load
>>> load("pendulum").start
{'q': (1.0, 0.0), 'v': (0.0, 0.0)}
"""

from importlib import import_module
from types import ModuleType
from typing import Protocol

import casadi as ca

from liouville._basics.errors import hinted, meant

#: The mechanical systems with holonomic constraints.
MECHANICAL = (
    "pendulum",
    "spherical_pendulum",
    "double_pendulum",
    "chain",
    "polymer",
    "rigid_chain",
    "slider_crank",
    "car_axis",
    "andrews",
    "heavy_top",
    "moving_wire",
    "relativistic_particle",
    "circular_track",
    "fekete",
    "kepler_on_sphere",
)

#: Those made of bodies and joints, by :mod:`liouville.bodies`.
ASSEMBLED = (
    "four_bars",
    "jansen_leg",
    "spatial_slider_crank",
    "flyball_governor",
    "stewart_platform",
)

#: Those some of whose constraints are redundant.
REDUNDANT = ("doubled_rod", "hinged_fourbar", "bricard")

#: Those with nonholonomic constraints.
NONHOLONOMIC = ("knife_edge", "rolling_disk", "chaplygin_sleigh", "rolling_ball")

#: Those with contacts.
CONTACTS = ("belt", "ladder", "rocking_block")

#: The polynomial fields without divergence.
FIELDS = (
    "euler_top",
    "bajer_moffatt",
    "hill_vortex",
    "abc_flow",
    "maxwell_bloch",
    "cubic_charge",
    "volterra_lattice",
    "toda_lattice",
    "lorenz96",
    "sabra",
    "euler2d",
)

#: The Schrödinger equations.
QUANTUM = (
    "harmonic_oscillator",
    "poschl_teller",
    "walker_preston",
    "tight_binding",
    "heisenberg",
    "lattice2d",
    "lattice3d",
)

NAMES = (*MECHANICAL, *ASSEMBLED, *REDUNDANT, *NONHOLONOMIC, *CONTACTS, *FIELDS, *QUANTUM)


class Parameters(Protocol):
    """The ``params`` of a model function: the symbol of each parameter under its name."""

    def __getattr__(self, name: str) -> ca.SX:
        """Return the parameter's symbol, a scalar or a column."""


def names() -> tuple[str, ...]:
    """Return the names of all problems: mechanical systems, fields, then Schrödinger equations."""
    return NAMES


def load(name: str) -> ModuleType:
    """Import a problem by its name.

    Parameters
    ----------
    name : str
        One of :func:`names`.

    Returns
    -------
    module
        The problem's module, with the attributes listed above.

    Raises
    ------
    TypeError, ValueError
        There is no problem of that name; the message has the nearest one, or all.
    """
    if not isinstance(name, str):
        raise TypeError(f"name must be that of a problem, such as 'pendulum', not {name!r}")
    if name not in NAMES:
        raise ValueError(hinted(f"no problem is called {name!r}", meant(name, NAMES)))
    return import_module(f"{__name__}.{name}")


def __getattr__(name: str) -> ModuleType:
    """Import a problem when it is first used as ``lv.problems.pendulum``."""
    if name in NAMES:
        return load(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the problems, and the functions that find them."""
    return sorted([*NAMES, "load", "names"])
