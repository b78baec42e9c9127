"""Gridded fields of data sets, by their names and units."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

from liouville._systems.fields.dates import Dates
from liouville._systems.fields.gridded import conventions, names, reading, staggered
from liouville._systems.fields.gridded.coordinates import Coordinates


class OfDataSets:
    """A base of :class:`GriddedField`: how it is made of a data set or a file."""

    dates: Dates | None
    _kind: Coordinates
    _level: Mapping[str, str]

    @classmethod
    def from_xarray(
        cls,
        dataset: Any,
        *,
        u: str | None = None,
        v: str | None = None,
        w: str | None = None,
        **options: Any,
    ) -> Self:
        """Make a field of the velocities of an ``xarray.Dataset``, by CF's names and units.

        Parameters
        ----------
        dataset : xarray.Dataset
            Or what has its attributes. Components are found by their standard names, such as
            "eastward_sea_water_velocity", or by names such as "u"; axes by the attribute ``axis``,
            standard names, units, or names such as "x", "lon", "time". NaN is land. An upward
            velocity is turned where levels count downwards, by the attribute ``positive`` or by
            names such as "depth". Components on the faces of a C-grid, as MITgcm, NEMO and ROMS
            have them, are taken as what flows through these faces, by the lengths and thicknesses
            of the data set where it has them: "dyG", "hFacW", "e2u", "e3u" and so on. Longitudes
            and latitudes may have two dimensions if they depend on one each.
        u, v, w : str, optional
            Names of the components, if they are to be others. Without levels there is no w; with
            levels on the earth that have walls w may be missing, and follows from u and v; so it
            does on a C-grid whose data say between which levels its cells are.
        **options
            As for :class:`GriddedField`: ``walls``, ``periodic``, ``degree`` and so on, with the
            names of axes as the data set has them or as the field has them. Of longitudes and
            latitudes, with or without levels, the coordinates are spherical, on the earth, and
            periodic where longitudes go round, in any numbering, with the last meridian given or
            not.

        Returns
        -------
        GriddedField
            Its times are counted from the first sample on where a date is, in the velocity's unit,
            which is m/s where it has none, and ``dates`` has that date: runs take dates.

        Raises
        ------
        TypeError
            It is no data set.
        ValueError
            A component or an axis is not found, units do not fit or are not known, a grid is
            curvilinear, the faces and centres of a C-grid do not alternate, or as for the class.

        Warns
        -----
        UserWarning
            The data reach a pole, and were cut at 89 degrees; or as for the class.

        Examples
        --------
        >>> import numpy as np
        >>> import xarray
        >>> import liouville as lv
        >>> x = np.linspace(0, 1, 17)
        >>> u, v = np.sin(np.pi * x)[:, None] * np.cos(np.pi * x), 0.0
        >>> v = -np.cos(np.pi * x)[:, None] * np.sin(np.pi * x)
        >>> sea = xarray.Dataset({"u": (("x", "y"), u), "v": (("x", "y"), v)}, {"x": x, "y": x})
        >>> lv.GriddedField.from_xarray(sea, walls=("x", "y"))
        GriddedField(x, y; 16 x 16 cells, splines of degree 3)
        """
        return cls._read(reading.of_xarray(dataset), {"u": u, "v": v, "w": w}, options)

    @classmethod
    def from_netcdf(
        cls,
        path: str | os.PathLike[str],
        *,
        u: str | None = None,
        v: str | None = None,
        w: str | None = None,
        **options: Any,
    ) -> Self:
        """Make a field of the velocities of a NetCDF file; see :meth:`from_xarray`.

        Classic files are read by SciPy. NetCDF 4 needs xarray with a library for it, which
        the extra ``export`` has.

        Raises
        ------
        FileNotFoundError, ImportError
            There is no such file, or nothing that reads it.
        ValueError
            It is no NetCDF file, or as for :meth:`from_xarray`.
        """
        return cls._read(reading.of_file(path), {"u": u, "v": v, "w": w}, options)

    @classmethod
    def _read(
        cls,
        variables: reading.Variables,
        given: Mapping[str, str | None],
        options: Mapping[str, Any],
    ) -> Self:
        components = names.components(variables, given)
        is_staggered = staggered.is_staggered(variables, components)
        read = staggered.arguments if is_staggered else conventions.arguments
        made = read(variables, components, options)
        dates, height = made.pop("dates", None), made.pop("height", 1.0)
        level = made.pop("level", {})
        found = cls(*made.pop("xyz"), **made)
        found.dates, found._kind = dates, replace(found._kind, height=height)
        found._level = level
        return found
