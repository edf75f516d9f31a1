"""Rows, formats and charts of a table of results: what is shown is the table's, and nothing that is missing."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.report.charts import bars, curves
from pipeline.report.tables import FORMATS, Traced, in_brackets, rows_of
from pipeline.runtime.errors import InputError

TABLE = pd.DataFrame(
    {
        "variant": ["full", "full", "clearance", "clearance"],
        "split": ["new", "old", "new", "old"],
        "level": [1, 2, 1, 2],
        "share": [0.5, 0.6, 0.7, 0.8],
        "q1": [0.4, 0.5, 0.6, 0.7],
        "q3": [0.6, 0.7, 0.8, 0.9],
        "p_holm": [0.01, 0.2, 0.01, 0.2],
        "error": [0.1, np.nan, 0.3, 0.4],
    }
)
COLUMNS = {"variant": "Model", "share": "Share"}


def data(table: pd.DataFrame = TABLE) -> Any:
    """Results of one table."""
    return SimpleNamespace(table={"t": table}.__getitem__, source=str)


def test_rows_are_chosen_ordered_named_and_know_their_cell():
    where = {"variant": ["clearance", "full"], "split": "new"}
    words = {"variant": {"full": "Paper"}}
    table = rows_of(data(), "t", COLUMNS, where, "pct", words, quartiles=True, bold="p_holm")
    assert table.frame["Model"].tolist() == ["clearance", "Paper"] and table.formats == {"Share": "pct"}
    assert table.frame["Share, bold"].tolist() == [True, True]
    cell = table.frame["Share"].iloc[1]
    assert isinstance(cell, Traced) and cell.source == ("t", "share", {"split": "new", "variant": "full"})
    row = table.frame.to_dict("records")[0]
    assert in_brackets(row, "Share", FORMATS["pct"]) == " [60–80]"


def test_each_value_of_across_gets_its_columns():
    table = rows_of(data(), "t", COLUMNS, formats="pct", interval=("q1", "q3"), across="split")
    columns = [f"{split}, Share{part}" for split in ("new", "old") for part in ("", ", low", ", high")]
    assert list(table.frame) == ["Model", *columns]
    assert table.frame["old, Share"].tolist() == [0.6, 0.8]


def test_a_number_may_be_missing_only_where_that_is_declared():
    columns = {"variant": "Model", "error": "Error"}
    assert rows_of(data(), "t", columns, formats="pct", gaps=["Error"]).frame["Error"].iloc[1] is None
    with pytest.raises(InputError, match="column error: expected finite"):
        rows_of(data(), "t", columns, formats="pct")
    with pytest.raises(InputError, match="column new, Share"):  # the pair is absent
        rows_of(data(TABLE.drop(0)), "t", COLUMNS, formats="pct", across="split")
    with pytest.raises(InputError, match="no row"):
        rows_of(data(), "t", COLUMNS, {"variant": "other"})


@pytest.mark.parametrize("draw", [curves, bars])
def test_a_chart_has_a_panel_for_each_value_and_a_name_for_each_series(draw: Any):
    figure = draw(data(), "t", "level", "share", low="q1", high="q3", panel="split", hue="variant")
    assert [axes.get_title() for axes in figure.axes] == ["new", "old"]
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["Paper’s model", "Clearance model"]
    with pytest.raises(InputError, match="column error"):
        draw(data(), "t", "level", "error")


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "spread"])
def test_every_format_refuses_what_is_not_finite_and_shows_none_as_a_dash(name: str):
    assert FORMATS[name](None) == "–"
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(ValueError, match="finite"):
            FORMATS[name](bad)


@pytest.mark.parametrize(
    ("name", "number", "text"),
    [
        ("pct", 0.5351, "54\u00a0%"),
        ("points1", -0.0234, "−2.3"),
        ("effect", -0.001, "0.00"),
        ("cm", 0.045, "4.5\u00a0cm"),
    ],
)
def test_formats_round_and_use_a_true_minus(name: str, number: float, text: str):
    assert FORMATS[name](number) == text
