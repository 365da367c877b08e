"""Blasts: hole tables, signatures, superposition, firing times, site laws."""
