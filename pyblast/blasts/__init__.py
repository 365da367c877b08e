"""Blasts: holes, charges, delays, signatures, superposition, site laws."""
