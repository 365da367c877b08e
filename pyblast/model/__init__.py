"""What is fixed during a run: materials, joints, boundaries, sources."""
