"""What the model card shows."""

import pandas as pd

from pipeline.report.pages.limits import failing
from pipeline.report.results import Results
from pipeline.report.slices import DISTANCE_LABELS, NOTHING, SLICES


def slices(results: Results) -> pd.DataFrame:
    """Return scores of the slices of unseen-item paths in the order of SLICES, distances from near to far.

    blind: accuracy of the guess by position; paths: their number.
    """
    table = results.table("slices").query("split == 'new_items' and slice != 'all'")
    blind = table[table["variant"] == "position_only"].set_index(["slice", "value"])["accuracy"]
    table = table[table["variant"] == failing(results)].join(blind.rename("blind"), on=["slice", "value"])
    order = {name: i for i, name in enumerate([*DISTANCE_LABELS, NOTHING])}
    by = table.assign(a=table["slice"].map(list(SLICES).index), b=table["value"].map(lambda value: order.get(value, 0)))
    rows = by.sort_values(["a", "b", "value"])
    return rows.assign(slice=rows["slice"].map(SLICES), paths=rows["count"] / len(results.seeds))
