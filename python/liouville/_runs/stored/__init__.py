"""Runs whose records go to a folder on the way, and that go on after they were cut off.

The folder is a Zarr 3 group as :func:`liouville.Solution.save` writes it, but that its arrays grow
along time by whole, uncompressed chunks. Beside them, in ``checkpoint/``, lie the job, which is
the pickled runner, and the state: the checkpoint of the core, and the records that do not fill a
chunk yet. The group's own file has the lengths of all arrays and the numbers of the run, so that a
reader sees both as of one time. Every file appears at once or not at all, and nothing that the
state counts on is written again: wherever a run is cut off, the state fits the arrays up to the
chunks that it counts.
"""

from liouville._runs.stored.running import begin as begin
from liouville._runs.stored.running import resume as resume
from liouville._runs.stored.store import Store as Store
from liouville._runs.stored.store import place_of as place_of
