"""How near the world's P(valid) lies to the paper's, and whether the autoencoders autoencode."""

import pandas as pd

from pipeline.report.render import Table
from pipeline.report.results import Results
from pipeline.report.style import label


def p_valid(results: Results) -> Table:
    """Return the true share of valid paths beside the paper's Table 2."""
    columns = {"User": "user", "Added item": "added", "Truth here": "truth", "Paper": "paper", "Difference": "difference"}
    frame = results.tables["p_valid"][list(columns.values())].set_axis(list(columns), axis=1)
    return Table(frame, {"Truth here": "rate", "Paper": "rate", "Difference": "effect"})


def convergence(results: Results) -> Table:
    """Return the reconstruction error over that of one flat colour a scene, by variant with a decoder."""
    frame = results.tables["convergence"].assign(variant=lambda t: t["variant"].map(label))
    names = {"variant": "Model", "reconstruction_over_flat": "Error over a flat colour’s"}
    return Table(frame.rename(columns=names), {"Error over a flat colour’s": "times"})
