"""The ground: what is there, whatever elements it is cut into."""
