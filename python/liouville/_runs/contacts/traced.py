"""Contacts of a system as expressions: matrices at a state, and the systems of modes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, quoted
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.hit import MOST, has_closed_form
from liouville._runs.contacts.margin import refuse_space
from liouville._runs.contacts.matrices import Laws, Matrices
from liouville._runs.contacts.mode import ModeSystem
from liouville._systems.mechanics.contact import Coefficient, Contact, Mode
from liouville._systems.mechanics.form import total_derivative
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions
from liouville._systems.tracing.sparse import entries, jacobian

#: Laws of impacts.
LAWS = ("poisson", "newton", "sequence")
#: Coefficients of laws, among the columns.
COEFFICIENTS = ("restitution", "friction", "static")
#: Rows are independent of others where so much of their length is left.
INDEPENDENT = 1e-9


class Contacts:
    """The contacts of a system, traced.

    Parameters
    ----------
    system : Mechanics
        The system without them.
    given : mapping of str to Contact
        The contacts by name.
    law : str
        The law of impacts, one of `LAWS`.
    """

    def __init__(self, system: Mechanics, given: Mapping[str, Contact], law: str) -> None:
        if law not in LAWS:
            raise ValueError(f"impacts must be 'poisson', 'newton' or 'sequence', not {law!r}")
        for name, contact in _trace.mapping("contacts", given).items():
            if not isinstance(contact, Contact):
                raise TypeError(f"contact '{name}' must be a Contact, not {contact!r}")
        self.system, self.law, self.names = system, law, tuple(given)
        #: Whether normal forces are given, and whether contacts have friction, and bounce.
        self.is_pressed = np.array([x.load is not None for x in given.values()])
        self.is_rough = tuple(x.is_rough for x in given.values())
        self.bounces = tuple(callable(x.restitution) or x.restitution > 0 for x in given.values())
        self._systems: dict[tuple[tuple[Mode, ...], tuple[int, ...], bool], ModeSystem] = {}
        #: The tapes of events that modes share, by all that they depend on.
        self.recorded: dict[tuple[Any, ...], _core.Tape] = {}
        _check_linear(system)
        s, model = system.symbols, system.model
        u = ca.SX.sym("u", s.y.numel())  # in the place of v
        each = [_functions_of(system, name, contact, u) for name, contact in given.items()]
        gaps, loads, slips = zip(*each, strict=True)
        #: The contact of each slip, and which contacts have two.
        self.owner = np.repeat(np.arange(len(slips)), [x.numel() for x in slips])
        self.is_spatial = np.bincount(self.owner) > 1
        phi, slip_of_u = ca.vertcat(*gaps), ca.vertcat(*slips)
        columns = self._coefficients(given) | {
            "phi": phi,
            "load": ca.vertcat(*loads),
            "across": ca.densify(jacobian(phi, s.y)),  # G
            "along": ca.densify(jacobian(slip_of_u, u)),  # D
            "slips": ca.substitute(slip_of_u, u, model.v),
            "rates": total_derivative(phi, s, model.v),
        }
        self.expressions = Expressions(s, columns)
        if self.is_spatial.any() and not has_closed_form(self):
            names = quoted([self.names[k] for k in np.flatnonzero(self.is_spatial)])
            sentence = f"friction in space, of contacts {names}, is for systems of up to {MOST}"
            raise ValueError(f"{sentence} coordinates and multipliers")

    def _coefficients(self, given: Mapping[str, Contact]) -> dict[str, ca.SX]:
        """Return coefficients as expressions of the parameters."""
        params = {"params": self.system.symbols.params}

        def of(name: str, what: str, value: Coefficient) -> ca.SX:
            which = f"{what} of contact '{name}'"
            return _trace.scalar(which, value, params) if callable(value) else ca.SX(float(value))

        return {
            "restitution": ca.vertcat(
                *(of(x, "restitution", y.restitution) for x, y in given.items())
            ),
            "friction": ca.vertcat(*(of(x, "friction", y.friction) for x, y in given.items())),
            "static": ca.vertcat(*(of(x, "static_friction", y.largest) for x, y in given.items())),
        }

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the system, whose part this is, and the systems of modes."""
        return self.__dict__ | {"system": None, "_systems": {}, "recorded": {}}

    @property
    def columns(self) -> dict[str, ca.SX]:
        """Gaps "phi", slips and rates, and their derivatives "across" and "along"."""
        return self.expressions.columns

    @cached_property
    def _tape(self) -> tuple[_core.Tape, list[tuple[slice, tuple[int, int]]]]:
        system, columns = self.system, self.columns
        s, model = system.symbols, system.model
        own = model.nonholonomic
        w = total_derivative(model.g, s, model.v)
        bilateral, rates = ca.vertcat(w, own.k), ca.vertcat(columns["rates"], columns["slips"])
        r_lam, rn_nu = jacobian(model.r, model.lam), jacobian(own.rn, own.nu)
        f = model.f - total_derivative(model.p, s, model.v)
        parts = {
            "gap": columns["phi"],
            "slopes": ca.sum2(ca.fabs(columns["across"])),
            "rates": rates,
            "p_z": jacobian(model.p, s.z),
            "v": model.v,
            "v_z": jacobian(model.v, s.z),
            "B": jacobian(bilateral, s.z),
            "B_t": total_derivative(bilateral, s, model.v),
            "f R": ca.horzcat(f, r_lam, rn_nu),
            "C": jacobian(rates, s.z),
            "C_t": total_derivative(rates, s, model.v),
            "F": ca.horzcat(columns["across"].T, columns["along"].T),
            "laws": ca.horzcat(*(columns[name] for name in COEFFICIENTS)),
            "load": columns["load"],
        }
        flat = [ca.densify(ca.vec(x)) for x in parts.values()]
        ends = np.cumsum([0, *(x.numel() for x in flat)]).tolist()
        cuts = [slice(*own) for own in pairwise(ends)]
        places = list(zip(cuts, (x.shape for x in parts.values()), strict=True))
        return record("contacts", s.inputs(z=s.z), *flat), places

    def at(self, t: float, y: Array, z: Array, params: Array, h: float) -> Matrices:
        """Return the matrices at a state; h is the step that sizes are of."""
        tape, places = self._tape
        flat = tape.map(params, [np.array([[t]]), y[None].copy(), z[None].copy()])[0]
        parts = [flat[cut].reshape(shape, order="F") for cut, shape in places]
        gap, slopes, rates, p_z, v, v_z, B, B_t, fR, C, C_t, F, laws, load = parts
        c, m = len(self.names), fR.shape[1]
        solved = np.linalg.solve(p_z, np.concatenate([fR, F], axis=1))
        free, R, F = solved[:, 0], solved[:, 1:m], solved[:, m:]
        if B.size:
            back = R @ np.linalg.pinv(B @ R)
            free = free - back @ (B @ free + B_t[:, 0])
            F = F - back @ (B @ F)
        given = Laws(*laws.T)
        braked = np.abs(F[:, c:]) @ (given.static * load[:, 0])[self.owner]
        pull = float(np.abs(free).max() + braked.max())
        speed = np.abs(v).max() + h * pull
        way = np.abs(y).max() + h * speed
        size = slopes[:, 0] * way + np.abs(gap[:, 0])
        return Matrices(
            gap[:, 0], rates[:c, 0], rates[c:, 0], size, float(way), float(speed), C @ F,
            C @ free + C_t[:, 0], F, free, v[:, 0], v_z, np.concatenate([B, C]), given, pull,
            load[:, 0], self.is_pressed, self.owner,
        )  # fmt: skip

    def slips_of(self, k: int) -> list[int]:
        """Return the numbers of the slips of a contact."""
        return np.flatnonzero(self.owner == k).tolist()

    def seen(self, along: Array) -> Array:
        """Return slips or frictions of shape (..., s) by contact: of two in space their size."""
        if not self.is_spatial.any():
            return along
        each = [along[..., self.slips_of(k)] for k in range(len(self.names))]
        sizes = [np.hypot(x[..., 0], x[..., -1]) if x.shape[-1] > 1 else x[..., 0] for x in each]
        return np.stack(sizes, axis=-1)

    def slipping(self, k: int, slip: Array) -> Mode:
        """Return the mode of a contact that slips, by slips or their rates."""
        if self.is_spatial[k]:
            return Mode.SLIDE
        return Mode.SLIP_UP if slip[self.slips_of(k)[0]] > 0 else Mode.SLIP_DOWN

    def has_gap(self, k: int) -> bool:
        """Whether the normal force of a contact is to be found."""
        return not self.is_pressed[k]

    @cached_property
    def _loads_tape(self) -> _core.Tape:
        return record("loads of contacts", self.system.symbols.inputs(), self.columns["load"])

    def loads(self, t: Array, y: Array, params: Array) -> Array:
        """Return normal forces that are given at k states, zero of others, shape (k, c)."""
        if not self.is_pressed.any():
            return np.zeros((len(t), len(self.names)))
        found: Array = self._loads_tape.map(params, [t[:, None].copy(), np.ascontiguousarray(y)])
        return found

    @cached_property
    def _laws_tape(self) -> _core.Tape:
        return record("laws of contacts", self.system.symbols.inputs(), *self._laws)

    @property
    def _laws(self) -> list[ca.SX]:
        return [self.columns[name] for name in COEFFICIENTS]

    def laws(self, params: Array) -> Laws:
        """Return the coefficients at some parameters."""
        y = np.zeros((1, self.system.symbols.y.numel()))
        return Laws(*self._laws_tape.map(params, [np.zeros((1, 1)), y]).reshape(3, -1))

    @property
    def drives(self) -> ca.SX:
        """Rates that walls and belts have against the system: those of it less those of contacts.

        With (N, T) they give the power that contacts bring in by their own motion.
        """
        columns, v = self.columns, self.system.model.v
        own = ca.vertcat(columns["across"] @ v, columns["along"] @ v)
        return own - ca.vertcat(columns["rates"], columns["slips"])

    @cached_property
    def _powers_tape(self) -> _core.Tape:
        s = self.system.symbols
        return record("powers of contacts", s.inputs(z=s.z), self.drives, self.columns["slips"])

    def powers(
        self, states: tuple[Array, Array, Array], normal: Array, friction: Array, params: Array
    ) -> dict[str, Array]:
        """Return powers at k states (t, y, z), of N of shape (k, c) and T of shape (k, s).

        That of "friction" is T s, and "contacts" is what walls and belts bring in by their motion.
        """
        rows = [np.ascontiguousarray(x) for x in (states[0][:, None], *states[1:])]
        cut = len(self.names) + len(self.owner)
        drives, slips = np.split(self._powers_tape.map(params, rows), [cut], axis=1)
        forces = np.hstack([normal, friction])
        return {
            "contacts": (forces * drives).sum(axis=1),
            "friction": (friction * slips).sum(axis=1),
        }

    @cached_property
    def _approach_tape(self) -> _core.Tape:
        columns, s = self.columns, self.system.symbols
        return record("approach of contacts", s.inputs(z=s.z), columns["phi"], columns["rates"])

    def approach(self, t: Array, y: Array, z: Array, params: Array) -> tuple[Array, Array]:
        """Return gaps and their rates at k states, each of shape (k, c)."""
        rows = [np.ascontiguousarray(x) for x in (t[:, None], y, z)]
        gap, rate = np.split(self._approach_tape.map(params, rows), 2, axis=1)
        return gap, rate

    @cached_property
    def _records_tape(self) -> tuple[_core.Tape, list[int]]:
        s, columns = self.system.symbols, self.columns
        parts = [
            columns["phi"],
            columns["slips"],
            ca.sum2(ca.fabs(columns["across"])),
            ca.sum2(ca.fabs(jacobian(columns["slips"], s.z))),
            ca.mmax(ca.fabs(self.system.model.v)),
        ]
        dense = [ca.densify(x) for x in parts]
        ends = np.cumsum([x.numel() for x in dense])[:-1].tolist()
        return record("records of contacts", s.inputs(z=s.z), *dense), ends

    def records(
        self, t: Array, y: Array, z: Array, params: Array, h: float, free: float
    ) -> tuple[Array, Array, Array, Array]:
        """Return gaps, slips and sizes of both at k states, of shape (k, c) or of slips (k, s).

        Sizes are those of :class:`Matrices`, with accelerations of the size `free`.
        """
        tape, ends = self._records_tape
        rows = [np.ascontiguousarray(x) for x in (t[:, None], y, z)]
        gap, slip, slopes, slopes_of_slip, fast = np.split(tape.map(params, rows), ends, axis=1)
        speed = fast + h * free
        way = np.abs(y).max(axis=1, keepdims=True) + h * speed
        return gap, slip, slopes * way + np.abs(gap), slopes_of_slip * speed

    def slips(self, t: Array, y: Array, z: Array, params: Array) -> Array:
        """Return slips at k states, of shape (k, s)."""
        return self.records(t, y, z, params, 0.0, 0.0)[1]

    def mode(self, modes: tuple[Mode, ...], at: Matrices, t: float) -> ModeSystem:
        """Return the system in these modes at a state and a time; each is made once.

        It steps the rows that no rows before them imply, those of gaps first, numbered as in
        :class:`Matrices`, those of slips behind those of gaps.
        """
        c = len(modes)
        wanted = [k for k, mode in enumerate(modes) if self.has_gap(k) and mode is not Mode.OPEN]
        wanted += [c + row for row, k in enumerate(self.owner) if modes[k] is Mode.STICK]
        fixed = len(at.rows) - len(at.b)
        rows = [*range(fixed), *(fixed + k for k in wanted)]
        held = independent(at.rows[rows])
        found = [k for k, x in zip(wanted, held[fixed:], strict=True) if x]
        if len(found) < len(wanted):
            refuse_space(modes, self.names, t)
        is_redundant = not all(held[:fixed])
        key = modes, tuple(found), is_redundant
        if key not in self._systems:
            self._systems[key] = ModeSystem(self, *key)
        return self._systems[key]


