"""Project files: read, checked, made into models; results written and read."""
