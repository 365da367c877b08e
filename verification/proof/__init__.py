"""Proof: every registered case answered once by one version of the program."""
