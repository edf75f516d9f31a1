"""Rerun recordings: the only place that imports rerun."""
