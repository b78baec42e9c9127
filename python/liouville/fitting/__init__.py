"""Fits of a system to measurements of its motion."""

from liouville.fitting.least_squares import Fit, fit

__all__ = ["Fit", "fit"]
