"""What instruments write, read into seismograms."""
