"""Closed forms and independent solutions that the rungs are measured against."""
