r"""Contacts: a system that changes its smooth mode where a contact hits, leaves, sticks or slips.

In each mode a contact adds constraints and reactions that SPARK was made for, so nothing is
regularised. At a change a complementarity problem decides which mode goes on, and impulses obey
another; see :doc:`/theory/contacts`.
"""

from liouville._runs.contacts.members import ensemble as ensemble
from liouville._runs.contacts.pullback import check_inputs as check_inputs
from liouville._runs.contacts.pullback import vjp as vjp
from liouville._runs.contacts.single import integrate as integrate
from liouville._systems.mechanics.contact import Contact as Contact
from liouville._systems.mechanics.contact import Mode as Mode
