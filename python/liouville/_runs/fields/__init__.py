"""Runs of vector fields."""
