"""Divergence-free fields that are given on grids."""

from liouville.systems.gridded.field import GriddedField as GriddedField
