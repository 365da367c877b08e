"""Tables of a project file, read and checked."""
