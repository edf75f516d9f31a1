"""The stage changes nothing but what a question names, and answers for models and world alike."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import read_interventions, read_scenes
from pipeline.models.trained import load_model
from pipeline.stages.intervene import main  # noqa: F401  # of the fixture `out`
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import valid
from tests.factories import models_in_rendered_scenes

pytestmark = pytest.mark.slow

SCENES = 4


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    settings = ["intervene.paths=6", "intervene.placements=1", "intervene.more_scenes=2"]
    settings += [f"+questions@questions.{name}={name}" for name in ("table_top_onyx", "remove_glass")]
    return models_in_rendered_scenes(tmp_path_factory.mktemp("intervene"), ["full"], SCENES, *settings)


def test_answers_of_model_and_world_are_their_means_before_and_after(cfg: DictConfig, out: Path):
    """The same numbers without a causal model: by predictions on the images that the stage wrote, and by the rules."""
    scenes, palette = read_scenes(Path(cfg.paths.scenes)), Palette(read_catalogue(Path(cfg.paths.data)))
    layouts, z_theta = scenes.layouts["new_items"], read_arrays(out / "images.npz")["z_theta"]
    added, onyx = read_interventions(out, layouts), render_scenes(layouts, ["onyx"] * SCENES, range(SCENES), palette)
    user, seed = "careful", cfg.protocol.seeds[1]
    after = {f"add_{name}": (added.images[i], added.layouts[i]) for i, name in enumerate(SYMBOLS)}
    after["table_top_onyx"] = onyx, layouts
    effects = read_table(out / "effects.parquet").query(f"user == '{user}' and seed == {seed}")
    model = load_model(cfg, "full", user, seed, cfg.main_n_demos)
    before = valid(layouts, z_theta, cfg.users[user]).mean(-1)
    for question, (image, changed) in after.items():
        rows = effects[effects["question"] == question].sort_values("scene")[:SCENES]
        for column, pictures in (("baseline", scenes.images["new_items"]), ("intervened", image)):
            np.testing.assert_allclose(rows[column], model.probability(pictures, z_theta).mean(-1), atol=1e-6)
        truth = valid(changed, z_theta, cfg.users[user]).mean(-1) - before
        np.testing.assert_allclose(rows["true_effect"], truth, atol=1e-6)


def test_one_unseen_item_of_the_symbol_is_added_and_nothing_else_changes(cfg: DictConfig, out: Path):
    scenes, unseen = read_scenes(Path(cfg.paths.scenes)), read_catalogue(Path(cfg.paths.data)).pool("unseen")
    before = scenes.layouts["new_items"]
    added = read_interventions(out, before)
    for symbol, (after, alone) in enumerate(zip(added.layouts, added.placed, strict=True)):
        fresh = after.present & ~before.present
        assert (fresh.sum(1) == 1).all() and alone.present.all() and np.isin(added.item[symbol], unseen).all()
        for name in ("item", "symbol", "centre"):
            now, then = getattr(after, name), getattr(before, name)
            np.testing.assert_array_equal(now[before.present], then[before.present])
            np.testing.assert_array_equal(getattr(alone, name)[:, 0], now[fresh])
        assert (alone.symbol == symbol).all()
    changed = (added.images != scenes.images["new_items"]).any(-1).mean((-1, -2))  # share of each image's pixels
    assert (changed > 0).all() and (changed < 0.15).all()  # the largest plate and its shadow


def test_the_world_answers_by_its_rules_and_another_user_and_back_again_is_no_change(out: Path):
    effects = read_table(out / "effects.parquet")
    by_question = effects.groupby(["question", "user"])["true_effect"].agg(["min", "max"])
    added = by_question[[name.startswith("add_") for name, _ in by_question.index]]
    assert (added["max"] <= 0).all() and (added["min"] < 0).any()
    assert (by_question.xs("aggressive", level="user").filter(like="add_", axis=0) == 0).all(axis=None)
    assert (by_question.loc["table_top_onyx"] == 0).all(axis=None)
    assert (by_question.loc["remove_glass", "min"] >= 0).all()
    there = effects[(effects["user"] == "careful") & (effects["question"] == "another_user_normal")]
    back = effects[(effects["user"] == "normal") & (effects["question"] == "another_user_careful")]
    for effect in ("effect", "true_effect"):
        np.testing.assert_array_equal(there[effect].to_numpy(), -back[effect].to_numpy())
    assert (there["true_effect"] > 0).any()
