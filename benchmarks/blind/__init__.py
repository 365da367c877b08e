"""Small sites with real noise and hidden effects, drawn by a seed; verification/proof asks them."""
