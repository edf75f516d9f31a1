"""The summary of a sweep finds a difference that is there, and none that is not."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.artifacts.files import read_json, read_table, write_json, write_table
from pipeline.sweep.__main__ import main
from pipeline.sweep.summary import shown

SEEDS = range(10)
COMPARED = {"variant": "clearance", "against": ["full", "ae"], "splits": ["new_items"], "n_demos": None}
PARAMETERS = {"protocol": {"name": "validation"}, "profile": "paper", "evaluate": {"comparisons": [COMPARED]}}
NOISE = np.random.default_rng(0).normal(0, 0.01, len(SEEDS))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sweep over beta: at 1 accuracy is 5 points better than at the default 0 and the error lower; at 2 as at 0."""
    jobs = []
    for beta, accuracy, error in (("0", 0.80, 0.2), ("1", 0.85, 0.1), ("2", 0.80, 0.2)):
        path = tmp_path / "jobs" / f"beta={beta}"
        jobs.append(["profile=paper", f"beta={beta}"])
        shaken = np.random.default_rng(int(beta)).normal(0, 0.002, len(SEEDS))
        rows = [("accuracy.full.new_items", s, accuracy + NOISE[s] + shaken[s]) for s in SEEDS]
        rows += [("effect_error.full", s, error + NOISE[s] + shaken[s]) for s in SEEDS]
        rows += [("accuracy.clearance.new_items", s, 0.97 + NOISE[s]) for s in SEEDS]
        rows += [("repair.clearance.careful", s, 0.90 + NOISE[s]) for s in SEEDS]
        rows += [("repair.constant_detour.careful", s, 0.80) for s in SEEDS]  # image-blind: the same for every seed
        write_table(path / "results.parquet", pd.DataFrame(rows, columns=["headline", "seed", "value"]))
        (path / "params.yaml").write_text(yaml.safe_dump(PARAMETERS))
        write_json(path / "job.json", {"overrides": jobs[-1], "state": "done"})
    jobs.append(["profile=paper", "beta=3"])
    write_json(
        tmp_path / "jobs" / "beta=3" / "job.json", {"overrides": jobs[-1], "state": "failed", "error": "too <wide>"}
    )
    record = {"commit": "0" * 40, "targets": ["evaluate"], "runs": [["beta=0,1,2,3"]], "fixed": ["profile=paper"]}
    write_json(tmp_path / "sweep.json", record | {"defaults": {"beta": 0}, "jobs": jobs})
    return tmp_path


def test_the_better_setting_is_called_better_and_an_equal_one_is_not(folder: Path):
    assert main(["summary", str(folder)]) == 1  # a job failed
    table = read_table(folder / "differences.parquet").set_index(["headline", "setting"])
    assert set(table.index) == {
        (h, f"beta={b}") for h in ("accuracy.full.new_items", "effect_error.full") for b in (1, 2)
    }
    better = table.loc[("accuracy.full.new_items", "beta=1")]
    assert better["word"] == "better" and better["difference"] == pytest.approx(0.05, abs=0.003)
    assert better["ci_low"] < 0.05 < better["ci_high"] and better["p_holm"] < 0.001
    assert table.loc[("accuracy.full.new_items", "beta=2"), "word"] in ("same", "undecided")
    assert table.loc[("effect_error.full", "beta=1"), "word"] == "better"  # lower is better


def test_the_page_names_the_better_setting_and_the_failed_job(folder: Path, capsys: pytest.CaptureFixture):
    main(["summary", str(folder)])
    page = re.sub(r"\s+", " ", (folder / "index.html").read_text())
    assert '<p class="big">beta=1</p>' in page and "The difference is real." in page
    assert "too &lt;wide&gt;" in page and "clearance.new_items" not in page  # what did not change is left out
    assert "beta=3" in capsys.readouterr().err


def test_a_parameter_that_only_a_later_run_sweeps_has_its_value_in_the_earlier_jobs_too(folder: Path):
    for beta, steps in (("0", 250), ("1", 250), ("2", 500)):
        file = folder / "jobs" / f"beta={beta}" / "params.yaml"
        file.write_text(yaml.safe_dump(PARAMETERS | {"train": {"steps": steps}}))
    record = read_json(folder / "sweep.json")
    later = folder / "jobs" / "beta=2" / "job.json"
    write_json(later, read_json(later) | {"overrides": ["profile=paper", "beta=2", "train.steps=500"]})
    write_json(folder / "sweep.json", record | {"defaults": {"beta": 0, "train.steps": 500}, "jobs": []})
    assert main(["summary", str(folder)]) == 1
    settings = set(read_table(folder / "results.parquet")["setting"])
    assert settings == {"beta=0, steps=250", "beta=1, steps=250", "beta=2, steps=500"}


