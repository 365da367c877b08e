"""The cases of the suite, by subject."""
