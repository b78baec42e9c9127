"""Fits of a system to measurements of its motion."""

from liouville.fitting.least_squares import fit
from liouville.fitting.result import Fit

__all__ = ["Fit", "fit"]
