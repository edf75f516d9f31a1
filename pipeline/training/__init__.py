"""Fitting models: one training loop, an engine for each kind, and training sets that stages and studies share."""
