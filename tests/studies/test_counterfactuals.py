"""The study removes the item it says and nothing else, and moves an item exactly as far as the path asks."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal.counterfactual import item_subsets, select_items
from pipeline.causal.mechanisms import model_scm, renderer
from pipeline.causal.scm import chance_of_change
from pipeline.models.trained import load_model, predict_all
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, empty
from pipeline.world.render import REACH_M, Palette
from pipeline.world.rules import clearance, slack
from studies.counterfactuals import stage
from studies.counterfactuals.stage import crossing, outward_normal, score_moves, translate_item
from tests.factories import models_in_rendered_scenes

SCENES, PATHS = 6, 24
VARIANTS = ("full", "clearance")
ROOM_M = 0.03  # around an item's shadow


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Six scenes of unseen items, and untrained models of two variants and two seeds."""
    sizes = {"scenes": SCENES, "paths": PATHS, "moved_scenes": 3, "move_step": 0.02, "move_steps": 6, "root_seed": 5}
    overrides = [f"studies.counterfactuals.{name}={value}" for name, value in sizes.items()]
    return models_in_rendered_scenes(tmp_path_factory.mktemp("counterfactuals"), VARIANTS, SCENES, *overrides)


@pytest.mark.slow
def test_necessity_is_the_chance_of_change_by_the_scm(cfg: DictConfig):
    noise = stage.read_noise(cfg)
    present, subsets = noise["O"].present, item_subsets(noise["O"].present)
    units = stage.take(noise, subsets.scene)
    models = {"careful": load_model(cfg, "clearance", "careful", 0, cfg.main_n_demos)}
    scm = model_scm(models, renderer(Palette(read_catalogue(Path(cfg.paths.data))))).do(S="careful")
    images = scm.do(O=select_items(units["O"], subsets.kept)).entail(units, "I")["I"]
    p = predict_all(cfg, ["careful"], images, units["Z_theta"], "test")["clearance"][0, 0]
    necessity, factual = subsets.by_question(p).necessity, scm.expectation("V", noise)
    for slot in range(present.shape[1]):
        without = select_items(noise["O"], present & (np.arange(present.shape[1]) != slot))
        expected = chance_of_change(False, factual, scm.do(O=without).expectation("V", noise))
        np.testing.assert_allclose(necessity[..., slot], expected, atol=1e-4)


@pytest.mark.slow
def test_a_removed_item_leaves_every_pixel_far_from_it(cfg: DictConfig, out: Path):
    examples, arrays = read_table(out / "examples.csv"), read_arrays(out / "examples.npz")
    scenes = read_scenes(Path(cfg.paths.scenes))
    layouts, images = scenes.layouts["new_items"], scenes.images["new_items"]
    x, y = np.meshgrid((np.arange(SIDE) + 0.5) / SIDE, 1 - (np.arange(SIDE) + 0.5) / SIDE)
    kinds = examples["example"].unique()
    assert len(kinds) > 1
    for i, kind in enumerate(kinds):
        scene = next(s for s in range(SCENES) if (images[s] == arrays["factual"][i]).all())
        for item in examples[examples["example"] == kind].drop_duplicates("slot").itertuples():
            reach = layouts.half_length[scene, item.slot] + layouts.radius[scene, item.slot] + REACH_M + ROOM_M
            far = np.hypot(x - item.x_m, y - item.y_m) > reach
            for one, other in (("without", "factual"), ("alone", "empty")):
                changed = (arrays[one][i, item.slot] != arrays[other][i]).any(-1)
                assert changed.any() and not changed[far].any()


def test_a_glass_moves_off_a_straight_path_by_what_the_margin_lacks():
    layouts, slot, z = empty(1, 2), np.array([0]), np.array([[0.5, 0.5]])
    layouts.symbol[0, 0], layouts.item[0, 0], layouts.radius[0, 0] = SYMBOLS.index("glass"), 3, 0.04
    layouts.centre[0, 0] = 0.5, 0.52
    direction = outward_normal(layouts, slot, z)
    np.testing.assert_allclose(direction, [[-(0.5**0.5), 0.5**0.5]])  # the path runs up the diagonal
    steps = np.linspace(0, 0.12, 121)
    moved = translate_item(layouts, slot, direction, steps)
    margins = {symbol: 0.045 if symbol == "glass" else None for symbol in SYMBOLS}
    room = slack(moved, clearance(moved, np.repeat(z, 121, axis=0)[:, None]), margins)
    expected = 0.04 + 0.045 - 0.02 * 0.5**0.5
    assert crossing(steps, room.T, 0.0) == pytest.approx(expected, abs=0.0005)
    np.testing.assert_array_equal(layouts.centre[0, 0], [0.5, 0.52])  # the scene itself stays as it was


@pytest.mark.parametrize(
    ("values", "expected"),
    [([0.1, 0.3, 0.7], 1.5), ([0.6, 0.1, 0.1], 0.0), ([0.1, 0.2, 0.5], np.nan), ([0.0, 1.0, 0.0], 0.5)],
)
def test_a_crossing_is_the_first_one_linear_between_steps(values: list, expected: float):
    np.testing.assert_allclose(crossing(np.arange(3.0), np.array([values]), 0.5), [expected])


def test_moves_are_scored_where_a_model_rejects_first_and_accepts_later():
    true_m = np.array([0.02, 0.04, 0.06])
    moved_m = np.array([[0.03, np.nan, 0.05], [0.02, 0.04, 0.06]])
    row = score_moves(moved_m, np.array([[True, True, True], [True, True, False]]), true_m)
    assert (row["cases"], row["true_m"], row["found"]) == pytest.approx((3, 0.04, 0.8))
    assert (row["rejected"], row["error_m"]) == pytest.approx((5 / 6, 0.005))
    assert row["constant_error_m"] == pytest.approx((0.02 + 0.02 + 0.02 + 0) / 4)
    assert np.isnan(row["error_m_ci_low"]) and np.isnan(row["found_ci_high"]), "too few for an interval"
    many = score_moves(np.tile(moved_m, (2, 4)), np.ones((4, 12), bool), np.tile(true_m, 4))
    assert many["error_m_ci_low"] < many["error_m"] < many["error_m_ci_high"]
    assert score_moves(moved_m, np.zeros((2, 3), bool), true_m) == {"cases": 3, "rejected": 0, "true_m": true_m.mean()}
