"""Tetrahedral meshes: generation of jointed rock, import, splitting, quality."""
