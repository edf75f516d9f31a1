"""The page's table keeps each source's numbers, and marks those at the paper's rate."""

from pathlib import Path

import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_table
from pipeline.models.baselines import NEAREST
from pipeline.params import compose
from pipeline.report.results import PAPER_ACCURACY
from studies.chance import stage

main = stage.main  # of the fixture `out`


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """One row of each source that belongs on the page, and one that does not."""
    folder = tmp_path_factory.mktemp("chance")
    result = {"split": "seen_scenes", "accuracy": 0.977, "q1": 0.9, "q3": 1.0, "seeds": 2}
    evaluated = {"variant": "full", **result, "mean": 0.978, "n_demos": 9}
    tables = {
        "evaluate/convergence": [
            {"variant": x, "reconstruction_over_flat": 0.7, "passed": 1.0} for x in ("full", "ae")
        ],
        "evaluate/accuracy": [evaluated, evaluated | {"n_demos": 1}, evaluated | {"variant": "clearance"}],
        "studies/search/summary": [
            {"learner": x, "setting": setting, **result, "accuracy": 0.99, "q1": 0.98}
            for x, setting in (("full", "best"), ("full", "default"), ("ae", "best"))
        ],
        "studies/demonstrations/summary": [{"variant": NEAREST, "routes": "few", "clear_cm": 4, **result}],
        "studies/ceiling/summary": [
            {"learner": x, "scenes": 6, "clear_cm": 0, **result, "split": split}
            for x, split in (("perfect", "new_scenes"), ("perfect", "demonstrations"), ("ae", "new_scenes"))
        ],
    }
    for name, rows in tables.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        table = pd.DataFrame(rows)
        write_table(folder / f"{name}.csv", table.drop(columns="accuracy") if "mean" in table else table)
    return compose(["profile=smoke", f"paths.evaluate={folder}/evaluate", f"paths.studies={folder}/studies"])


def test_each_source_gives_its_row_and_the_paper_s_lower_quartile_is_the_bar(out: Path):
    table = read_table(out / "accuracy.csv").set_index("source")
    assert table[["learner", "accuracy", "reaches"]].to_dict("index") == {
        "evaluate": {"learner": "full", "accuracy": 0.978, "reaches": True},
        "search": {"learner": "full", "accuracy": 0.99, "reaches": True},
        "demonstrations": {"learner": NEAREST, "accuracy": 0.977, "reaches": False},
        "ceiling": {"learner": "perfect", "accuracy": 0.977, "reaches": False},
    }
    assert table.loc["search", "q1"] == 0.98 and table.loc["ceiling", "scenes"] == 6
    assert read_table(out / "convergence.csv")["fits"].tolist() == [4]


def test_the_paper_s_rate_is_that_of_the_report():
    study = compose([]).studies.chance
    assert (study.accuracy, study.q1, study.q3) == PAPER_ACCURACY[9]
