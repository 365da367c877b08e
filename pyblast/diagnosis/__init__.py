"""Diagnosis: which physics a model lacks, by hypotheses tested on records."""
