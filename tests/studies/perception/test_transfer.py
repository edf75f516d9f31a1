"""Clearance models are judged on any path-traced split, with the truth of the true footprints."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from making.render.read import read_rendered, sheet
from pipeline.runtime.errors import InputError
from pipeline.world.images import write_png
from pipeline.world.rules import valid
from pipeline.world.symbols import SYMBOLS
from studies.perception.accuracy import summarised, tables_and_paths
from studies.perception.transfer import Transfer, draw_starts, headlines, transfer
from tests.factories import untrained_models, with_value

PICTURES, SCENES, SPLIT, SEEDS = Path("rendered/pictures"), 3, "any_name", [0, 1]
pytestmark = pytest.mark.skipif(not PICTURES.is_dir(), reason=f"{PICTURES} is absent: dvc pull rendered/pictures.dvc")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Untrained models, and a split of the first scenes of validation_taught."""
    folder = tmp_path_factory.mktemp("transfer")
    source, split = PICTURES / "validation_taught", folder / SPLIT
    tables = read_rendered(source)
    split.mkdir()
    for name in ("scenes.csv", "items.csv"):
        table = pd.read_csv(source / name)
        table[table["scene"] < SCENES].to_csv(split / name, index=False)
    differences = {symbol: images - tables.images for symbol, images in tables.with_item.items()}
    for name, images in ({"scene": tables.images, "empty": tables.empty} | differences).items():
        write_png(split / f"{name}.png", sheet(images[:SCENES]))
    return with_value(untrained_models(folder, SEEDS), f"studies.perception.folder={folder}")


@pytest.fixture(scope="module")
def results(cfg: DictConfig) -> Transfer:
    return transfer(with_value(cfg, f"studies.perception.rendered=[{SPLIT}]"))


def test_every_user_seed_and_scene_is_judged_with_and_without_the_empty_table(cfg: DictConfig, results: Transfer):
    keys = ["source", "detector", "user", "seed", "scene"]
    assert not results.accuracy.duplicated(keys).any()
    assert len(results.accuracy) == 2 * len(cfg.evaluate.users) * len(SEEDS) * SCENES
    assert set(results.accuracy["source"]) == {SPLIT}


def test_a_question_s_truth_is_the_change_in_the_share_of_valid_paths(cfg: DictConfig, results: Transfer):
    tables, z = tables_and_paths(cfg, SPLIT)
    asked = results.verdicts[results.verdicts["detector"] == "segmenter"].set_index(["user", "symbol"])
    assert list(asked.index) == [(user, symbol) for user in cfg.evaluate.users for symbol in SYMBOLS]
    for (user, symbol), truth in asked["truth"].items():
        shares = [valid(x, z, cfg.users[user]).mean() for x in (tables.layouts, tables.layouts_with_item[symbol])]
        assert truth == pytest.approx(shares[1] - shares[0])


def test_starts_are_invalid_and_their_nearest_paths_are_valid(cfg: DictConfig):
    for starts in draw_starts(cfg, SPLIT, read_rendered(Path(cfg.studies.perception.folder) / SPLIT)).values():
        layouts = starts.layouts[starts.scene]
        assert not valid(layouts, starts.z[:, None], starts.margins).any()
        moved = (starts.nearest != starts.z).any(-1)  # a start stays where no lattice point is valid
        assert moved.any() and valid(layouts[moved], starts.nearest[moved, None], starts.margins).all()


def test_a_path_found_is_at_most_one_of_valid_and_unsafe(results: Transfer):
    assert set(zip(results.search["user"], results.search["detector"], strict=True)) == {
        (user, detector) for user in ("careful", "normal") for detector in ("segmenter", "segmenter_empty")
    }
    assert (results.search["success"] + results.search["unsafe"] <= 1).all()


def test_a_split_without_added_items_is_refused(cfg: DictConfig):
    other = with_value(cfg.copy(), f"studies.perception.folder={PICTURES}")
    with pytest.raises(InputError, match=r"train has no pictures with an added item: leave this split out"):
        transfer(with_value(other, "studies.perception.rendered=[train]"))


def test_means_are_over_scenes_and_users_and_quartiles_over_seeds():
    scene = {"source": "split", "detector": "segmenter"}
    rows = pd.DataFrame(
        [
            scene | {"user": user, "seed": seed, "scene": i, "top": top, "accuracy": accuracy}
            for seed, shift in enumerate((0.0, 0.1, 0.2))
            for i, top in enumerate(("wood", "wood", "cloth"))
            for user, accuracy in (("careful", 0.3 * i + shift), ("normal", 0.1 + shift))
        ]
    )
    table = summarised(rows).set_index(["top", "user"])
    assert table.loc[("all", "careful"), "accuracy"] == pytest.approx(0.4)
    assert table.loc[("wood", "careful"), ["scenes", "seeds", "accuracy"]].tolist() == pytest.approx([2, 3, 0.25])
    assert table.loc[("all", "all"), ["q1", "accuracy", "q3"]].tolist() == pytest.approx([0.25, 0.3, 0.35])


def test_headlines_are_without_the_empty_table_and_count_the_verdicts_of_the_worse_split():
    splits = {"taught_tops": "a", "held_out_tops": "b"}
    keys = [(source, detector) for source in "ab" for detector in ("segmenter", "segmenter_empty")]
    accuracy = pd.DataFrame(keys, columns=["source", "detector"])
    accuracy = accuracy.assign(user="all", top="all", accuracy=[0.9, 1.0, 0.8, 1.0])
    verdicts = pd.DataFrame([key for key in keys for _ in range(2)], columns=["source", "detector"])
    verdicts["right"] = np.array([True, True, False, False, True, False, True, True])
    assert headlines(splits, accuracy, verdicts) == {"taught_tops": 0.9, "held_out_tops": 0.8, "verdicts_right": 1}
