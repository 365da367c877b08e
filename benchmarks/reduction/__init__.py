"""Reduced-basis models in the frequency domain: a study of fast evaluations of many runs."""
