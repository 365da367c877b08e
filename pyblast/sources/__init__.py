"""Shots: blasts with their sources, apart from the ground that they move."""
