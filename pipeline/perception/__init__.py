"""Perception: the objects on a table, detected in its image."""
