"""Particle velocity at a place, its numbers, and limits for it."""
