"""The stage takes away what it says and nothing else, and moves items as far as the truth asks."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import read_arrays, read_json, read_table
from pipeline.artifacts.scenes import SceneSet, read_scenes, write_scenes
from pipeline.causal.counterfactual import keep
from pipeline.models.registry import build
from pipeline.params import compose
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, LayoutRules, random_layouts
from pipeline.world.render import REACH_M, Palette, render_scenes
from pipeline.world.rules import valid
from studies.counterfactuals import stage as counterfactual
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import convinced, save_model

SCENES, PATHS, GENERATOR = 6, 24, 5
VARIANTS = ("full", "path")
KEPT = ("metrics.json", "moves.parquet", "examples.npz")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Six scenes with unseen items, and untrained models of two variants and two seeds."""
    root = tmp_path_factory.mktemp("counterfactual")
    cfg = compose(["profile=smoke", "workers=1"])
    for name in ("scenes", "train", "irl", "path"):
        OmegaConf.update(cfg, f"paths.{name}", str(root / name))
    cfg.variants = {variant: cfg.variants[variant] for variant in VARIANTS}
    sizes = {"scenes": SCENES, "paths": PATHS, "moved_scenes": 3, "move_step": 0.02, "move_steps": 6}
    cfg.counterfactual.update(**sizes, generator=GENERATOR)
    catalogue = read_catalogue(Path(cfg.paths.data))
    choices = catalogue.pool("unseen")
    rules = LayoutRules.of(cfg.scenes.layout)
    layouts = random_layouts(np.random.default_rng(0), SCENES, catalogue.footprints, choices, rules)
    looks = pd.DataFrame({"texture": catalogue.texture_names("train")[0], "render_seed": range(SCENES)})
    images = render_scenes(layouts, list(looks["texture"]), list(looks["render_seed"]), Palette(catalogue))
    write_scenes(Path(cfg.paths.scenes), SceneSet({"new_items": images}, {"new_items": layouts}, {"new_items": looks}))
    for variant in VARIANTS:
        for user in cfg.users:
            for seed in cfg.protocol.seeds:
                model = convinced(build(cfg.variants[variant], seed))
                save_model(cfg, variant, model, user, seed)
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    counterfactual.main(cfg, directory)
    return directory


@pytest.fixture(scope="module")
def examples(out: Path) -> list[dict]:
    return read_json(out / "metrics.json")["examples"]


def test_every_variant_and_user_has_a_cell_and_who_minds_nothing_an_empty_one(cfg: DictConfig, out: Path):
    metrics = read_json(out / "metrics.json")
    assert set(metrics["counterfactual"]) == set(VARIANTS)
    for by_user in metrics["counterfactual"].values():
        assert set(by_user) == set(cfg.users)
        assert by_user["aggressive"] is None
    assert metrics["truth"]["aggressive"] is None
    layouts = read_scenes(Path(cfg.paths.scenes)).layouts["new_items"]
    assert metrics["pictures"] == (2 ** layouts.present.sum(1)).sum()
    z = random_z_theta(stream(GENERATOR, "counterfactual"), SCENES, PATHS)
    for user in ("careful", "normal"):
        share = 1 - valid(layouts, z, cfg.users[user]).mean()
        assert metrics["truth"][user]["invalid"] == pytest.approx(share, abs=1e-6)


def test_an_item_taken_away_leaves_every_pixel_far_from_it(cfg: DictConfig, out: Path, examples: list[dict]):
    arrays = read_arrays(out / "examples.npz")
    scenes = read_scenes(Path(cfg.paths.scenes))
    layouts, pictures = scenes.layouts["new_items"], scenes.images["new_items"]
    x, y = np.meshgrid((np.arange(SIDE) + 0.5) / SIDE, 1 - (np.arange(SIDE) + 0.5) / SIDE)
    assert len(examples) > 1
    for i, example in enumerate(examples):
        scene = example["scene"]
        np.testing.assert_array_equal(arrays["whole"][i], pictures[scene])
        for item in example["items"]:
            slot = item["slot"]
            changed = (arrays["without"][i, slot] != arrays["whole"][i]).any(-1)
            reach = layouts.half_length[scene, slot] + layouts.radius[scene, slot] + REACH_M + 0.03
            far = np.hypot(x - item["x_m"], y - item["y_m"]) > reach
            assert changed.any() and not changed[far].any()
            back = (arrays["alone"][i, slot] != arrays["empty"][i]).any(-1)
            assert back.any() and not back[far].any()


