"""Readers of tables, and the log of what was read."""
