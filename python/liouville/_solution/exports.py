"""The part of solutions that gives them to other programs and to files."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    import pandas
    import xarray

    from liouville._solution.solution import Solution


class Exports:
    """A base of :class:`Solution`, whose methods load what writes."""

    def to_xarray(self) -> xarray.Dataset:
        """Give the solution as an xarray ``Dataset``, as :meth:`save` writes it.

        Of an ensemble the members have numbers, and the parameters that differ are coordinates
        along them: ``data.swap_dims(member="g").sel(g=9.81)``.
        """
        from liouville._solution import export

        return export.to_xarray(cast("Solution", self))

    def trajectories(self) -> xarray.Dataset:
        """Give the members of a field as trajectories, by CF and in the order of Parcels' files.

        Returns
        -------
        xarray.Dataset
            Of dimensions ``trajectory`` and ``obs``, with ``time`` and the coordinates of each
            point: ``lon``, ``lat`` and levels of a data set, else those of the field. What was
            observed is there, and parameters that differ; where a member had failed it is NaN.

        Raises
        ------
        TypeError
            The solution is none of a field, or of a file without ``system=``.
        ValueError
            The run stored no states.
        ImportError
            xarray is not installed.
        """
        from liouville._solution import export

        return export.trajectories(cast("Solution", self))

    def to_dataframe(self) -> pandas.DataFrame:
        """Give a row for each kept step of each member."""
        from liouville._solution import export

        return export.to_dataframe(cast("Solution", self))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the solution to a file, replacing what was there once all is written.

        Parameters
        ----------
        path : path
            Files that :func:`~liouville.load` gives back bit for bit: ``.nc`` is NetCDF 4,
            ``.zarr`` a Zarr 3 folder, ``.npz`` arrays of NumPy, which need no other package.
            Files for other programs: ``.mat`` has variables and structures for MATLAB, ``.csv``
            and ``.parquet`` a row for each kept step of each member, and ``.xyz`` a frame of
            points for each kept step, of a system whose coordinates are called ``x1``, ``y1``,
            ``z1`` and so on, or ``C1_x`` where an element is to be seen; z may be missing.

        Raises
        ------
        ValueError
            The suffix is none of these, or ``.xyz`` has no points to write, or several members.
        FileNotFoundError
            The folder does not exist.
        ImportError
            A package that this kind of file needs is not installed.
        BlockingIOError
            A stored run is going on there.
        """
        from liouville._solution import export

        export.save(cast("Solution", self), path)
