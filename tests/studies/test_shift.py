"""Study shift: disturbances do what their strength says, and models are judged under them and under another rule."""

from dataclasses import fields, replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import read_table, write_arrays
from pipeline.artifacts.scenes import read_scenes
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.trained import build
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import (
    SIDE,
    SYMBOLS,
    Layouts,
    empty,
    point_segment_distance,
    random_layouts,
    segment_distance,
)
from pipeline.world.rules import Margins
from studies.shift.stage import (
    CORRUPTIONS,
    OWN_RULE,
    PROXIMITY,
    add_clutter,
    main,
    proximity,
)
from tests.factories import (
    ITEMS,
    RULES,
    labelled_demos,
    labelled_queries,
    models_in_rendered_scenes,
    same_scenes_for_training,
    save_model,
    symbols_added,
    with_evidence,
)
from tests.stages.facts import names_a_missing_model, refuses

POOL = np.arange(4)
STRONG = {"shade": 0.5, "tint": 0.4, "blur": 2.0, "noise": 0.05, "arm": 0.3}
ALL: Margins = {symbol: 0.045 for symbol in SYMBOLS}
SCENES, PATHS, VARIANTS = 3, 12, ("full", "clearance")
seeds = st.integers(0, 2**32 - 1)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def grey(level: int, count: int = 1) -> np.ndarray:
    return np.full((count, SIDE, SIDE, 3), level, np.uint8)


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corruption_of_hardly_any_strength_changes_nothing_and_a_strong_one_all_but_its_input(name: str):
    images = rng(1).integers(0, 256, (3, SIDE, SIDE, 3), dtype=np.uint8)
    np.testing.assert_array_equal(CORRUPTIONS[name](rng(), images, 1e-9), images)
    before = images.copy()
    corrupted = CORRUPTIONS[name](rng(), images, STRONG[name])
    np.testing.assert_array_equal(images, before)
    assert all((after != old).any() for after, old in zip(corrupted, before, strict=True))


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_clutter_adds_items_that_keep_clearances_and_moves_none(seed: int):
    layouts = random_layouts(rng(seed), 3, ITEMS, POOL, RULES)
    fuller = add_clutter(rng(seed), layouts, 2, ITEMS, POOL, RULES)
    np.testing.assert_array_equal(fuller.present.sum(1), layouts.present.sum(1) + 2)
    for scene in range(len(layouts)):
        slots, before = np.flatnonzero(fuller.present[scene]), np.flatnonzero(layouts.present[scene])
        for f in fields(layouts):
            now, then = (getattr(x, f.name)[scene, before] for x in (fuller, layouts))
            np.testing.assert_array_equal(now, then)
        ends, radius = fuller.ends[scene, slots], fuller.radius[scene, slots]
        apart = segment_distance(ends[:, None], ends) - radius[:, None] - radius
        assert apart[~np.eye(len(slots), dtype=bool)].min() >= RULES.clear_of_items - 1e-9
        for p in (P_INIT, P_F):
            assert (point_segment_distance(p, ends[:, 0], ends[:, 1]) - radius >= RULES.clear_of_ends - 1e-9).all()
    with pytest.raises(ValueError, match="the scene is too full"):
        add_clutter(rng(), layouts, 1, ITEMS, POOL, replace(RULES, clear_of_items=0.9))


def glasses(*centres: tuple[float, float]) -> Layouts:
    """One scene with a glass of 3 cm radius at each of these places [m]."""
    layouts = empty(1, len(centres) + 1)
    for slot, centre in enumerate(centres):
        layouts.symbol[0, slot], layouts.item[0, slot] = SYMBOLS.index("glass"), 0
        layouts.centre[0, slot], layouts.radius[0, slot], layouts.scale[0, slot] = centre, 0.03, 1.0
    return layouts


def test_proximity_counts_a_glass_with_a_neighbour_even_if_that_is_far_from_the_path():
    straight = np.array([[[0.5, 0.5]]])
    assert proximity(glasses((0.5, 0.5)), straight, ALL, 0.2)[0, 0]
    assert not proximity(glasses((0.5, 0.5), (0.6, 0.3)), straight, ALL, 0.2)[0, 0]
    assert proximity(glasses((0.5, 0.5), (0.8, 0.3)), straight, ALL, 0.2)[0, 0]
    assert proximity(glasses((0.5, 0.5), (0.6, 0.3)), straight, dict.fromkeys(SYMBOLS), 0.2)[0, 0]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Untrained VAEs, and clearance models that find no item relevant: they accept every path."""
    folder = tmp_path_factory.mktemp("shift")
    small = [f"studies.shift.scenes={SCENES}", "clearance.steps=2", "scenes.prior_side=4"]
    cfg = models_in_rendered_scenes(folder, VARIANTS, SCENES, *small, f"paths.demos={folder / 'demos'}")
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
    symbols_added(cfg, read_scenes(Path(cfg.paths.scenes)), PATHS)
    even = {user: rng().random((5, 5)) for user in cfg.users}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", even)
    return cfg


@pytest.fixture
def disturbed(out: Path) -> pd.DataFrame:
    """One row a corruption, strength and variant."""
    return read_table(out / "disturbances.csv").astype({"strength": str})


@pytest.mark.slow
def test_a_model_that_ignores_the_image_loses_no_accuracy_to_corruptions(disturbed: pd.DataFrame):
    """Neither the prior of positions nor a clearance model without relevant items looks."""
    images_only = disturbed[
        ~disturbed["corruption"].isin(["clutter", "mislabelled"]) & (disturbed["variant"] != "full")
    ]
    assert len(images_only) > 10
    assert (images_only[["loss", "loss_ci_low", "loss_ci_high"]] == 0).all(axis=None)


@pytest.mark.slow
def test_a_model_that_accepts_every_path_is_unsafe_and_loses_accuracy_to_clutter(disturbed: pd.DataFrame):
    accepting = disturbed.query("variant == 'clearance' and corruption in ['none', 'clutter']")
    assert (accepting["unsafe"] == 1).all()
    assert accepting["accuracy"].is_monotonic_decreasing and accepting["loss"].iloc[-1] > 0


@pytest.mark.slow
def test_the_users_own_rule_loses_nothing_and_the_other_one_forgives_paths(cfg: DictConfig, out: Path):
    rules = read_table(out / "rules.csv").set_index(["family", "variant"])
    assert (rules.loc[OWN_RULE][["loss", "loss_ci_low", "loss_ci_high"]] == 0).all(axis=None)
    assert rules.loc[PROXIMITY]["valid"].iloc[0] > rules.loc[OWN_RULE]["valid"].iloc[0]
    total = read_table(out / "posterior.csv").groupby(["family", "variant", "seed", "user"])["probability"].sum()
    assert len(total) == 2 * len(cfg.evaluate.users) * len(cfg.protocol.seeds)
    np.testing.assert_allclose(total, 1, atol=1e-4)


@pytest.mark.slow
def test_a_missing_model_and_wrong_table_tops_and_seeds_are_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "clearance", tmp_path / "out")
    refuses(main, cfg, "studies.shift.textures", ["oak"], "studies.shift.textures", tmp_path / "out")
    refuses(main, cfg, "protocol.seeds", [0, 100], "seed100|s100", tmp_path / "out")
