"""Systems, which are made from functions called once with CasADi symbols."""

from liouville._systems.fields.field import Field as Field
from liouville._systems.fields.polynomial import PolynomialField as PolynomialField
from liouville._systems.mechanics.general import Mechanics as Mechanics
from liouville._systems.mechanics.mechanical import Hamiltonian as Hamiltonian
from liouville._systems.mechanics.mechanical import Lagrangian as Lagrangian
from liouville._systems.mechanics.mechanical import Mechanical as Mechanical
from liouville._systems.mechanics.semi_explicit import SemiExplicit as SemiExplicit
from liouville._systems.mechanics.structure import Structure as Structure
from liouville._systems.waves import BosonSystem as BosonSystem
from liouville._systems.waves import FermionSystem as FermionSystem
from liouville._systems.waves import Grid as Grid
from liouville._systems.waves import Lattice as Lattice
from liouville._systems.waves import Schrodinger as Schrodinger
from liouville._systems.waves import SpinChain as SpinChain
from liouville._systems.waves import SpinSystem as SpinSystem

#: The systems that can be integrated.
System = Mechanics | SemiExplicit | Field | Schrodinger
