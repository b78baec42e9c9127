"""Divergence-free vector fields that are given on grids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville._systems.fields.dates import Dates
from liouville._systems.fields.gridded import checks, islands
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.coordinates import KINDS, Coordinates
from liouville._systems.fields.gridded.data import Given
from liouville._systems.fields.gridded.of_data_sets import OfDataSets
from liouville._systems.fields.gridded.planes import made_of
from liouville._systems.fields.gridded.potential import Potential, blocks, in_time, steepest
from liouville._systems.fields.observer import Observer
from liouville._systems.fields.plane_field import PlaneField, Planes, planes_of
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Symbols

#: Newton's corrections of a flow, about.
CORRECTIONS = 3


class GriddedField(OfDataSets, PlaneField):
    r"""A divergence-free vector field given on a grid, in two or three dimensions.

    .. math::

        x' = v(t, x) = \operatorname{curl} A, \qquad \operatorname{div} v = 0

    The potential A is a B-spline, so that the divergence of its curl is zero at every point, and
    not at nodes alone. Its flow is made of those of planes, two coordinates at a time, each a
    Hamiltonian one by a symplectic map: volume is kept to roundoff, for any step.

    Data with a small divergence, from sampling or noise, are taken to the nearest field without.

    Parameters
    ----------
    x, y, z : array_like of shape (n,)
        Nodes along the axes; two axes make a plane. For `fluxes` the edges of cells. A periodic
        axis leaves its last node out, which is the first again.
    t : array_like of shape (T,), optional
        Times of the samples of a field that depends on time, with cubic splines between them: two
        samples are joined by a line, three by a parabola. Dates, of ``datetime64``, become seconds
        from the first one on, and runs take dates as well.
    velocity : sequence of array_like, optional
        The components at the nodes, each of shape ([T,] nx, ny[, nz]). Nodes where they are NaN, at
        all times, are land.
    potential : sequence of array_like, optional
        The components of A at the nodes instead; in the plane the stream function
        :math:`\psi` with :math:`v = (\psi_y, -\psi_x)`.
    fluxes : sequence of array_like, optional
        Fluxes through the faces of cells instead, as C-grids have them: volume in unit time, in the
        plane and on a sphere the velocity times the length of the face. Along its own axis a
        component has a value on every edge, along others one in every cell.
    periodic : sequence of str, or mapping of str to float
        Names of periodic axes, with their periods if they are to be checked. That of longitudes is
        360 degrees, unless another is given, and that of phi :math:`2\pi` over a whole number.
    walls : sequence of str
        Names of axes with walls at both ends, through which nothing flows. The ends of others are
        open: a trajectory may leave there, and has failed then.
    degree : {3, 5}
        Degree p of the splines. Velocities have errors of order p, and integration has order p at
        most: 3 goes with ``BM4``, 5 with ``BM6``.
    coordinates : {"cartesian", "cylindrical", "spherical"}
        Cylindrical: x, y, z are R, phi, Z, and states are (q, phi, Z) with :math:`q = R^2/2`.
        Spherical: x, y are longitude and latitude in degrees, and states are the longitude in
        radians and mu, the sine of the latitude; z is a height or a depth, in the unit of the
        radius, of a shell that is thin. :meth:`states_of` and :meth:`points_of` translate.
    radius : float, default 1
        Radius of the sphere.
    mask : array_like of bool, shape (nx, ny[, nz]) or that of cells, optional
        Land: nodes, or cells for `fluxes`. Nothing flows in cells of land or on their rim. In three
        dimensions land goes down to a wall of the third axis, as a sea floor does.
    gauge : {"coulomb", "given"}, optional
        ``"coulomb"`` takes the potential without a divergence, whose planes keep every wall;
        ``"given"`` takes the planes of the potential given. The first by default, but where a
        potential has an open end.
    most_divergence : float, default 0.05
        The largest part of the velocity that may be taken off.
    names : sequence of str, optional
        Names of the coordinates: "x", "y", "z" if not given.
    invariants : mapping of str to callable, optional
        Quantities to record: functions ``f(t, x, params)``.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the coordinates of states.
    states : tuple of str
        What a start and a solution call the state: ("x",).
    divergence : float
        The part of the velocity that was taken off, in the root of the mean square.
    mean : ndarray, shape (n,) or (T, n)
        The mean flow along axes that close on themselves.
    islands : int
        How many islands there are; in three dimensions those that reach the surface.
    steepest : float
        A bound of the mixed derivatives of A: steps h have a solution while
        :math:`|\alpha h|` times this is below 1, with the largest stage :math:`\alpha`.
    is_driven : bool
        Whether the field depends on time.
    dates : Dates or None
        The date of the time 0 and the unit of times, where the samples have dates.

    Raises
    ------
    TypeError
        An argument is of the wrong kind.
    ValueError
        Shapes do not fit, numbers are not finite, or the field has too much of a divergence.

    Warns
    -----
    UserWarning
        More than a thousandth of the velocity was taken off.

    References
    ----------
    :cite:t:`feng1995`, :cite:t:`mclachlan2008`; see :doc:`/theory/gridded`.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> x = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    >>> X, Y, Z = np.meshgrid(x, x, x, indexing="ij")
    >>> abc = np.sin(Z) + np.cos(Y), np.sin(X) + np.cos(Z), np.sin(Y) + np.cos(X)
    >>> field = lv.GriddedField(x, x, x, velocity=abc, periodic=("x", "y", "z"))
    >>> field
    GriddedField(x, y, z; 16 x 16 x 16 cells, splines of degree 3)
    >>> run = lv.integrate(field, lv.VolumeSplitting(), t=(0, 5), h=0.1, x=[0.1, 0.2, 0.3])
    """

    kind, counted = "gridded", "coefficients"

    #: What CF says of the levels on a sphere: their unit, and which way they count.
    _level: Mapping[str, str] = MappingProxyType({})

    def __init__(
        self,
        x: ArrayLike,
        y: ArrayLike,
        z: ArrayLike | None = None,
        *,
        t: ArrayLike | None = None,
        velocity: Sequence[ArrayLike] | None = None,
        potential: Sequence[ArrayLike] | ArrayLike | None = None,
        fluxes: Sequence[ArrayLike] | None = None,
        periodic: Sequence[str] | Mapping[str, float] = (),
        walls: Sequence[str] = (),
        degree: int = 3,
        coordinates: str = "cartesian",
        radius: float = 1.0,
        mask: ArrayLike | None = None,
        gauge: str | None = None,
        most_divergence: float = checks.MOST_DIVERGENCE,
        names: Sequence[str] | None = None,
        invariants: Mapping[str, Any] | None = None,
    ) -> None:
        n = 2 if z is None else 3
        if coordinates not in KINDS:
            raise ValueError(f"coordinates must be one of {', '.join(KINDS)}, not {coordinates!r}")
        if coordinates == "cylindrical" and n == 2:
            raise ValueError("cylindrical coordinates must have three axes, not 2")
        ways = {"velocity": velocity, "potential": potential, "fluxes": fluxes}
        ways = {name: value for name, value in ways.items() if value is not None}
        if len(ways) != 1:
            raise TypeError("a gridded field is given by velocity=, potential= or fluxes=, by one")
        (what, data), self._kind = ways.popitem(), Coordinates(coordinates, radius)
        usual = {"cylindrical": ("R", "phi", "Z"), "spherical": ("lon", "lat", "z")}
        named = usual.get(coordinates, ("x", "y", "z"))[:n]
        if names is not None:
            named = _trace.names(names, "names")
            if len(named) != n:
                raise ValueError(f"names must be {n} names, not {len(named)}")
        nodes = dict(zip(named, (x, y, z), strict=False))
        axes, turned = checks.axes_of(nodes, periodic, walls, degree, what == "fluxes", coordinates)
        if t is not None and np.asarray(t).dtype.kind == "M":
            dates = np.asarray(t).astype("datetime64[ns]")
            self.dates, t = Dates(dates[0]), (dates - dates[0]) / np.timedelta64(1, "s")
        time = None if t is None else checks.time_axis(t)
        given = Given(what, self._kind, axes, time)
        arrays = given.arrays(data, turned)
        dry, land = given.land(arrays, mask, turned)
        self._axes, self._time = given.stepped(), time
        self.gauge = checks.gauge_of(gauge, what, self._axes)
        found = given.potential(arrays, dry, land, self._axes, self.gauge)
        self._finish(found, land, most_divergence)
        self.coordinates = self._kind.names(named)
        self.is_driven = time is not None
        symbols = Symbols(_trace.Parameters(None), {"x": n})
        self.symbols, self._observer = symbols, Observer(symbols, invariants)
        self._recorded = {}

    def _finish(self, found: Potential, land: Any, most: float) -> None:
        """Check what was taken off, and make the planes."""
        axes, lead = self._axes, int(self._time is not None)
        self.divergence, self.mean, self.islands = found.divergence, found.mean, found.islands
        checks.check_divergence(found.divergence, most, land is not None)
        a, self._land = found.a, land
        if land is not None and len(axes) == 2:
            psi, self.islands = islands.with_islands(a[0], self.mean, land, axes, lead)
            a = (psi,)
        mean = self.mean
        if self._time is not None:
            a = tuple(in_time(self._time, each) for each in a)
            mean = in_time(self._time, mean)
        self._a, self._means = a, mean
        self.steepest = max(
            steepest(each[times], axes, lead, plane)
            for each, (_, plane) in zip(a, planes_of(len(axes)), strict=True)
            for times in (blocks(each) if lead else (...,))
        )
        self._made: Planes | None = None

    # planes

    def _make(self) -> Planes:
        """Hand the planes to the core."""
        return made_of(self._axes, self._time, self._a, self._means)

    def _state(self) -> dict[str, Any]:
        """Return the attributes to pickle: the planes are made again."""
        return dict(self.__dict__) | {"_made": None}

    # calls

    def __repr__(self) -> str:
        """Name the coordinates, and how many cells there are."""
        cells = " x ".join(str(axis.n) for axis in self._axes)
        time = "" if self._time is None else f" at {self._time.nodes} times"
        words = f"{cells} cells{time}, splines of degree {self.degree}"
        return f"{type(self).__name__}({', '.join(self.coordinates)}; {words})"

    @property
    def degree(self) -> int:
        """The degree of the splines."""
        return self._axes[0].p

    @property
    def times(self) -> tuple[float, float] | None:
        """The first and the last time of the samples, None where the field does not change."""
        return None if self._time is None else (self._time.edges[0], self._time.edges[-1])

    @property
    def size(self) -> int:
        """How many coefficients there are."""
        return sum(each.size for each in self._a)

    def operations(self, number: int) -> int:
        """Return about how many additions and multiplications a flow of a plane takes."""
        p = self.degree
        frozen: int = p ** (len(self.planes[number][1]) - 2)
        window = (p + 1) * (p + 3)
        return 2 * window * (frozen + 2) + CORRECTIONS * 6 * (p + 1) ** 2

    def said(self) -> list[str]:
        """Say what there is to know of the field, for plans."""
        return [f"{self.divergence:.1e} of the velocity was taken off, which had a divergence"]

    def steepness(self, rows: np.ndarray, h: float = 0.0) -> float:
        """Return a bound of the mixed derivatives of A, the same at all states."""
        del rows, h
        return self.steepest

    def with_params(self, params: Mapping[str, ArrayLike] | np.ndarray | None) -> Self:
        """Return the field: it has no parameters; ValueError names one that is given."""
        self.numbers(params)
        return self

    def start(self, start: Mapping[str, Any], members: bool = False) -> np.ndarray:
        """Check a start and return it; a member that begins outside the grid fails by itself.

        Raises
        ------
        TypeError, ValueError
            As for other fields, or the start of a single run is outside the grid.
        """
        x = super().start(start, members)
        for name, axis, value in zip(self.coordinates, self._axes, x.T, strict=True):
            first, last = axis.edges[0], axis.edges[-1]
            if not (members or axis.is_periodic or first <= value <= last):
                sentence = (
                    f"x of '{name}' must be in the grid, {first:g} to {last:g}, not {value:g}"
                )
                hint = "field.states_of translates points" if self._kind.kind != "cartesian" else ""
                raise ValueError(hinted(sentence, hint) if hint else sentence)
        return x

    def is_land(self, x: np.ndarray) -> np.ndarray:
        """Return which of the states x, shape (..., n), are in cells of land."""
        return super().is_land(x) if self._land is None else islands.at(x, self._land, self._axes)

    def states_of(self, points: ArrayLike) -> Array:
        """Return the states of points in the user's coordinates, shape (..., n).

        Longitudes of a region may be a turn off. Heights and depths are in the unit of the data
        set, and those of states in the velocity's unit of length.

        Parameters
        ----------
        points : array_like, shape (..., n)
            Degrees of longitude and latitude, and levels; R, phi and Z of a cylinder; else x.
        """
        axis = self._axes[0]
        span = None if axis.is_periodic else (axis.edges[0], axis.edges[-1])
        return self._kind.inward(np.asarray(points), span)

    def positions(self, x: np.ndarray) -> dict[str, tuple[np.ndarray, dict[str, str]]]:
        """Return longitudes, latitudes and levels, or R of a cylinder; see :class:`Field`."""
        found = self._kind.positions(x)
        if self._kind.kind == "spherical" and len(self._axes) == 3:
            found[self.coordinates[2]] = self.points_of(x)[..., 2], dict(self._level)
        return found

    def velocity_at(self, points: ArrayLike, t: float = 0.0) -> Array:
        """Return the velocity at points in the user's coordinates, shape (..., n); NaN outside.

        Its components are those of the data, in their unit: of longitudes and latitudes u, v and,
        with levels, that along their axis, of a cylinder v_R, v_phi and v_Z. The time may be a
        date, where the field has dates.
        """
        x = self.states_of(points)
        found: Array = self.velocity(x, t) * self.lengths(x)
        return found

    def lengths(self, x: np.ndarray) -> np.ndarray:
        """Return the lengths of unit changes of each coordinate; see :class:`Field`."""
        return self._kind.lengths(x)

    def points_of(self, x: ArrayLike) -> Array:
        """Return points in the user's coordinates, shape (..., n): :meth:`states_of` undone.

        Parameters
        ----------
        x : array_like, shape (..., n)
            States of the field, such as ``solution.x``.
        """
        return self._kind.outward(np.asarray(x))
