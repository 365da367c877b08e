"""Sets of runs: cache, parallel execution, Green's functions, blast ensembles."""
