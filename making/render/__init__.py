"""Render tables that nobody drew: scenes path-traced by Blender as a Python module (`python -m making.render`)."""
