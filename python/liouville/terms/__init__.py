"""Polynomial vector fields as arrays of terms, with functions among their factors."""

from liouville.terms.arrays import exact as exact
from liouville.terms.arrays import grouped as grouped
from liouville.terms.field import ROUNDOFF as ROUNDOFF
from liouville.terms.field import Monomial as Monomial
from liouville.terms.field import Terms as Terms
from liouville.terms.functions import Function as Function
from liouville.terms.functions import written as written
from liouville.terms.waves import Wave as Wave
