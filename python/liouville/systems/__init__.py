"""Systems, which are made from functions called once with CasADi symbols."""

from liouville.systems._field import Field as Field
from liouville.systems.mechanical import Hamiltonian as Hamiltonian
from liouville.systems.mechanical import Lagrangian as Lagrangian
from liouville.systems.mechanical import Mechanical as Mechanical
from liouville.systems.mechanics import Mechanics as Mechanics
from liouville.systems.polynomial import PolynomialField as PolynomialField
from liouville.systems.schrodinger import BosonSystem as BosonSystem
from liouville.systems.schrodinger import FermionSystem as FermionSystem
from liouville.systems.schrodinger import Grid as Grid
from liouville.systems.schrodinger import Lattice as Lattice
from liouville.systems.schrodinger import Schrodinger as Schrodinger
from liouville.systems.schrodinger import SpinChain as SpinChain
from liouville.systems.schrodinger import SpinSystem as SpinSystem
from liouville.systems.semi_explicit import SemiExplicit as SemiExplicit
from liouville.systems.structure import Structure as Structure

#: The systems that can be integrated.
System = Mechanics | SemiExplicit | Field | Schrodinger
