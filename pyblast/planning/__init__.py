"""A blast before it is fired: delays and the distribution of its peaks."""
