"""When simulation and records differ: where, which physics was left out, and the proof."""
