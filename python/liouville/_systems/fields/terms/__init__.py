"""Polynomial vector fields as arrays of terms, with functions among their factors."""

from liouville._systems.fields.terms.arrays import exact as exact
from liouville._systems.fields.terms.arrays import grouped as grouped
from liouville._systems.fields.terms.field import ROUNDOFF as ROUNDOFF
from liouville._systems.fields.terms.field import Monomial as Monomial
from liouville._systems.fields.terms.field import Terms as Terms
from liouville._systems.fields.terms.functions import Function as Function
from liouville._systems.fields.terms.functions import written as written
from liouville._systems.fields.terms.waves import Wave as Wave