def independent(rows: Array) -> list[bool]:
    """Return which rows no rows before them imply."""
    if not len(rows):
        return []
    sizes = np.linalg.norm(rows, axis=1)
    left = np.abs(np.diag(np.linalg.qr(rows.T, mode="r"))) if len(rows) <= rows.shape[1] else 0.0
    if (left > INDEPENDENT * sizes).all():
        return [True] * len(rows)
    basis, found = np.zeros((0, rows.shape[1])), []
    for x, size in zip(rows, sizes, strict=True):
        for _ in range(2):
            x = x - (basis @ x) @ basis
        rest = np.linalg.norm(x)
        found.append(bool(rest > INDEPENDENT * size))
        if found[-1]:
            basis = np.vstack([basis, x / rest])
    return found


def _check_linear(system: Mechanics) -> None:
    """Refuse momenta that are not linear in the velocity, and reactions not in multipliers."""
    s, model = system.symbols, system.model
    slopes = ca.vertcat(entries(jacobian(model.p, s.z)), entries(jacobian(model.v, s.z)))
    reactions = entries(jacobian(model.r, model.lam))
    if ca.depends_on(slopes, s.z) or ca.depends_on(reactions, model.lam):
        sentence = "contacts want a momentum that is linear in the velocity, and linear reactions"
        raise TypeError(hinted(sentence, "write the system as a Lagrangian"))


