"""Charged particles in electric and magnetic fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.fields.forces import Forces
from liouville._systems.fields.polynomial import PolynomialField
from liouville._systems.fields.terms import Terms
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Symbols

#: A field or a potential: a function of time, position and parameters, or numbers.
Given = Callable[..., Any] | ArrayLike | None

#: The names of positions, velocities, and momenta by mass.
PLACES, VELOCITIES, MOMENTA = ("x", "y", "z"), ("vx", "vy", "vz"), ("ux", "uy", "uz")

#: Parameters that every system has, and the one of a relativistic system.
CHARGE, MASS, LIGHT = "charge", "mass", "c"


class ChargedParticles(PolynomialField):
    r"""Charged particles in electric and magnetic fields.

    .. math::

        x' = v, \qquad m v' = q \left(E(t, x) + v \times B(t, x)\right)

    or, with a speed of light, of the momentum by mass :math:`u = \gamma v`,

    .. math::

        x' = u / \gamma, \qquad m u' = q \left(E + \frac{u}{\gamma} \times B\right), \qquad
        \gamma = \left(1 + |u|^2 / c^2\right)^{1/2}

    The flow keeps the volume of phase space, and so does every step of
    :class:`~liouville.VolumeSplitting`. Its pieces are the drift, and the exact kick at a position:
    v turns about B, and drifts by E x B. A step has the E x B drift of uniform fields exactly,
    however long it is, and the energy to roundoff where there is no E. Relativistic kicks by E and
    turns by B are pieces of their own.

    Parameters
    ----------
    B, E : callable or array_like, shape (3,), optional
        The magnetic and the electric field: functions ``B(t, x, params)`` of the position x that
        return three components, or constant ones. A field that is not given is zero.
    A, phi : callable, optional
        The potentials instead, :math:`B = \operatorname{curl} A` and
        :math:`E = -\nabla \phi - \partial A / \partial t`: ``A(t, x, params)`` returns three
        components, ``phi(t, x, params)`` one. Such a B has no divergence.
    charge, mass : float, default 1
        Of a particle; they are the parameters ``"charge"`` and ``"mass"``.
    c : float, optional
        The speed of light, the parameter ``"c"`` of relativistic particles.
    x : sequence of str, optional
        The names of the six coordinates, positions first; by default x, y, z, then vx, vy, vz, or
        ux, uy, uz of relativistic particles.
    params : mapping of str to float or 1-D array_like, optional
        Further parameters by name, with default values.
    invariants : mapping of str to callable, optional
        Further quantities to record: functions ``f(t, x, params)`` of all six coordinates.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the six coordinates.
    invariants : tuple of str
        The quantities recorded, the ``"energy"`` among them where it is constant: the kinetic one
        without E, and with the potential energy where potentials do not depend on time.
    is_relativistic : bool
        Whether there is a speed of light.

    Raises
    ------
    TypeError
        An argument is of the wrong kind, or a field is given twice.
    ValueError
        A field has another number of components, a mass or a speed is not positive, or a parameter
        has the name of one that is there.

    See Also
    --------
    VolumeSplitting : ``composition=`` sets the order, and ``turn="boris"`` takes Boris's turn.

    Notes
    -----
    Steps are measured in gyrations: ``BM4`` wants four or more steps a gyration, 10 for small
    errors, ``S2`` twenty. With an E the energy of regular orbits is bounded, and that of chaotic
    ones in fields without a symmetry walks at random. A B with a divergence keeps volume and
    energy all the same, but lets orbits drift.

    References
    ----------
    :cite:t:`he2015`, :cite:t:`zhang2015`, :cite:t:`qin2013`; see :doc:`/theory/particles`.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> crossed = lv.ChargedParticles(B=(0, 0, 2), E=(0.1, 0, 0))
    >>> crossed
    ChargedParticles(x, y, z, vx, vy, vz; B and E)
    >>> run = lv.integrate(crossed, lv.VolumeSplitting(), t=(0, 100), h=0.3, x=[0, 0, 0, 1, 0, 0])
    >>> about_the_drift = np.hypot(run.x[:, 3], run.x[:, 4] + 0.05)
    >>> bool(np.ptp(about_the_drift) < 1e-13)
    True
    """

    is_relativistic: bool

    def __init__(
        self,
        B: Given = None,
        E: Given = None,
        *,
        A: Given = None,
        phi: Callable[..., Any] | None = None,
        charge: float = 1.0,
        mass: float = 1.0,
        c: float | None = None,
        x: Sequence[str] | None = None,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Any] | None = None,
    ) -> None:
        self.is_relativistic = c is not None
        usual = (*PLACES, *(MOMENTA if self.is_relativistic else VELOCITIES))
        names = usual if x is None else _trace.names(x, "x")
        if len(names) != 6:
            raise ValueError(f"x must name six coordinates, positions first, not {len(names)}")
        symbols = Symbols(_parameters(charge, mass, c, params), {"x": 6})
        magnetic, electric, energy = _fields(B, E, A, phi, symbols)
        forces = Forces(symbols, names, magnetic, electric, self.is_relativistic)
        self._given = [name for name, x in (("B", forces.has_b), ("E", forces.has_e)) if x]
        own = {} if energy is None else {"energy": _whole(energy, self.is_relativistic)}
        own |= _trace.mapping("invariants", invariants)
        self._build(names, symbols, forces, forces.is_driven, own)

    @property
    def forces(self) -> Forces:
        """The fields, and the terms that they make."""
        assert isinstance(self._source, Forces)
        return self._source

    def _state(self) -> dict[str, Any]:
        """Return the attributes to pickle: derivatives by parameters take the fields."""
        return self.__dict__ | {"_kept": {}}

    def _expanded(self, values: np.ndarray) -> Terms:
        """Return the field as terms: it has no divergence, whatever B and E are."""
        for name in (MASS, LIGHT)[: 1 + self.is_relativistic]:
            own = self.symbols.params.values(None) if values is None else values
            number = own[[*self.symbols.params.defaults].index(name)]
            if not number > 0:
                what = "the mass" if name == MASS else "the speed of light c"
                raise ValueError(f"{what} must be positive, not {number:g}")
        return self.forces(values, self.held)

    def __repr__(self) -> str:
        """Name the coordinates, and the fields that there are."""
        fields = " and ".join(self._given) or "no fields"
        words = [fields, *["relativistic"] * self.is_relativistic, *["driven"] * self.is_driven]
        return f"{type(self).__name__}({', '.join(self.coordinates)}; {', '.join(words)})"


def _parameters(charge: Any, mass: Any, c: Any, params: Any) -> _trace.Parameters:
    """Return the parameters, those of every system first."""
    own = {CHARGE: charge, MASS: mass} | ({} if c is None else {LIGHT: c})
    for name, value in own.items():
        if np.ndim(value):
            hint = f'members have their own by lv.ensemble(..., params={{"{name}": [...]}})'
            raise ValueError(hinted(f"{name} must be a number, not {value!r}", hint))
    given = _trace.mapping("params", params)
    for name in given:
        if name in own:
            raise ValueError(hinted(f"'{name}' is a parameter already", f"give {name}= itself"))
    return _trace.Parameters(own | given)


def _fields(
    B: Given, E: Given, A: Given, phi: Callable[..., Any] | None, symbols: Symbols
) -> tuple[ca.SX, ca.SX, ca.SX | None]:
    """Return B and E, and the potential energy by charge where the energy is constant."""
    if B is not None and A is not None:
        raise TypeError(hinted("B is given, and A too, whose curl it is", "give one of them"))
    if E is not None and phi is not None:
        raise TypeError(hinted("E is given, and phi too, whose gradient it is", "give one of them"))
    t, position = symbols.t, symbols.x[:3]
    args = {"t": t, "x": position, "params": symbols.params}
    magnetic = _components("B", B, args)
    electric = _components("E", E, args)
    potential = ca.SX(0) if phi is None else _trace.scalar("phi", phi, args)
    if A is not None:
        a = _components("A", A, args)
        by = ca.jacobian(a, position)
        magnetic = ca.vertcat(*(by[j, i] - by[i, j] for i, j in ((1, 2), (2, 0), (0, 1))))
        electric -= ca.jacobian(a, t)
    electric -= ca.gradient(potential, position)
    is_steady = not any(ca.depends_on(x, t) for x in (potential, electric))
    is_known = E is None or electric.is_zero()
    return magnetic, electric, potential if is_known and is_steady else None


def _components(name: str, given: Given, args: _trace.Args) -> ca.SX:
    """Return the three components of a vector field."""
    if given is None:
        return ca.SX(3, 1)
    if callable(given):
        return ca.SX(_trace.placed(name, given, args, PLACES))
    array = _trace.numbers(given)
    if array is None or array.shape != (3,) or not np.isfinite(array).all():
        sentence = f"{name} must be a function or three finite numbers, not {given!r}"
        raise TypeError(hinted(sentence, f"write {name}=lambda t, x, params: [...]"))
    return ca.SX(ca.DM(array))


def _whole(potential: ca.SX, is_relativistic: bool) -> Callable[..., Any]:
    """Return the energy of a particle as a function."""

    def energy(t: Any, x: Any, params: Any) -> Any:
        del t
        square = ca.dot(x[3:], x[3:])
        if is_relativistic:
            gamma = ca.sqrt(1 + square / params.c**2)
            kinetic = params.mass * square / (1 + gamma)
        else:
            kinetic = params.mass * square / 2
        return kinetic + params.charge * potential

    return energy
