"""Back-analysis of parameters from records, and design of surveys for it."""
