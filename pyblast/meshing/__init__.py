"""Ground cut into zones, blocks and joints."""
