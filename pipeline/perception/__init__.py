"""Perception: detect the objects on a table in its image."""
