"""The robustness study judges the same models in the same scenes, corrupted."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import read_table, write_arrays
from pipeline.artifacts.scenes import SceneSet, read_scenes, write_scenes
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.registry import build
from pipeline.runtime.errors import InputError
from studies.robustness.stage import main
from tests.factories import (
    labelled_demos,
    labelled_queries,
    models_in_rendered_scenes,
    same_scenes_for_training,
    save_model,
    with_evidence,
)
from tests.stages.facts import names_a_missing_model, refuses

pytestmark = pytest.mark.slow
SCENES, PATHS, VARIANTS = 3, 12, ("full", "clearance")
STUDY = "studies.robustness"


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Untrained VAEs, and clearance models that find no item relevant: they accept every path."""
    folder = tmp_path_factory.mktemp("robustness")
    settings = [f"{STUDY}.scenes={SCENES}", f"{STUDY}.mislabelled={{clearance: [0.1, 0.2]}}", "clearance.steps=2"]
    cfg = models_in_rendered_scenes(folder, VARIANTS, SCENES, *settings, f"paths.demos={folder / 'demos'}")
    OmegaConf.set_struct(cfg, False)
    for user, seed in product(cfg.users, cfg.protocol.seeds):
        model = build(cfg.variants.clearance, seed)
        assert isinstance(model, ClearanceModel)
        with torch.no_grad():
            model.weight.zero_()
            model.weight[..., 0] = -1e4
        save_model(cfg, "clearance", with_evidence(model), user, seed)
    scenes = same_scenes_for_training(cfg, "new_items")
    labelled_demos(cfg, scenes)
    labelled_queries(cfg, scenes, ["new_items"], PATHS)
    even = {user: np.random.default_rng(0).random((5, 5)) for user in cfg.users}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", even)
    return cfg


@pytest.fixture
def summary(out: Path) -> pd.DataFrame:
    """One row a corruption, strength and variant."""
    return read_table(out / "summary.csv").astype({"strength": str})


def test_the_accuracy_is_the_mean_over_users_and_seeds_and_the_loss_is_the_rest(out, summary):
    keys = ["corruption", "strength", "variant"]
    means = read_table(out / "accuracy.parquet").groupby(keys)["accuracy"].mean()
    table = summary.set_index(keys)
    np.testing.assert_allclose(table["accuracy"], means.loc[table.index], atol=2e-6)
    before = summary.query("corruption == 'none'").set_index("variant")["accuracy"]
    np.testing.assert_allclose(
        summary["loss"], before.loc[summary["variant"]].to_numpy() - summary["accuracy"], atol=2e-6
    )
    assert (summary["loss_ci_low"] <= summary["loss"]).all() and (summary["loss"] <= summary["loss_ci_high"]).all()


def test_a_model_that_ignores_the_image_loses_no_accuracy_to_corruptions(summary):
    """Neither the prior of positions nor a clearance model without relevant items looks."""
    images_only = summary[~summary["corruption"].isin(["clutter", "mislabelled"]) & (summary["variant"] != "full")]
    assert len(images_only) > 10
    assert (images_only[["loss", "loss_ci_low", "loss_ci_high"]] == 0).all(axis=None)


def test_a_model_that_accepts_every_path_is_unsafe_and_loses_accuracy_to_clutter(summary):
    accepting = summary.query("variant == 'clearance' and corruption in ['none', 'clutter']")
    assert (accepting["unsafe"] == 1).all()
    assert accepting["accuracy"].is_monotonic_decreasing and accepting["loss"].iloc[-1] > 0


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "clearance", tmp_path / "out")


def test_a_pool_without_queries_and_a_table_top_of_training_are_refused(cfg: DictConfig, tmp_path: Path):
    refuses(main, cfg, f"{STUDY}.textures", ["oak"], f"{STUDY}.textures", tmp_path / "out")
    scenes, changed = read_scenes(Path(cfg.paths.scenes)), cfg.copy()
    changed.paths.scenes, changed.studies.robustness.split = str(tmp_path / "scenes"), "new_scenes"
    pools = ({**x, "new_scenes": x["new_items"]} for x in (scenes.images, scenes.layouts, scenes.appearances))
    write_scenes(tmp_path / "scenes", SceneSet(*pools))  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="new_scenes"):
        main(changed, tmp_path / "out")
