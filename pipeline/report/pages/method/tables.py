"""Convergence of the autoencoders."""

from pipeline.report.page import Table, pick
from pipeline.report.results import Results
from pipeline.report.style import label


def convergence(results: Results) -> Table:
    """Return the two checks of each variant with a decoder: reconstruction, and its own demonstrations."""
    names = {
        "variant": "Model", "reconstruction_over_flat": "Error over a flat colour’s",
        "own_demonstrations": "Own demonstrations right", "passed": "Fits that pass",
    }  # fmt: skip
    formats = {"Error over a flat colour’s": "rate", "Own demonstrations right": "pct1", "Fits that pass": "pct"}
    return Table(pick(results.tables["convergence"], names, variant=label), formats)