def test_examples_follow_their_rules(examples: list[dict]):
    by_kind = {e["kind"]: e["users"] for e in examples}
    assert len({e["scene"] for e in examples}) == len(examples)
    if "disagree" in by_kind:
        careful, normal = (by_kind["disagree"][u]["truth"] for u in ("careful", "normal"))
        assert careful["p"] == normal["p"] == 0 and careful["blame"] != normal["blame"]
        assert sum(careful["ps"]) >= 1
    careful, normal = (by_kind["one accepts"][u]["truth"] for u in ("careful", "normal"))
    assert (careful["p"], normal["p"], normal["blame"]) == (0, 1, None)
    assert careful["pn"][careful["blame"]] == careful["ps"][careful["blame"]] == 1


def test_a_move_ends_where_the_path_becomes_valid(cfg: DictConfig, out: Path):
    moves = read_table(out / "moves.parquet")
    assert (moves["true_m"] > 0).all() and (moves["true_m"] <= 0.12).all()
    assert set(moves.loc[moves["user"] == "normal", "symbol"]) == {"glass"}
    assert not moves.duplicated(["variant", "user", "seed", "scene"]).any()
    found = moves["found_m"].dropna()
    assert ((found >= 0) & (found <= 0.12)).all()
    assert (moves.loc[~moves["rejected"], "found_m"] == 0).all()  # accepted where it stands
    layouts = read_scenes(Path(cfg.paths.scenes)).layouts["new_items"]
    case = moves.drop_duplicates(["user", "scene"])
    symbols = np.array(SYMBOLS)[layouts.symbol[case["scene"], case["slot"]]]
    np.testing.assert_array_equal(case["symbol"], symbols)
    z = random_z_theta(stream(GENERATOR, "counterfactual"), SCENES, PATHS)
    for row in case.itertuples():
        assert not valid(layouts[[row.scene]], z[[row.scene]], cfg.users[row.user])[0, row.path]


def test_a_table_with_a_moved_item_is_pictured_as_its_own_scene(cfg: DictConfig, monkeypatch: pytest.MonkeyPatch):
    world, seen = counterfactual._set_world(cfg), []
    left = keep(world.layouts[world.tables.scene], world.tables.kept)
    truth = world.tables.fold(valid(left, world.z_theta[world.tables.scene], cfg.users.careful).astype(float))
    moves = counterfactual._set_moves(cfg, world, truth, cfg.users.careful)
    monkeypatch.setattr(counterfactual, "predict_all", lambda cfg, users, images, z, what: seen.append(images) or {})
    counterfactual._least_moves(cfg, world, "careful", moves, {})
    pictures = read_scenes(Path(cfg.paths.scenes)).images["new_items"]
    x, y = np.meshgrid((np.arange(SIDE) + 0.5) / SIDE, 1 - (np.arange(SIDE) + 0.5) / SIDE)
    steps = seen[0].reshape(len(moves.scene), -1, *pictures.shape[1:])
    assert len(moves.scene) == 3
    for scene, slot, images in zip(moves.scene, moves.slot, steps, strict=True):
        at = scene, slot
        reach = world.layouts.half_length[at] + world.layouts.radius[at] + REACH_M + 0.03 + moves.distance[-1]
        centre = world.layouts.centre[at]
        changed = (images != pictures[scene]).any(-1)  # (step, row, column)
        assert changed.any((1, 2)).all() and not changed[:, np.hypot(x - centre[0], y - centre[1]) > reach].any()


def test_a_second_run_with_more_workers_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == sorted(KEPT)
    repeats_itself(counterfactual.main, cfg, out, tmp_path, workers=2)


def test_scenes_without_room_to_move_an_item_leave_no_moves(cfg: DictConfig, tmp_path: Path):
    far = cfg.copy()
    far.counterfactual.update(move_step=0.1, move_steps=12)
    counterfactual.main(far, tmp_path)
    assert len(read_table(tmp_path / "moves.parquet")) == 0
    cells = read_json(tmp_path / "metrics.json")["counterfactual"]
    assert all(cell["least_move"] is None for by_user in cells.values() for cell in by_user.values() if cell)


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(counterfactual.main, cfg, "path", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("scenes", 1, "counterfactual.scenes is 1: expected a whole number from 2"),
        ("scenes", 1000, r"counterfactual.scenes is 1000: expected at most scenes.shared = \d+"),
        ("move_step", 0.0, "counterfactual.move_step is 0.0"),
        ("example_variant", "best", "counterfactual.example_variant is 'best'"),
        ("split", "seen_scenes", "expected a split that all seeds share, one of new_scenes, new_items"),
    ],
)
def test_parameters_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name, value, message):
    refuses(counterfactual.main, cfg, f"counterfactual.{name}", value, message, tmp_path / "out")
