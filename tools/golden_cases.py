"""The cases of the golden end states: every problem of the library, by every public method.

Some problems are of this file: a Hamiltonian, a reaction and a momentum that are not linear, a
structure, and a system of index 2. A case is named ``problem / method / how``, and how is
``single``, ``ensemble``, ``rtol`` or ``reversible``, or ``gradient``: the tangent of a shorter run,
in one direction of all that it depends on, and the pullback of one cotangent of its end to that.

A start that NumPy or LAPACK makes depends on the processor by roundings: where only the start does,
it is read from ``tests/data/golden_starts.json``, as hexadecimal floats.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import liouville as lv
from liouville import problems
from liouville._methods.composition import SCHEMES

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"

#: Steps of a run, and members of an ensemble: no multiple of any number of lanes.
STEPS, MEMBERS = 12, 5

#: Steps of a run that is differentiated.
FEW = 4

GENERAL = (
    *(lv.Spark(s) for s in (1, 2, 3, 4)),
    *(lv.Spark(3, solver) for solver in ("node-schur", "newton")),
    *(lv.Spark(s, points="radau") for s in (2, 3)),
    *(lv.LobattoPair(s) for s in (2, 3, 4)),
    *(lv.LobattoPair(3, force) for force in ("A", "C", "C*", "D")),
    *(lv.LobattoPair(2, solver=solver) for solver in ("node-schur", "newton")),
    lv.Composition(lv.Spark(1), "SU4"),
    lv.Composition(lv.LobattoPair(2), "SS6s11"),
)
ALPHA = (
    lv.HHT(),
    lv.HHT(-0.3, b=1.0),
    lv.HHT(less_implicit=True),
    lv.GeneralizedAlpha(),
    lv.GeneralizedAlpha(0.5, less_implicit=True),
    lv.ArnoldBruls(),
)
CONTROLLED = (lv.Spark(2), lv.Spark(3), lv.LobattoPair(2), lv.LobattoPair(3), lv.HHT(),
              lv.GeneralizedAlpha(), lv.ArnoldBruls())  # fmt: skip
REVERSIBLE = (lv.Spark(1), lv.Spark(3), lv.LobattoPair(2))
INDEX2 = (
    *(lv.Spark(s) for s in (1, 2, 3, 4)),
    *(lv.Spark(2, solver) for solver in ("node-schur", "newton")),
    lv.Composition(lv.Spark(1), "SU4"),
)
FIELD = (
    *(lv.VolumeSplitting(composition=name) for name in SCHEMES),
    *(
        lv.VolumeSplitting(diagonal=pieces, composition="S2")
        for pieces in ("shears", "exponentials", "regular", "n+d")
    ),
    lv.VolumeSplitting(off_diagonal="natural", composition="BM4", compensated=True),
    *(
        lv.VolumeSplitting(off_diagonal="triangular", composition="S2", runge_kutta=name)
        for name in ("euler", "midpoint", "heun", "kutta3", "rk4")
    ),
    *(lv.VolumeSplitting(linear=way, composition="BM4") for way in ("split", "exact")),
)
WAVE = (
    *(lv.SchrodingerSplitting(1e-8, mode) for mode in ("auto", "fast", "stable")),
    lv.SchrodingerSplitting(1e-12),
    lv.Chebyshev(1e-10),
    lv.Lanczos(1e-10),
)
WAVE_STEPPED = (
    *(lv.SplitOperator(scheme) for scheme in ("S2", "BM4", "RKN4s6", "BM6", "RKN6s11")),
    *(lv.Magnus(order) for order in (2, 4)),
    lv.StabilitySplitting(4, 8),
    lv.StabilitySplitting(4, 2, processed=False),
    *(lv.GrayManolopoulos(order) for order in (2, 6)),
)


@dataclass(frozen=True)
class Setting:
    """A system with its start and a step of a method of high order."""

    system: Any
    start: Mapping[str, Any]
    t0: float
    h: float


@dataclass(frozen=True)
class Case:
    """A run of a few steps."""

    problem: str
    method: Any
    how: str

    def __str__(self) -> str:
        """Name it by what is not as by default."""
        return f"{self.problem} / {spelled(self.method)} / {self.how}"


def spelled(method: Any) -> str:
    """Return what makes a method, without what is as by default."""
    parts = []
    for f in fields(method):
        value = getattr(method, f.name)
        if f.default is MISSING or value != f.default:
            is_method = hasattr(value, "form")
            parts.append(f"{f.name}={spelled(value) if is_method else repr(value)}")
    return f"{type(method).__name__}({', '.join(parts)})"


def hamiltonian() -> Setting:
    """Return a spherical pendulum in a rotating frame, given by its Hamiltonian."""
    system = lv.Hamiltonian(
        lambda t, q, p, params: ca.dot(p, p) / 2 - (q[0] * p[1] - q[1] * p[0]) / 4 + q[2],
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=("x", "y", "z"),
    )
    return Setting(system, {"q": (0.6, 0.0, -0.8), "p": (0.0, 1.25, 0.0)}, 0.0, 0.05)


def nonlinear_reaction() -> Setting:
    """Return a charged bob whose reaction and momentum are not linear, from a time not zero."""
    system = lv.Mechanical(
        velocity=lambda t, y, z, params: z,
        momentum=lambda t, y, z, params: z * (1 + ca.dot(z, z) / 4),
        force=lambda t, y, z, params: ca.vertcat(z[1], -z[0], -1 + ca.sin(t) / 2),
        reaction=lambda t, y, lam, params: -y * (lam + lam**3 / 10),
        constraint=lambda t, y, params: (ca.dot(y, y) - 1) / 2,
        y=("x", "y", "z"),
    )
    return Setting(system, {"y": (0.6, 0.0, -0.8), "z": (0.0, 1.25, 0.0)}, 0.5, 0.05)


def structure() -> Setting:
    """Return three masses on springs, the last on a wall that gives way by a joint."""
    system = lv.Structure(
        mass=np.diag([1.0, 2.0, 1.5]),
        damping=np.diag([0.1, 0.0, 0.2]),
        stiffness=np.array([[30.0, -10.0, 0.0], [-10.0, 20.0, -10.0], [0.0, -10.0, 10.0]]),
        constraint=lambda t, q, params: q[2] - ca.sin(q[1]) / 2,
        q=("u", "v", "w"),
    )
    return Setting(system, {"q": (0.25, 0.0, 0.0), "v": (0.5, 0.0, 0.0)}, 0.0, 0.05)


def index2() -> Setting:
    """Return a vector that turns, with its first component prescribed, at index 2."""
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: ca.cross(
            ca.vertcat(ca.sin(3 * t) / 5, z[0], (1 + z[0] ** 2) / 2), y
        ),
        constraint=lambda t, y, params: y[0] - ca.sin(2 * t) / 4,
        y=3,
        z=1,
    )
    return Setting(system, {"y": (0.0, 0.0, 1.0), "z": (0.5,)}, 0.0, 0.05)


#: What differs between the members of an ensemble that start at rest, or whose constraints say how
#: fast they move: a parameter that no constraint contains.
VARIED = {
    "pendulum": "g",
    "double_pendulum": "m2",
    "fekete": "alpha",
    "car_axis": "M",
    "moving_wire": "g",
    "rolling_ball": "J",
}

#: More variables take the n + d shears long to plan.
MOST_VARIABLES = 3

OWN = {
    "own hamiltonian": hamiltonian,
    "own nonlinear reaction": nonlinear_reaction,
    "own structure": structure,
    "own index 2": index2,
}
MECHANICS = (*problems.MECHANICAL, *problems.REDUNDANT, *problems.NONHOLONOMIC, *list(OWN)[:3])
# Assemblies are Lagrangians as the others, and take longer; contacts are stretches of them.
LEFT_OUT = (*problems.ASSEMBLED, *problems.CONTACTS)
NAMES = (*(name for name in problems.names() if name not in LEFT_OUT), *OWN)


@cache
def setting(problem: str) -> Setting:
    """Return a problem of the library, or one of this file."""
    if problem in OWN:
        return OWN[problem]()
    found = problems.load(problem)
    t0, t1 = found.interval
    start = stored_starts().get(problem, found.start)
    return Setting(found.system, start, t0, getattr(found, "h", (t1 - t0) / 512))


@cache
def stored_starts() -> dict[str, dict[str, np.ndarray]]:
    """Read the starts that are stored."""
    lines = json.loads((DATA / "golden_starts.json").read_text(encoding="utf-8"))
    return {
        problem: {name: np.array([*map(float.fromhex, row.split())]) for name, row in start.items()}
        for problem, start in lines.items()
    }


def cases(problem: str) -> Iterator[Case]:
    """List what is run of a problem."""
    if problem in MECHANICS:
        yield from (Case(problem, method, "single") for method in (*GENERAL, *ALPHA))
        yield from (Case(problem, method, "ensemble") for method in (*GENERAL, *ALPHA))
        yield from (Case(problem, method, "rtol") for method in CONTROLLED)
        yield from (Case(problem, method, "reversible") for method in REVERSIBLE)
        yield from (Case(problem, method, "gradient") for method in (*GENERAL, *ALPHA))
    elif problem in problems.FIELDS:
        methods = [m for m in FIELD if m.diagonal != "n+d" or variables(problem) <= MOST_VARIABLES]
        yield from (Case(problem, m, how) for m in methods for how in ("single", "ensemble"))
        yield from (Case(problem, m, "gradient") for m in methods[len(SCHEMES) :])
    elif problem in problems.QUANTUM:
        methods = (*WAVE, *WAVE_STEPPED)
        yield from (Case(problem, m, how) for how in ("single", "ensemble") for m in methods)
    else:
        hows = ("single", "gradient")
        yield from (Case(problem, method, how) for method in INDEX2 for how in hows)


def variables(problem: str) -> int:
    """Return the number of variables of a field."""
    return len(setting(problem).system.coordinates)


def varied(problem: str) -> dict[str, Any]:
    """Return starts and parameters of an ensemble, the first member's those of the problem.

    Velocities are scaled where the constraints allow it, fields start at points nearby, and wave
    functions are mixed with what they are from the other end.
    """
    place = setting(problem)
    start = {name: np.asarray(x) for name, x in place.start.items()}
    scale = 1 - np.arange(MEMBERS)[:, None] / 16
    if problem in VARIED:
        name = VARIED[problem]
        return {**start, "params": {name: scale[:, 0] * place.system.params[name]}}
    if "psi" in start:
        psi = start["psi"] + 1j * (1 - scale) * start["psi"][::-1]
        return {"psi": psi / np.sqrt(np.sum(np.abs(psi) ** 2, axis=1, keepdims=True))}
    if "x" in start:
        return {"x": scale * start["x"]}
    *_, moving = start
    return {**start, moving: scale * start[moving]}


def length(case: Case) -> float:
    """Return the step: an eighth for a method of order 2."""
    order = getattr(case.method, "order", None)
    return setting(case.problem).h / (8 if order is not None and order <= 2 else 1)


@cache
def plan(problem: str, method: Any) -> Any:
    """Plan the pieces of a field once, for all compositions, single runs and ensembles."""
    place = setting(problem)
    return lv.plan(place.system, method, h=place.h, **place.start)


def planned(case: Case) -> Any:
    """Return what integrates a case: a plan for a field, else its method."""
    if not isinstance(case.method, lv.VolumeSplitting):
        return case.method
    found = plan(case.problem, replace(case.method, composition="S2", compensated=False))
    kept = {"composition": case.method.composition, "compensated": case.method.compensated}
    return replace(found, method=replace(found.method, **kept))


def run(case: Case) -> Any:
    """Integrate a case: with `planned`, the place where calls of the library are spelled."""
    place, h = setting(case.problem), length(case)
    until: dict[str, Any] = {"t": (place.t0, place.t0 + STEPS * h)}
    if not isinstance(case.method, lv.Chebyshev | lv.Lanczos | lv.SchrodingerSplitting):
        until |= {"steps": STEPS, "every": STEPS}
    if case.how == "ensemble":
        return lv.ensemble(place.system, planned(case), threads=2, **until, **varied(case.problem))
    if case.how == "rtol":
        end = place.t0 + 6 * h
        until = {"t": (place.t0, end), "rtol": 1e-4, "control": lv.Adaptive()}
    elif case.how == "reversible":
        until = {"t": (place.t0, place.t0 + STEPS * h), "h": h, "control": lv.Reversible()}
    return lv.integrate(place.system, planned(case), **until, **place.start)


def differentiated(case: Case) -> dict[str, np.ndarray]:
    """Return the tangent of a run at its end, and the pullback of a cotangent there."""
    place, method, h = setting(case.problem), planned(case), length(case)
    run = {"t": (place.t0, place.t0 + FEW * h), "steps": FEW, "every": FEW, **place.start}
    params = place.system.params
    sizes = {name: np.shape(place.start[name]) for name in place.start if name != "z"}
    sizes |= {f"params.{name}": np.shape(value) for name, value in params.items()}
    along = {name: waves(size, k) for k, (name, size) in enumerate(sizes.items())}
    along["t1"] = np.array(h)
    solution, pullback = lv.vjp(place.system, method, wrt=tuple(along), **run)
    cotangents = {}
    for k, name in enumerate(pullback.states):
        cotangents[name] = np.zeros(solution.states[name].shape)
        cotangents[name][-1] = waves(cotangents[name][-1].shape, k)
    gradients = pullback(**cotangents)
    # along the sum of all directions
    found = lv.integrate(place.system, method, tangents=along, **run).tangents
    names = found["t1"].states
    summed = {f"d{x}": sum(each.states[x][-1:] for each in found.values()) for x in names}
    return summed | {f"by {name}": np.atleast_1d(x)[None] for name, x in gradients.items()}


def waves(shape: tuple[int, ...], k: int) -> np.ndarray:
    """Return numbers none of which is zero, other ones for each k."""
    return np.cos(np.arange(1, 1 + math.prod(shape)) + k).reshape(shape)
