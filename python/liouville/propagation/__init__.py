"""How wave functions are propagated: which method, how many steps, and the bound of the error."""

from liouville.propagation.choice import planned as planned
from liouville.propagation.plan import Propagation as Propagation
