"""Fitting the paper's model by one of several engines."""
