"""Blasts before they are fired: what scatter does to their peaks, and which delays are best."""
