"""Simulation of blasts in a ground: elements and edges, meshes, models and runs."""
