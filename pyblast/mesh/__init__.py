"""Meshes of tetrahedra: built, cut into blocks, imported, checked."""
