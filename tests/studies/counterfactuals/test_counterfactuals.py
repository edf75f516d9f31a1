"""The study removes the item it says and nothing else, and moves items as far as the truth asks."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal.counterfactual import item_subsets, select_items
from pipeline.causal.mechanisms import model_scm, renderer
from pipeline.causal.scm import chance_of_change
from pipeline.models.trained import load_model
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS
from pipeline.world.render import REACH_M, Palette
from pipeline.world.rules import valid
from studies.counterfactuals import stage
from studies.counterfactuals.stage import main
from tests.factories import models_in_rendered_scenes
from tests.stages.facts import names_a_missing_model, refuses

pytestmark = pytest.mark.slow

SCENES, PATHS = 6, 24
VARIANTS = ("full", "clearance")
ROOM_M = 0.03  # around an item's shadow


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Six scenes of unseen items, and untrained models of two variants and two seeds."""
    sizes = {"scenes": SCENES, "paths": PATHS, "moved_scenes": 3, "move_step": 0.02, "move_steps": 6, "root_seed": 5}
    overrides = [f"studies.counterfactuals.{name}={value}" for name, value in sizes.items()]
    return models_in_rendered_scenes(tmp_path_factory.mktemp("counterfactuals"), VARIANTS, SCENES, *overrides)


@pytest.fixture(scope="module")
def examples(out: Path) -> pd.DataFrame:
    return read_table(out / "examples.csv")


def test_every_variant_and_every_user_with_a_margin_has_a_row(cfg: DictConfig, out: Path):
    noise = stage.read_noise(cfg)
    for table in (read_table(out / "summary.csv"), read_table(out / "moves.csv")):
        assert sorted(zip(table["variant"], table["user"], strict=True)) == sorted(
            (variant, user) for variant in VARIANTS for user in ("careful", "normal")
        )
    for row in read_table(out / "summary.csv").itertuples():
        share = 1 - valid(noise["O"], noise["Z_theta"], cfg.users[row.user]).mean()
        assert row.true_invalid == pytest.approx(share, abs=1e-5)


def test_attributions_have_a_row_for_every_seed_and_invalid_path_and_the_summary_counts_them(
    cfg: DictConfig, out: Path
):
    rows, noise = read_table(out / "attributions.parquet"), stage.read_noise(cfg)
    for (_, user), table in rows.groupby(["variant", "user"]):
        invalid = ~valid(noise["O"], noise["Z_theta"], cfg.users[user])
        assert len(table) == len(cfg.protocol.seeds) * invalid.sum()
    named = rows[rows["attributed"] >= 0]
    symbols = np.array(SYMBOLS)[noise["O"].symbol[named["scene"], named["attributed"]]]
    np.testing.assert_array_equal(named["attributed_symbol"], symbols)
    assert (rows.loc[rows["cause"] < 0, "cause_symbol"] == "").all()
    assert (rows["rejected"] == (rows["p"] <= 0.5)).all()
    rows, summary = read_table(out / "attributions.parquet"), read_table(out / "summary.csv")
    for row in summary[summary["right"].notna()].itertuples():
        table = rows[(rows["variant"] == row.variant) & (rows["user"] == row.user) & rows["rejected"]]
        single = table[table["cause"] >= 0]
        assert row.right == pytest.approx((single["attributed"] == single["cause"]).mean(), abs=1e-5)
        assert row.single == pytest.approx(len(single) / len(table), abs=1e-5)


def test_necessity_is_the_chance_of_change_by_the_scm(cfg: DictConfig):
    noise = stage.read_noise(cfg)
    subsets = item_subsets(noise["O"].present)
    units = stage.take(noise, subsets.scene)
    models = {"careful": load_model(cfg, "clearance", "careful", 0, cfg.main_n_demos)}
    scm = model_scm(models, renderer(Palette(read_catalogue(Path(cfg.paths.data))))).do(S="careful")
    kept = select_items(units["O"], subsets.kept)
    images = scm.do(O=kept).entail(units, "I")["I"]
    p = stage.predict_versions(cfg, ["careful"], units, images, "test")["clearance"][0, 0]
    necessity, factual = subsets.by_question(p).necessity, scm.expectation("V", noise)
    for slot in range(noise["O"].present.shape[1]):
        without = select_items(noise["O"], noise["O"].present & (np.arange(noise["O"].present.shape[1]) != slot))
        expected = chance_of_change(False, factual, scm.do(O=without).expectation("V", noise))
        np.testing.assert_allclose(necessity[..., slot], expected, atol=1e-4)


def test_a_removed_item_leaves_every_pixel_far_from_it(cfg: DictConfig, out: Path, examples: pd.DataFrame):
    arrays, scenes = read_arrays(out / "examples.npz"), read_scenes(Path(cfg.paths.scenes))
    layouts, images = scenes.layouts["new_items"], scenes.images["new_items"]
    x, y = np.meshgrid((np.arange(SIDE) + 0.5) / SIDE, 1 - (np.arange(SIDE) + 0.5) / SIDE)
    kinds = examples["example"].unique()
    assert len(kinds) > 1
    for i, kind in enumerate(kinds):
        items = examples[examples["example"] == kind].drop_duplicates("slot")
        np.testing.assert_array_equal(arrays["factual"][i], images[items["scene"].iloc[0]])
        for item in items.itertuples():
            index = item.scene, item.slot
            reach = layouts.half_length[index] + layouts.radius[index] + REACH_M + ROOM_M
            far = np.hypot(x - item.x_m, y - item.y_m) > reach
            for one, other in (("without", "factual"), ("alone", "empty")):
                changed = (arrays[one][i, item.slot] != arrays[other][i]).any(-1)
                assert changed.any() and not changed[far].any()


def test_a_move_ends_where_the_path_becomes_valid(cfg: DictConfig, out: Path):
    moves, noise = read_table(out / "moves.parquet"), stage.read_noise(cfg)
    assert ((moves["true_m"] > 0) & (moves["true_m"] <= 0.12)).all()
    assert set(moves.loc[moves["user"] == "normal", "symbol"]) == {"glass"}
    assert not moves.duplicated(["variant", "user", "seed", "scene"]).any()
    assert moves["model_m"].dropna().between(0, 0.12).all()
    assert (moves.loc[~moves["rejected"], "model_m"] == 0).all()  # accepted before any move
    for row in moves.drop_duplicates(["user", "scene"]).itertuples():
        assert not valid(noise["O"][[row.scene]], noise["Z_theta"][[row.scene]], cfg.users[row.user])[0, row.path]
        assert row.symbol == SYMBOLS[noise["O"].symbol[row.scene, row.slot]]


def test_scenes_without_room_to_move_an_item_leave_no_moves(cfg: DictConfig, tmp_path: Path):
    far = cfg.copy()
    far.studies.counterfactuals.update(move_step=0.1, move_steps=12)
    main(far, tmp_path)
    assert len(read_table(tmp_path / "moves.parquet")) == 0
    assert (read_table(tmp_path / "moves.csv")["cases"] == 0).all()


def test_a_missing_model_and_users_without_margins_are_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "clearance", tmp_path / "out")
    nobody = {user: dict.fromkeys(SYMBOLS) for user in cfg.users}
    refuses(main, cfg, "users", OmegaConf.create(nobody), "margin", tmp_path / "out")
