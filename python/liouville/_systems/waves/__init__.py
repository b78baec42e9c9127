"""Schrödinger equations, and what makes their Hamiltonians."""

from liouville._systems.waves.equation import Schrodinger as Schrodinger
from liouville._systems.waves.grid import Grid as Grid
from liouville._systems.waves.lattice import Lattice as Lattice
from liouville._systems.waves.sites.particles import BosonSystem as BosonSystem
from liouville._systems.waves.sites.particles import FermionSystem as FermionSystem
from liouville._systems.waves.sites.spins import SpinSystem as SpinSystem
from liouville._systems.waves.spins import SpinChain as SpinChain
