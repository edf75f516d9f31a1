"""Every learner has as many settings, a search goes on where its table ends, and the best setting is refitted."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, model_dir
from pipeline.artifacts.scenes import train_pool
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from studies.search import search, stage
from studies.search.fits import default
from tests.factories import labelled_demos, labelled_queries, rendered_scenes

SMALL = [
    "profile=smoke", "workers=1", "clearance.steps=3", "train.steps=2", "variants.irl_ranked.steps=2",
    "studies.search.settings=5", "studies.search.together=2", "studies.search.startup=2",
    "studies.search.ensembles=1", "studies.search.members=2", "studies.search.repeats=2",
]  # fmt: skip
main = stage.main  # of the fixture `out`


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes, demonstrations and queries of one validation seed and of two seeds."""
    folder = tmp_path_factory.mktemp("search")
    cfg = paths(folder)
    seeds = [*cfg.seeds, *cfg.validation_seeds]
    pools = dict.fromkeys(map(train_pool, seeds), (4, "train"))
    pools |= {"val_scenes": (5, "train"), "new_scenes": (5, "train"), "new_items": (5, "unseen")}
    scenes = rendered_scenes(cfg, pools)
    cfg.seeds = seeds
    labelled_demos(cfg, scenes)
    labelled_queries(cfg, scenes, list(pools), 20)
    return folder


def paths(folder: Path, *overrides: str) -> DictConfig:
    folders = [f"paths.{name}={folder / name}" for name in ("scenes", "demos", "train", "irl", "clearance")]
    return compose([*SMALL, *folders, *overrides])


@pytest.fixture(scope="module")
def table(folder: Path) -> pd.DataFrame:
    """The search of three learners, one of each kind."""
    search.search(paths(folder, "protocol=validation"), ["full", "irl_ranked", "clearance"], folder / "settings.csv")
    return read_table(folder / "settings.csv")


def test_every_learner_has_its_default_first_and_as_many_settings_as_the_others(folder: Path, table: pd.DataFrame):
    cfg = paths(folder)
    counts = table.groupby(["learner", "origin"]).size().unstack()
    assert (counts == [1, 2, 5]).all(axis=None) and list(counts.columns) == ["ensemble", "repeat", "sampled"]
    for learner in ("full", "irl_ranked", "clearance"):
        rows = table[table["learner"] == learner]
        first = rows[rows["origin"] == "sampled"].iloc[0]
        assert {name: first[name] for name in default(cfg, learner)} == default(cfg, learner)
        assert first["new_scenes"] == rows[rows["origin"] == "repeat"].iloc[0]["new_scenes"], "the same fit"
        ensemble = rows[rows["origin"] == "ensemble"].iloc[0]
        best = rows[rows["origin"] == "sampled"].set_index("number")["new_scenes"]
        assert best[ensemble["number"]] == best.max() and ensemble["members_averaged"] == 2


def test_an_interrupted_search_goes_on_as_if_it_had_not_been(folder: Path, table: pd.DataFrame, tmp_path: Path):
    cfg, kept = paths(folder, "protocol=validation"), table[table["learner"] == "clearance"]
    write_table(tmp_path / "settings.csv", kept[(kept["origin"] != "ensemble") & (kept["number"] < 2)])
    search.search(cfg, ["clearance"], tmp_path / "settings.csv")
    again = read_table(tmp_path / "settings.csv").drop(columns="seconds")
    pd.testing.assert_frame_equal(again, kept[again.columns].reset_index(drop=True), check_dtype=False)


def test_an_unknown_learner_is_named():
    with pytest.raises(InputError, match="learner 'nobody': expected some of full"):
        search.main(["nobody"])


@pytest.fixture(scope="module")
def cfg(folder: Path, table: pd.DataFrame) -> Iterator[DictConfig]:
    """The settings of the stage, with predictions of the default that are right on every second path."""
    cfg = paths(folder)
    for variant in set(table["learner"]):
        parts = []
        for seed in cfg.protocol.seeds:
            for user in cfg.evaluate.users:
                for split in cfg.protocol.splits:
                    valid = np.arange(20) % 4 < 2
                    part = pd.DataFrame(
                        {"scene": 0, "query": range(20), "valid": valid, "p": valid ^ (np.arange(20) % 2)}
                    )
                    parts.append(part.assign(seed=seed, user=user, split=split, n_demos=cfg.main_n_demos))
        path = model_dir(cfg, variant) / "predictions.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_table(path, pd.concat(parts)[PREDICTION_COLUMNS].astype({"p": float}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage, "TABLE", folder / "settings.csv")
        yield cfg


def test_the_best_setting_stands_beside_the_default_in_every_split(cfg: DictConfig, out: Path, table: pd.DataFrame):
    summary = read_table(out / "summary.csv").set_index(["learner", "setting", "split"])
    assert len(summary) == 3 * 2 * 3 and (summary["seeds"] == 2).all()
    assert (summary.xs("default", level="setting")[["accuracy", "balanced", "q1", "q3"]] == 0.5).all(axis=None)
    learners = read_table(out / "learners.csv").set_index("learner")
    judged = table[table["origin"] != "repeat"]
    for learner, row in learners.iterrows():
        of_learner = judged[judged["learner"] == learner]
        assert row["settings"] == 6 and row["best"] == of_learner["new_scenes"].max()
        assert row["passed"] == of_learner["passed"].mean()
