"""The README's headline table."""

import json

import pandas as pd

from pipeline.report.readme import METRICS as COMMITTED
from pipeline.report.readme import README, VERDICTS, headlines

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


def test_the_readme_has_the_numbers_of_the_committed_run():
    metrics, verdicts = json.loads(COMMITTED.read_text()), pd.read_csv(VERDICTS)
    assert headlines(metrics, verdicts) in README.read_text()
