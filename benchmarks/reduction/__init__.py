"""A reduced basis in the frequency domain, studied as a way to many runs."""
