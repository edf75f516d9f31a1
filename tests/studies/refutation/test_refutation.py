"""The refutation study asks the same models questions whose true answer is known."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import read_interventions, read_scenes
from pipeline.causal.refuters import TUNED_NOTE
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, point_segment_distance
from pipeline.world.render import REACH_M
from studies.refutation import stage as refutation
from studies.refutation.stage import main
from tests.factories import labelled_demos, models_in_rendered_scenes, same_scenes_for_training, symbols_added
from tests.stages.facts import names_a_missing_model, refuses

pytestmark = pytest.mark.slow
STUDY = "studies.refutation"
SCENES, PATHS, VARIANTS = 5, 40, ("full", "clearance")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    folder = tmp_path_factory.mktemp("refutation")
    settings = [f"{STUDY}.scenes=4", f"{STUDY}.dummy_outcome=[clearance]", f"paths.demos={folder / 'demos'}"]
    cfg = models_in_rendered_scenes(folder, VARIANTS, SCENES, *settings, "clearance.steps=5")
    symbols_added(cfg, read_scenes(Path(cfg.paths.scenes)), PATHS)
    labelled_demos(cfg, same_scenes_for_training(cfg, "new_items"))
    return cfg


@pytest.fixture
def summary(out: Path) -> pd.DataFrame:
    """One row a refuter, setting, variant, user and symbol."""
    return read_table(out / "summary.csv")


def test_a_refuter_passes_if_its_verdict_is_the_expected_one(summary):
    assert (summary["passed"] == (summary["verdict"] == summary["expected"])).all()
    halves = summary["refuter"] == "data_subset"
    assert (summary[~halves]["expected"] == "negligible").all()
    assert summary[halves]["agreement"].between(0, 1).all() and summary[~halves]["agreement"].isna().all()


def test_the_mean_of_the_effects_is_the_summary_s(out: Path, summary):
    keys = ["refuter", "setting", "variant", "user", "symbol"]
    effects = read_table(out / "effects.parquet")
    judged = summary[summary["refuter"] != "data_subset"].set_index(keys)
    np.testing.assert_allclose(judged["effect"], effects.groupby(keys)["effect"].mean().loc[judged.index], atol=1e-5)
    items = effects[effects["refuter"] == "none"].groupby(keys[2:])["effect"].mean()
    np.testing.assert_allclose(summary["item_effect"], items.loc[summary.set_index(keys[2:]).index], atol=1e-5)


def test_another_table_top_has_the_same_light_with_and_without_an_added_item(cfg: DictConfig):
    scenes, catalogue = read_scenes(Path(cfg.paths.scenes)), read_catalogue(Path(cfg.paths.data))
    added, first = read_interventions(Path(cfg.paths.intervene), scenes.layouts["new_items"]), slice(4)
    elsewhere = refutation.render_elsewhere(cfg, scenes, "new_items", added)
    assert list(elsewhere) == catalogue.texture_names("unseen")
    centres = (np.arange(SIDE) + 0.5) / SIDE
    pixels = np.stack(np.broadcast_arrays(centres[None, :], 1 - centres[:, None]), -1)  # (row, column, 2) [m]
    for images in elsewhere.values():
        for after, item in zip(images[1:], added.placed, strict=True):
            ends = item.ends[first, 0, :, None, None]
            distance = point_segment_distance(pixels, ends[:, 0], ends[:, 1]) - item.radius[first, :, None]
            change = np.abs(after.astype(int) - images[0])
            assert change[distance > REACH_M].max() <= 1 < change.max()  # a shadow's last trace may turn a rounding


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "clearance", tmp_path / "out")


@pytest.mark.parametrize(("name", "value"), [("far_m", 1.4), ("textures", "glass")])
def test_settings_that_no_scene_or_table_top_fits_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value):
    refuses(main, cfg, f"{STUDY}.{name}", value, f"{STUDY}.{name}", tmp_path / "out")


def test_only_the_placebo_that_perception_was_tuned_against_carries_the_note(summary):
    noted = summary["note"].fillna("") == TUNED_NOTE
    assert (noted == ((summary["refuter"] == "placebo_treatment") & (summary["setting"] == "piece=1"))).all()
