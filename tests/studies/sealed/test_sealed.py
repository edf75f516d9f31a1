"""Expectations stand beside what came, and say whether it was as expected."""

from pathlib import Path

import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json, read_table, write_json
from pipeline.params import compose
from studies.sealed import stage

main = stage.main  # of the fixture `out`
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """A run with three headlines: one within its interval, one outside, and a claim's verdict."""
    folder = tmp_path_factory.mktemp("sealed")
    expected = read_table(stage.EXPECTATIONS).set_index("headline")
    accuracy = {
        "clearance": {"new_items": float(expected.loc["accuracy.clearance.new_items", "low"])},
        "full": {"new_items": float(expected.loc["accuracy.full.new_items", "high"]) + 0.01},
    }
    write_json(folder / "report" / "metrics.json", {"accuracy": accuracy, "claims": {"robot": "holds"}})
    write_json(folder / "studies" / "perception" / "metrics.json", {})
    return compose(["profile=smoke", f"paths.report={folder}/report", f"paths.studies={folder}/studies"])


def test_a_number_is_as_expected_within_its_interval_and_a_claim_with_the_same_verdict(out: Path):
    numbers = read_table(out / "numbers.csv").set_index("headline")["as_expected"]
    assert numbers.to_dict() == {"accuracy.clearance.new_items": True, "accuracy.full.new_items": False}
    claims = read_table(out / "claims.csv").set_index("headline")[["expected", "found", "as_expected"]]
    assert claims.loc["claims.robot"].tolist() == ["untestable", "holds", False]


def test_there_is_an_expectation_of_each_headline_of_the_paper():
    expected = set(read_table(stage.EXPECTATIONS)["headline"])
    assert set(dict(stage.flat(read_json(ROOT / "reports" / "metrics.json")))) <= expected


def test_each_number_is_expected_within_its_own_interval():
    table = read_table(stage.EXPECTATIONS).dropna(subset="low")
    assert (table["expected"].astype(float).between(table["low"], table["high"])).all()


def test_an_explanation_stands_only_beside_the_value_that_it_was_written_for(out: Path):
    surprises = read_table(out / "surprises.csv").set_index("headline")["explanation"]
    assert surprises.index.tolist() == ["accuracy.full.new_items", "claims.robot"] and surprises.isna().all()
    written = pd.DataFrame({"headline": ["x"], "found": [0.5714], "expected": [0.6], "as_expected": [False]})
    for found, explanation in (("0.571", ["why"]), ("0.572", [])):
        table = pd.DataFrame({"headline": ["x"], "found": [found], "explanation": ["why"]})
        assert stage.surprises_of(written, written[:0], table)["explanation"].dropna().tolist() == explanation
