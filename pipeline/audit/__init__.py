"""Audit the results of any commit, or compare those of two: `python -m pipeline.audit`."""
