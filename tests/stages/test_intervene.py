"""The stage changes nothing but what a question names, and answers for models and world alike."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.models.trained import load_model
from pipeline.stages.intervene import main  # noqa: F401  # of the fixture `out`
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from pipeline.world.render import Palette, render_scenes
from tests.factories import models_in_rendered_scenes

pytestmark = pytest.mark.slow

SCENES = 4


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    settings = ["intervene.paths=6", "intervene.placements=1", "intervene.more_scenes=2"]
    settings += [f"+questions@questions.{name}={name}" for name in ("table_top_onyx", "remove_glass")]
    return models_in_rendered_scenes(tmp_path_factory.mktemp("intervene"), ["full"], SCENES, *settings)


def test_a_models_answer_is_its_mean_probability_before_and_after(cfg: DictConfig, out: Path):
    """The same numbers without a causal model: predictions on the images that the stage wrote."""
    arrays, scenes = read_arrays(out / "images.npz"), read_scenes(Path(cfg.paths.scenes))
    palette, user, seed = Palette(read_catalogue(Path(cfg.paths.data))), "normal", cfg.protocol.seeds[1]
    onyx = render_scenes(scenes.layouts["new_items"], ["onyx"] * SCENES, range(SCENES), palette)
    effects = read_table(out / "effects.parquet").query(f"user == '{user}' and seed == {seed}")
    model = load_model(cfg, "full", user, seed, cfg.main_n_demos)
    for question, image in {"add_cutlery": arrays["images"][2, 0], "table_top_onyx": onyx}.items():
        rows = effects[effects["question"] == question].sort_values("scene")[:SCENES]
        for column, seen in (("baseline", scenes.images["new_items"]), ("intervened", image)):
            p = model.probability(seen, arrays["z_theta"]).mean(-1)
            np.testing.assert_allclose(rows[column], p, atol=1e-6)


def test_one_unseen_item_of_the_symbol_is_added_and_nothing_else_changes(cfg: DictConfig, out: Path):
    scenes, added = read_scenes(Path(cfg.paths.scenes)), read_table(out / "layouts.parquet")
    unseen = read_catalogue(Path(cfg.paths.data)).pool("unseen")
    before = scenes.layouts["new_items"]
    for (pool, scene), items in added.groupby(["pool", "scene"]):
        count = before.present[scene].sum()
        np.testing.assert_array_equal(items["item"].to_numpy()[:-1], before.item[scene, :count])
        np.testing.assert_array_equal(items["x_m"].to_numpy()[:-1], before.centre[scene, :count, 0])
        assert SYMBOLS[items["symbol"].iloc[-1]] == str(pool).split("-")[0]
        assert items["item"].iloc[-1] in unseen
    before = read_scenes(Path(cfg.paths.scenes)).images["new_items"]
    after = read_arrays(out / "images.npz")["images"]
    assert after.shape == (len(SYMBOLS), 1, SCENES, 100, 100, 3)
    changed = (after != before).any(-1).mean((-1, -2))  # share of each image's pixels
    assert (changed > 0).all()
    assert (changed < 0.15).all()  # the largest plate and its shadow


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
