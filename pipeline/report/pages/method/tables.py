"""Convergence of the autoencoders."""

from pipeline.report.page import Table
from pipeline.report.results import Results
from pipeline.report.style import label


def convergence(results: Results) -> Table:
    """Return the two checks of each variant with a decoder: reconstruction, and its own demonstrations."""
    names = {
        "variant": "Model", "reconstruction_over_flat": "Error over a flat colour’s",
        "own_demonstrations": "Own demonstrations right", "passed": "Passes",
    }  # fmt: skip
    frame = results.tables["convergence"][list(names)]
    passed = frame["passed"].astype(bool).map({True: "yes", False: "no"})
    frame = frame.assign(variant=frame["variant"].map(label), passed=passed).rename(columns=names)
    return Table(frame, {"Error over a flat colour’s": "rate", "Own demonstrations right": "pct1"})
