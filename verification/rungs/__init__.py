"""The rungs of the ladder, by subject."""
