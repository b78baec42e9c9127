"""Divergence-free fields that are given on grids."""

from liouville._systems.fields.gridded.field import GriddedField as GriddedField
