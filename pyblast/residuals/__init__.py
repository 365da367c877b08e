"""What the difference between recorded and simulated seismograms is worth."""
