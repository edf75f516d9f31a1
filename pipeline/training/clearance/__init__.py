"""Fitting clearance models by maximum likelihood."""
