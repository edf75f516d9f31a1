"""The README's headline table."""

import pandas as pd

from pipeline.report.exports import README, contents, curve, fill, headlines
from pipeline.runtime.places import ROOT
from tests.report import factory

METRICS = {
    "accuracy": {"full": {"new_items": 0.54}, "position_only": {"new_items": 0.59}},
    "repair": {"full": {"careful": 0.65, "normal": 0.75}, "constant_detour": {"careful": 0.8, "normal": 0.9}},
    "verdicts_right": {"full": 3},
}
FIVE = pd.DataFrame({"Model": ["full"] * 5})


def test_every_model_and_baseline_has_a_row_with_its_numbers():
    rows = headlines(METRICS, FIVE).splitlines()
    assert rows[2] == "| Paper’s model | 54\u00a0% | 65\u00a0% | 75\u00a0% | 3 of 5 |"
    assert rows[-1] == "| Fixed detour (image-blind) | – | 80\u00a0% | 90\u00a0% | – |"


def test_the_curve_has_the_paper_each_reading_and_new_tables():
    rows = curve(factory.tables()["curve"]).splitlines()
    assert rows[2] == "| The paper | 72\u00a0% [67–78] | 99\u00a0% [98–99.8] |".replace("99.8", "100")
    assert sum("new tables" in row for row in rows) == 2 * 3 and sum("Nearest" in row for row in rows) == 3


def test_the_readme_has_the_numbers_of_the_committed_run():
    text = README.read_text(encoding="utf-8")
    assert fill(text, contents(ROOT)) == text
