"""Schrödinger equations, and what makes their Hamiltonians."""

from liouville.systems.schrodinger.equation import Schrodinger as Schrodinger
from liouville.systems.schrodinger.grid import Grid as Grid
from liouville.systems.schrodinger.lattice import Lattice as Lattice
from liouville.systems.schrodinger.sites.particles import BosonSystem as BosonSystem
from liouville.systems.schrodinger.sites.particles import FermionSystem as FermionSystem
from liouville.systems.schrodinger.sites.spins import SpinSystem as SpinSystem
from liouville.systems.schrodinger.spins import SpinChain as SpinChain
