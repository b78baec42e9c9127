"""Runs of Schrödinger equations."""
