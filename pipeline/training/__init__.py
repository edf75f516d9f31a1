"""Fitting models: one loop, one runner over seeds, users and numbers of demonstrations."""
