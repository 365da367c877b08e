"""A model as arrays, integrated in time, with its derivatives."""
