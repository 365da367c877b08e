"""Many runs: cached, in parallel, superposed from Green's functions."""
