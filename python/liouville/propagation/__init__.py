"""How wave functions are propagated: which method, how many steps, and the bound of the error."""

from liouville.propagation.choice import method_of as method_of
from liouville.propagation.choice import planned as planned
from liouville.propagation.choice import propagation as propagation
from liouville.propagation.plan import Propagation as Propagation
from liouville.propagation.stepped import stepped as stepped
