"""Pages, pictures and files to look at."""
