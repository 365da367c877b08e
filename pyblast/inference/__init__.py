"""Statistics of residuals: noise, model error, likelihood, search, posterior."""
