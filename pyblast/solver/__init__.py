"""Solver: assembly of models, explicit time integration."""
