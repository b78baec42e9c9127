"""Solutions as xarray datasets and as files: NetCDF, Zarr and NumPy both ways, others to be read.

A dataset has the dimensions ``time``, ``coordinate``, ``constraint``, ``invariant``, ``residual``
and ``term``, ``unknown`` where the system has algebraic unknowns, and ``member`` where it is of an
ensemble, labelled by the names of the solution. Its
variables are the states under their own letters, ``invariants``, ``residuals``, ``balance``,
``reactions`` of a mechanical system with constraints, ``observed_NAME`` for each observed quantity,
``event_t_NAME`` for the times of events and ``event_q_NAME`` and so on for the states there,
``contact_gap`` and so on with the dimension ``contact`` for what contacts did, ``change_t`` and so
on for their changes, ``tangent_q_NAME`` and ``tangent_event_q_NAME_EVENT`` for the derivatives of
states; how the run went is in its attributes. Of a field on a sphere ``lon`` and ``lat`` are the
points in degrees, of one on a cylinder ``R`` the radius; files have them for other programs. What
is saved comes back bit for bit. A wave function has the dimension ``place``, without labels; in
NetCDF and Zarr, complex numbers are pairs along ``part``.

A file has checksums, and damage to it is found when it is loaded: a NetCDF file ends in a line with
one, which other readers do not see; a NumPy file has one for each array; in a Zarr folder each
``zarr.json`` has one as attribute, and the chunks have the codec ``crc32c``.
"""

from liouville._solution.export.datasets import dataset_of as dataset_of
from liouville._solution.export.datasets import paired as paired
from liouville._solution.export.datasets import to_xarray
from liouville._solution.export.files import SUFFIXES, check, load, save
from liouville._solution.export.files import ends as ends
from liouville._solution.export.files import write_zarr as write_zarr
from liouville._solution.export.layout import MARK as MARK
from liouville._solution.export.layout import SLASH as SLASH
from liouville._solution.export.reading import order_of as order_of
from liouville._solution.export.sections import save_section as save_section
from liouville._solution.export.sections import section_to_xarray as section_to_xarray
from liouville._solution.export.tables import to_dataframe
from liouville._solution.export.trajectories import trajectories as trajectories

__all__ = ["SUFFIXES", "check", "load", "save", "to_dataframe", "to_xarray"]
