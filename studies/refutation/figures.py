"""Placebo patches on one table."""

from matplotlib.figure import Figure

from pipeline.report.drawing import draw_images
from pipeline.report.study import Study
from pipeline.world.layout import SYMBOLS


def placebos(study: Study) -> Figure:
    """Draw the first table with each item's pixels shuffled, a row for each size of the pieces."""
    images = study.arrays("examples.npz")
    rows = {f"{setting.partition('=')[2]} px pieces": list(versions) for setting, versions in images.items()}
    return draw_images(rows, [f"placebo of {symbol}" for symbol in SYMBOLS])
