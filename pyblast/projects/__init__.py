"""From files to objects, what is doubtful about them, and what a run leaves."""
