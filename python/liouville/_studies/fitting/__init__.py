"""Fits of a system to measurements of its motion."""

from liouville._studies.fitting.least_squares import fit
from liouville._studies.fitting.motions import Trial
from liouville._studies.fitting.result import Fit, Fitted

__all__ = ["Fit", "Fitted", "Trial", "fit"]
