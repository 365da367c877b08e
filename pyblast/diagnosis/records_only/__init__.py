"""Diagnosis of records without a model of the site: baselines are other records."""
