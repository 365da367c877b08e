"""Many runs made cheap: kept by their input, run side by side, superposed instead of run."""
