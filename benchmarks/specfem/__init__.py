"""Cases of the proof recorded by SPECFEM3D Cartesian, an independent spectral-element program."""
