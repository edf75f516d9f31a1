"""Rows, formats and charts of a table of results: what is shown is the table's, and nothing that is missing."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.files import read_table
from pipeline.report.charts import bars, curves
from pipeline.report.derived import NOTHING, by_slice, describe
from pipeline.report.exports import README, as_latex, contents, curve, fill, headlines
from pipeline.report.tables import FORMATS, Traced, in_brackets, rows_of
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import random_layouts
from pipeline.world.rules import clearance, slack
from tests.factories import RULES
from tests.report import factory

TABLE = factory.grid(variant=["full", "clearance"], split=["new", "old"]).assign(
    level=[1, 2, 1, 2], share=[0.5, 0.6, 0.7, 0.8], q1=[0.4, 0.5, 0.6, 0.7], q3=[0.6, 0.7, 0.8, 0.9],
    p_holm=[0.01, 0.2, 0.01, 0.2], error=[0.1, np.nan, 0.3, 0.4],
)  # fmt: skip
COLUMNS = {"variant": "Model", "share": "Share"}


def data(table: pd.DataFrame = TABLE) -> Any:
    """Results of one table."""
    return SimpleNamespace(table={"t": table}.__getitem__, source=str)


def test_rows_are_chosen_ordered_named_and_know_their_cell():
    where = {"variant": ["clearance", "full"], "split": "new"}
    words = {"variant": {"full": "Paper"}}
    table, formats = rows_of(data(), "t", COLUMNS, where, "pct", words, quartiles=True, bold="p_holm")
    assert table["Model"].tolist() == ["clearance", "Paper"] and formats == {"Share": "pct"}
    assert table["Share, bold"].tolist() == [True, True]
    cell = table["Share"].iloc[1]
    assert isinstance(cell, Traced) and cell.source == ("t", "share", {"split": "new", "variant": "full"})
    assert in_brackets(table.to_dict("records")[0], "Share", FORMATS["pct"]) == " [60–80]"


def test_a_share_that_a_csv_holds_as_a_whole_number_is_shown_as_a_share():
    made, formats = rows_of(data(TABLE.assign(share=1)), "t", COLUMNS, formats={"Share": "pct"})
    assert all(isinstance(cell, Traced) for cell in made["Share"]) and formats == {"Share": "pct"}


def test_each_value_of_across_gets_its_columns():
    table, _ = rows_of(data(), "t", COLUMNS, formats="pct", interval=("q1", "q3"), across="split")
    columns = [f"{split}, Share{part}" for split in ("new", "old") for part in ("", ", low", ", high")]
    assert list(table) == ["Model", *columns]
    assert table["old, Share"].tolist() == [0.6, 0.8]


def test_a_number_may_be_missing_only_where_that_is_declared():
    columns = {"variant": "Model", "error": "Error"}
    assert rows_of(data(), "t", columns, formats="pct", gaps=["Error"])[0]["Error"].iloc[1] is None
    with pytest.raises(InputError, match="column error: expected finite"):
        rows_of(data(), "t", columns, formats="pct")
    made = rows_of(data(TABLE.drop(0)), "t", COLUMNS, formats="pct", across="split")[0]
    assert made["new, Share"].tolist() == [None, 0.7]  # the pair is absent
    with pytest.raises(InputError, match="no row"):
        rows_of(data(), "t", COLUMNS, {"variant": "other"})


@pytest.mark.parametrize("draw", [curves, bars])
def test_a_chart_has_a_panel_for_each_value_and_a_name_for_each_series(draw: Any):
    figure = draw(data(), "t", "level", "share", low="q1", high="q3", panel="split", hue="variant")
    assert [axes.get_title() for axes in figure.axes] == ["new", "old"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Paper’s model", "Clearance model"]
    with pytest.raises(InputError, match="column error"):
        draw(data(), "t", "level", "error")


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "spread"])
def test_every_format_refuses_what_is_not_finite_and_shows_none_as_a_dash(name: str):
    assert FORMATS[name](None) == "–"
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(ValueError, match="finite"):
            FORMATS[name](bad)


def test_formats_round_and_use_a_true_minus():
    assert FORMATS["pct"](0.998) == "99.8\u00a0%" and FORMATS["pct"](1) == "100\u00a0%"
    assert FORMATS["pct"](0.9996) == "99.9\u00a0%", "a share below one does not read as all"
    written = {"pct": (0.5351, "54\u00a0%"), "points1": (-0.0234, "−2.3"), "effect": (-0.001, "0.00")}
    assert all(FORMATS[name](number) == text for name, (number, text) in written.items())


def test_a_path_is_described_by_its_slack_and_its_scene():
    rng, margins, catalogue = np.random.default_rng(3), factory.MARGINS["normal"], factory.catalogue_of(factory.DATA)
    layouts = random_layouts(rng, 6, catalogue.footprints, catalogue.pool("unseen"), RULES)
    z_theta = random_z_theta(rng, 6, 40)
    rows = describe(layouts, z_theta, margins, ["oak"] * 6)
    slacks = slack(layouts, clearance(layouts, z_theta), margins).ravel()
    near = np.abs(slacks) < 0.01
    assert near.any() and (rows["distance"][near] == "0 to 1 cm").all()
    assert (rows["distance"] == NOTHING).equals(pd.Series(np.isinf(slacks)))
    assert (rows["items"].to_numpy() == np.repeat(layouts.present.sum(1), 40)).all()
    assert set(rows["nearest"]) <= {"glass", NOTHING}


def test_slices_of_a_kind_add_up_to_all_and_unsafe_is_the_invalid_share_of_what_is_accepted():
    judged = factory.tables()["judged"]
    for (variant, split), rows in by_slice(judged).groupby(["variant", "split"]):
        right = (rows["accuracy"] * rows["count"]).groupby(rows["slice"]).sum()
        np.testing.assert_allclose(right, right["all"], err_msg=f"{variant}, {split}")
        np.testing.assert_allclose(rows.groupby("slice")["share"].sum(), 1.0)
    whole = by_slice(judged.head(4).assign(p=[0.9, 0.9, 0.9, 0.1], valid=[True, False, True, True])).iloc[0]
    assert (whole["unsafe"], whole["refused"], whole["accuracy"]) == pytest.approx((1 / 3, 1 / 3, 1 / 2))


def test_every_model_and_baseline_has_a_row_of_headlines_and_the_curve_has_the_paper_and_each_reading():
    metrics = {"accuracy": {"full": {"new_items": 0.54}}, "verdicts_right": {"full": 3}}
    metrics["repair"] = {"full": {"careful": 0.65, "normal": 0.75}, "constant_detour": {"careful": 0.8, "normal": 0.9}}
    rows = headlines(metrics, pd.DataFrame({"Model": ["full"] * 5})).splitlines()
    assert rows[2] == "| Paper’s model | 54\u00a0% | 65\u00a0% | 75\u00a0% | 3 of 5 |"
    assert rows[-1] == "| Fixed detour (image-blind) | – | 80\u00a0% | 90\u00a0% | – |"
    rows = curve(factory.tables()["curve"]).splitlines()
    assert rows[2] == "| The paper | 72\u00a0% [67–78] | 99\u00a0% [98–100] |"
    assert sum("new tables" in row for row in rows) == 2 * 3 and sum("Nearest" in row for row in rows) == 3


def test_a_name_of_any_form_is_text_in_latex():
    bold = read_table(ROOT / "reports/tables/bold.csv")
    text = as_latex(bold.replace({"source": {"clearance": "clearance_small"}}))
    assert r"clearance\_small" in text and not re.search(r"(?<!\\)[_&%]\w", text.replace(" & ", " "))


def test_the_readme_has_the_numbers_of_the_committed_run():
    text = README.read_text(encoding="utf-8")
    assert fill(text, contents(ROOT)) == text
