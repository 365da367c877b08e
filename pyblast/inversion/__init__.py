"""Back-analysis: parameters of a project found from recorded motion."""
