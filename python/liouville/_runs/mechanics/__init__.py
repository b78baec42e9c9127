"""Runs of systems on constraints: mechanical ones and semi-explicit ones."""
