"""Ground motion: seismograms, spectra, comparison, recorder response, limit curves."""
