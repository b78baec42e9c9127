"""Derivatives of systems by states, time and parameters, recorded at their first use."""
