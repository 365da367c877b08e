"""Motion at a place: seismograms, spectra, comparison, limit curves."""
