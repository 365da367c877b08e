"""Analyses of records along a line of receivers, without a model."""
