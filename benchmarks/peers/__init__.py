"""Other programs on the same mesh and physics, each installed into an environment of its own."""
