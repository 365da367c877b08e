"""One module a command: files in, folder out."""
