"""Specification models, their losses and training, the IRL baseline, and repair by gradient."""
