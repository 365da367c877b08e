"""Blind benchmark of the diagnosis: sealed truths, frozen answers, a table of scores."""
