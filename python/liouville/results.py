"""The types of what runs, fits, contacts and tables return, for annotations.

Nobody makes them by a call: ``lv.fit`` returns a ``Fit``, ``lv.table`` a ``Table`` or a
``GridTable``, ``system.tape`` a ``Program``; ``solution.contacts`` has a ``ContactRecord`` by
name, with a ``Mode`` at each kept time and a ``Change`` for each hit.

Examples
--------
>>> from liouville import results
>>> def report(found: results.Fit) -> str:
...     return f"chi squared {found.chi2:.3g}"
"""

from liouville._solution.contacts import Change, ContactRecord
from liouville._studies.fitting import Fit, Fitted
from liouville._systems.mechanics.contact import Mode
from liouville._systems.program import Program
from liouville._systems.tracing.grid_table import GridTable
from liouville._systems.tracing.table import Table

__all__ = [
    "Change",
    "ContactRecord",
    "Fit",
    "Fitted",
    "GridTable",
    "Mode",
    "Program",
    "Table",
]
