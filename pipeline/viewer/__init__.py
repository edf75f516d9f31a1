"""Rerun recordings of models; the only package that imports rerun."""
