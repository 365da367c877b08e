"""Closed forms and independent solutions that the cases are measured against."""
