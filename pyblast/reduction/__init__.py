"""Linear models made small: a basis from a few runs answers for all parameters in their ranges."""
