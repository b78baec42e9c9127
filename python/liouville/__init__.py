"""Structure-preserving time integrators: a Rust core with a Python front."""

from liouville.determinant import determinant as determinant
from liouville.errors import IntegrationError as IntegrationError
from liouville.export import load as load
from liouville.integrate import ensemble as ensemble
from liouville.integrate import integrate as integrate
from liouville.methods import HHT as HHT
from liouville.methods import METHODS as METHODS
from liouville.methods import ArnoldBruls as ArnoldBruls
from liouville.methods import Composition as Composition
from liouville.methods import GeneralizedAlpha as GeneralizedAlpha
from liouville.methods import Spark as Spark
from liouville.methods import VolumeSplitting as VolumeSplitting
from liouville.planner import Plan as Plan
from liouville.planner import plan as plan
from liouville.section import Section as Section
from liouville.section import section as section
from liouville.solution import Solution as Solution
from liouville.systems import Grid as Grid
from liouville.systems import Hamiltonian as Hamiltonian
from liouville.systems import Lagrangian as Lagrangian
from liouville.systems import Lattice as Lattice
from liouville.systems import Mechanical as Mechanical
from liouville.systems import PolynomialField as PolynomialField
from liouville.systems import Schrodinger as Schrodinger
from liouville.systems import SpinChain as SpinChain
from liouville.systems import Structure as Structure
