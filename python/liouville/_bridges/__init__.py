"""Runs as functions of libraries that differentiate: JAX, PyTorch and CasADi."""
