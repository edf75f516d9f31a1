"""What the page on accuracy draws."""

import pandas as pd

from pipeline.report.results import Results, paper_accuracy
from pipeline.report.slices import DISTANCE_LABELS

MIN_PATHS = 20  # fewest paths in a bin that is drawn


def by_demonstrations(results: Results) -> pd.DataFrame:
    """Return accuracy by the number of demonstrations, the paper's where it most likely applies."""
    return pd.concat([results.table("accuracy"), paper_accuracy(split="seen_scenes")], ignore_index=True)


def by_distance(results: Results) -> pd.DataFrame:
    """Return accuracy in the training scenes by distance to the boundary, with the share of paths in its name."""
    table = results.table("slices").query(
        "split == 'seen_scenes' and slice == 'distance' and variant != 'position_only'"
    )
    table = table[table["value"].isin(DISTANCE_LABELS)]
    place, share = table["value"].map(DISTANCE_LABELS.index), table.groupby("value")["share"].first()
    names = {value: f"{value}\n{100 * part:.0f} % of paths" for value, part in share.items()}
    return table.assign(place=place, distance=table["value"].map(names)).sort_values("place", kind="stable")


def calibration(results: Results) -> pd.DataFrame:
    """Return the bins of stated probabilities that have enough paths."""
    return results.table("calibration").query("count >= @MIN_PATHS")
