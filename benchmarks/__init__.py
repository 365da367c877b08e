"""What the program costs, measured by commands that anyone can run."""
