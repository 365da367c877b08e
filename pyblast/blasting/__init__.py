"""From one hole to the whole blast."""
