"""Training scenes of the two worlds, and doses as marks of an axis."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.report.drawing import draw_images
from pipeline.report.study import Study


def worlds(study: Study) -> Figure:
    """Draw training scenes of the control and of the confounded world."""
    images = study.arrays("worlds.npz")
    return draw_images({"no common cause": images["control"], "glasses beside plates": images["confounded"]})


def by_dose(study: Study) -> pd.DataFrame:
    """Return doses.csv with doses as text, since attempts have different units."""
    table = study.table("doses.csv")
    return table.assign(dose=table["dose"].map("{:g}".format))