def test_models_are_compared_within_each_setting(folder: Path):
    main(["summary", str(folder)])
    table = read_table(folder / "comparisons.parquet").set_index(["split", "setting"])
    accuracy, repair = table.loc["new_items"], table.loc["repair, careful"]
    assert list(accuracy.index) == list(repair.index) == ["beta=0", "beta=1", "beta=2"]
    assert set(accuracy["against"]) == {"full"} and set(repair["against"]) == {"constant_detour"}  # ae was not run
    assert accuracy.loc["beta=1", "difference"] == pytest.approx(0.12, abs=0.003)
    assert repair.loc["beta=1", "difference"] == pytest.approx(0.10, abs=0.01) and set(table["word"]) == {"better"}
    page = (folder / "index.html").read_text()
    assert "Where is one model better than another?" in page and "Clearance model" in page


def test_a_mapping_of_one_value_is_shown_as_that_value():
    assert (
        shown({"bowl": 0.02, "glass": 0.02}) == "0.02"
        and shown({"bowl": 0.02, "glass": None}) == "{bowl:0.02,glass:null}"
    )
    assert shown([2, 3]) == "[2,3]" and shown(0.0) == shown(0) == "0" and shown(True) == "true"


def test_the_tidy_table_has_a_row_for_each_setting_headline_and_seed(folder: Path):
    main(["summary", str(folder)])
    results = read_table(folder / "results.parquet")
    assert list(results.columns) == ["setting", "beta", "headline", "seed", "value"]
    assert len(results) == 5 * 3 * len(SEEDS) and not results.duplicated(["setting", "headline", "seed"]).any()


def sweep_of(folder: Path, values: dict[str, list[float]], name: str = "accuracy.full.new_items") -> None:
    """A finished sweep: override -> the headline for each seed."""
    for override, column in values.items():
        path = folder / "jobs" / override
        write_table(
            path / "results.parquet", pd.DataFrame({"headline": name, "seed": range(len(column)), "value": column})
        )
        (path / "params.yaml").write_text(yaml.safe_dump(PARAMETERS))
        write_json(path / "job.json", {"overrides": [override], "state": "done"})
    record = {"commit": "0" * 40, "targets": ["evaluate"], "runs": [["x"]], "fixed": [], "defaults": {}}
    write_json(folder / "sweep.json", record | {"jobs": [[override] for override in values]})


@pytest.mark.parametrize(
    ("after", "says"),
    [
        ([0.575, 0.675], "too few pairs"),
        ([0.6, 0.7, 0.8, 0.9, 1.0], "too few pairs"),
        ([0.5 + 0.1 * seed + 0.075 for seed in range(8)], "no variance"),
    ],
)
def test_no_interval_no_p_and_no_better_without_six_pairs_that_vary(tmp_path: Path, after: list[float], says: str):
    sweep_of(tmp_path, {"beta=0": [0.5 + 0.1 * seed for seed in range(len(after))], "beta=1": after})
    assert main(["summary", str(tmp_path)]) == 0
    (row,) = read_table(tmp_path / "differences.parquet").itertuples()
    assert row.word == "undecided" and np.isnan([row.ci_low, row.ci_high, row.p_holm]).all()
    page = (tmp_path / "index.html").read_text()
    assert says in page and "The difference is real." not in page and "0.000" not in page


def test_a_result_that_is_equal_for_every_seed_is_the_same_and_says_so(tmp_path: Path):
    values = {"beta=0": [0.3, 0.4], "beta=1": [0.1 + 0.2, 0.4], "beta=2": [0.2, 0.1]}  # 0.1 + 0.2 is not 0.3
    sweep_of(tmp_path, values)
    assert main(["summary", str(tmp_path)]) == 0
    words = read_table(tmp_path / "differences.parquet").set_index("setting")["word"]
    assert dict(words) == {"beta=1": "same", "beta=2": "undecided"}
    assert "equal for every seed" in (tmp_path / "index.html").read_text()


def test_two_spellings_of_a_setting_count_once_and_its_training_sets_once(tmp_path: Path):
    sweep_of(tmp_path, {"beta=1": [0.5, 0.6], "beta=100": [0.5, 0.7], "beta=100.0": [0.5, 0.7], "beta=1e2": [0.5, 0.7]})
    assert main(["summary", str(tmp_path)]) == 0
    (row,) = read_table(tmp_path / "differences.parquet").itertuples()
    assert (row.setting, row.seeds) == ("beta=100", 2)
    assert len(read_table(tmp_path / "results.parquet")) == 4


def test_settings_that_look_the_same_in_short_are_shown_whole(tmp_path: Path):
    sweep_of(tmp_path, {"m={bowl:0.02}": [0.5, 0.6], "m={bowl:0.02,glass:0.02}": [0.5, 0.7]})
    assert main(["summary", str(tmp_path)]) == 0
    settings = set(read_table(tmp_path / "results.parquet")["setting"])
    assert settings == {"m={bowl:0.02}", "m={bowl:0.02,glass:0.02}"}
