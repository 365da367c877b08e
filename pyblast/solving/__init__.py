"""The model, its arrays, and their march through time."""
