"""Builders of meshes of spectral hexahedra: mapped grids, swept meshes, cut tetrahedra."""
