"""Blast waves through jointed rock: superposition, block model, comparison, back-analysis."""