def _functions_of(
    system: Mechanics, name: str, contact: Contact, u: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return gap, load and slip of a contact, at a velocity u; what it has not is zero."""
    what, s, first = f"contact '{name}'", system.symbols, system.states[0]
    if name in system.constraints:
        raise ValueError(f"{what} has the name of a constraint")
    at = {"t": s.t, first: s.y, "params": s.params}
    gap, load, slip = ca.SX(0), ca.SX(0), ca.SX(0)
    if contact.gap is not None:
        gap = _trace.scalar(f"the gap of {what}", contact.gap, at)
        if not ca.depends_on(gap, s.y):
            sentence = f"the gap of {what} is the same for all coordinates"
            raise ValueError(hinted(sentence, f"return a distance, a function of {first}"))
    elif callable(contact.load):
        load = _trace.scalar(f"the load of {what}", contact.load, at)
    elif contact.load is not None:
        load = ca.SX(float(contact.load))
    if contact.slip is not None:
        moving = {"t": s.t, first: s.y, "v": u, "params": s.params}
        slip = _trace.column(f"the slip of {what}", contact.slip, moving)
        if slip.numel() > 2:
            sentence = f"the slip of {what} must be one value, or two in space"
            raise ValueError(f"{sentence}, not {slip.numel()}")
        if ca.depends_on(jacobian(slip, u), u):
            raise ValueError(f"the slip of {what} must be affine in the velocity")
        if not all(ca.depends_on(x, u) for x in ca.vertsplit(slip)):
            raise ValueError(f"the slip of {what} is the same for all velocities")
    return gap, load, slip
