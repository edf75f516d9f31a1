"""Table 2 of the paper and our values."""

import pandas as pd

from pipeline.report.claims import PAPER
from pipeline.report.page import Table
from pipeline.report.results import PAPER_TABLE_2, Results
from pipeline.report.style import label

SOURCES = (PAPER, "clearance")


def table_2(results: Results) -> Table:
    """Return mean P(valid) without and with an added item, one row per user and source: paper, truth, models.

    A dash where nothing was asked, or where the paper has no such symbol.
    """
    rows, symbols = [], list(results.tables["p_valid"]["added"].unique())
    for user in [u for u in results.users if u in PAPER_TABLE_2.index]:
        rows.append({"User": user, "Source": "Paper"} | PAPER_TABLE_2.loc[user].to_dict())
        truth = {added: results.value("p_valid", "truth", user=user, added=added) for added in symbols}
        rows.append({"User": user, "Source": "Truth in our world"} | truth)
        asked = results.tables["interventions"]
        asked = asked[asked["kind"] == "add"]
        for variant in [v for v in SOURCES if v in results.variants]:
            mine = asked[(asked["variant"] == variant) & (asked["user"] == user)]
            if len(mine):
                after = mine.set_index("symbol")["intervened"].to_dict()
                rows.append({"User": user, "Source": label(variant), "none": mine["baseline"].iloc[0]} | after)
    frame = pd.DataFrame(rows, columns=["User", "Source", *symbols])
    gaps = frame.columns[frame.isna().any()]
    frame[gaps] = frame[gaps].astype(object).where(frame[gaps].notna(), None)
    return Table(frame, dict.fromkeys(symbols, "rate"))
