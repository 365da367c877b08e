"""Models: materials, joints, boundary conditions, sources and receivers on a mesh."""
