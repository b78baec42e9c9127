"""Runs: single ones, ensembles, gradients, those in stores, and systems with contacts."""
