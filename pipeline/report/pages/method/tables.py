"""Reconstruction error of the autoencoders."""

from pipeline.report.page import Table
from pipeline.report.results import Results
from pipeline.report.style import label


def convergence(results: Results) -> Table:
    """Return the reconstruction error relative to a flat image per scene, for each variant with a decoder."""
    frame = results.tables["convergence"].assign(variant=lambda t: t["variant"].map(label))
    names = {"variant": "Model", "reconstruction_over_flat": "Error over a flat colour’s"}
    return Table(frame.rename(columns=names), {"Error over a flat colour’s": "times"})
