"""Fitting models: one training loop, and one runner over seeds, users and numbers of demonstrations."""
