"""Fits of a system to measurements of its motion."""

from liouville.fitting.least_squares import fit
from liouville.fitting.motions import Trial
from liouville.fitting.result import Fit, Fitted

__all__ = ["Fit", "Fitted", "Trial", "fit"]
