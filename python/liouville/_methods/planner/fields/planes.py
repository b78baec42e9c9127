"""Plans of fields by planes: their pieces are known, the step has to be short enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods import VolumeSplitting
from liouville._methods.composition import SCHEMES
from liouville._methods.planner.fields.plan import FieldPlan
from liouville._methods.planner.plan import AGAIN
from liouville._methods.splitting import Natural, Plane, PlaneSplit
from liouville._systems.fields.plane_field import PlaneField
from liouville._systems.fields.terms import Terms

#: The composition where none is asked for, by the degree of splines: of higher ones the order
#: is lost at the faces of cells.
USUAL = {None: "BM4", 3: "BM4", 5: "BM6"}

#: Equations have a solution below 1, which is near to its start below this.
MOST = 0.9


def plan_planes(
    system: PlaneField, method: VolumeSplitting | FieldPlan, h: float, rows: np.ndarray
) -> tuple[FieldPlan, PlaneSplit]:
    """Return the plan of a field for steps h from states, and the field split by it.

    The rows of states have the time too, if the field depends on it.

    Raises
    ------
    TypeError
        The method has words that are for polynomial fields.
    ValueError
        The step is too long, or a plan was made for another field.
    """
    parts = split_of(system)
    if isinstance(method, FieldPlan):
        if not method.has_planes or (method.n, method.terms) != (parts.n, system.size):
            sentence = (
                f"the plan is not for a {system.kind} field of {parts.n} variables and "
                f"{system.size} {system.counted}: {method!r}"
            )
            raise ValueError(hinted(sentence, AGAIN))
        check_step(system, method.method.composition, h, rows)
        return method, parts
    _check_method(method)
    name = USUAL[system.degree] if method.composition == "auto" else method.composition
    scheme = SCHEMES[name]
    theta = check_step(system, name, h, rows)
    order = order_of(system, int(scheme["order"]))
    found = replace(method, composition=name)
    splines = "" if system.degree is None else f"splines of degree {system.degree}: "
    reasons = [
        f"equations of a flow: theta = {theta:.2g} of the {MOST} that are taken; h up to "
        f"{longest_step(system, name, rows):.3g}",
        f"{splines}order {order}",
        *system.said(),
    ]
    cost = len(scheme["flows"]) * sum(piece.operations for piece in parts.pieces)
    names = system.variables
    pieces = tuple(
        piece.described(names) if isinstance(piece, Plane) else f"shear of {names[-1]}: 1 term"
        for piece in parts.pieces
    )
    plan = FieldPlan(
        method=found, order=tuple(range(len(parts.pieces))), directions=(), n=parts.n,
        terms=system.size, h=abs(h), seed=0, cost=float(cost), pieces=pieces,
        reasons=tuple(reasons), has_planes=True, counted=system.counted,
    )  # fmt: skip
    return plan, parts


def order_of(system: PlaneField, order: int) -> int:
    """Return the order of a composition for this field."""
    return order if system.degree is None else min(order, system.degree)


def split_of(system: PlaneField) -> PlaneSplit:
    """Return the pieces of a field."""
    n = len(system.variables)
    time = Terms(n, np.array([n - 1]), np.ones(1), np.full((1, 1), -1))
    shear = (Natural(time),) if system.is_driven else ()
    planes = (Plane(system, number) for number in range(len(system.planes)))
    return PlaneSplit(n, (*shear, *planes))


def longest_step(system: PlaneField, scheme: str, rows: np.ndarray, h: float = 0.0) -> float:
    """Return the longest step that is taken, from these states and where a step h takes them."""
    steep = system.steepness(rows, h)
    return MOST / (longest_stage(scheme) * steep) if steep else np.inf


def check_step(system: PlaneField, scheme: str, h: float, rows: np.ndarray) -> float:
    """Refuse a step whose equations may have no solution, else return theta."""
    longest = longest_step(system, scheme, rows, h)
    theta = MOST * abs(h) / longest
    if theta >= MOST:
        what, more = ("grid", "; smoother data take longer steps")
        if system.degree is None:
            what, more = ("field and start", "")
        why = f"the equations of {scheme} might have no solution"
        sentence = f"a step of {abs(h):g} is too long for this {what}: {why}"
        raise ValueError(hinted(sentence, f"give h up to {0.99 * longest:.3g}{more}"))
    return theta


def longest_stage(scheme: str) -> float:
    """Return the longest flow of a composition, in steps."""
    return max(abs(float(alpha)) for _, alpha in SCHEMES[scheme]["flows"])


def _check_method(method: VolumeSplitting) -> None:
    usual = VolumeSplitting()
    for name in ("diagonal", "off_diagonal", "linear", "runge_kutta", "turn"):
        if getattr(method, name) != getattr(usual, name):
            kind = "charged particles" if name == "turn" else "polynomial fields"
            sentence = f"{name}= is for {kind}: this field is split into planes"
            raise TypeError(hinted(sentence, "VolumeSplitting(composition='BM4') has all there is"))
