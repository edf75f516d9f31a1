"""The stage asks at known clearances, recovers the truth from the truth, and writes what a planner can read."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import read_json
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool, write_scenes
from pipeline.artifacts.trained import load_model
from pipeline.models.registry import build
from pipeline.params import compose
from pipeline.stages import envelope, intervene
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, random_layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import clearance, valid
from tests.stages.facts import refuses, repeats_itself
from tests.stages.inputs import convinced, save_model

SCENES = 10
VARIANTS = ("full", "path")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Ten sparse scenes, as they are and with one more item, and untrained models of two variants and two seeds.

    Each seed's training scene holds three things; no picture of it is looked at.
    """
    root = tmp_path_factory.mktemp("envelope")
    cfg = compose(["profile=smoke", "workers=1", "intervene.paths=2"])
    OmegaConf.set_struct(cfg, False)
    for name in ("scenes", "train", "path", "intervene"):
        OmegaConf.update(cfg, f"paths.{name}", str(root / name))
    cfg.variants = {variant: cfg.variants[variant] for variant in VARIANTS}
    catalogue = read_catalogue(Path(cfg.paths.data))
    rules = LayoutRules((1,), (0.5, 0.5), 0.12, 0.88, 0.12, 0.015, 0.97, 1.03)
    layouts = random_layouts(np.random.default_rng(0), SCENES, catalogue.footprints, catalogue.pool("unseen"), rules)
    look = pd.DataFrame({"texture": [catalogue.texture_names("train")[0]] * SCENES, "render_seed": range(SCENES)})
    images = render_scenes(layouts, list(look["texture"]), list(look["render_seed"]), Palette(catalogue))
    full = LayoutRules((3,), (0.5, 0.5), 0.12, 0.88, 0.12, 0.015, 0.97, 1.03)
    trained = random_layouts(np.random.default_rng(1), 2, catalogue.footprints, catalogue.pool("train"), full)
    scenes = SceneSet({"new_items": images}, {"new_items": layouts}, {"new_items": look})
    for i, seed in enumerate((0, 1)):
        one, pool = slice(i, i + 1), train_pool(seed)
        scenes.images[pool], scenes.layouts[pool], scenes.appearances[pool] = images[one], trained[one], look[one]
    write_scenes(root / "scenes", scenes)
    for variant in VARIANTS:
        for user in cfg.users:
            for seed in cfg.protocol.seeds:
                model = convinced(build(cfg.variants[variant], seed))
                save_model(cfg, variant, model, user, seed)
    intervene.main(cfg, root / "intervene")
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    envelope.main(cfg, directory)
    return directory


@pytest.fixture(scope="module")
def found(out: Path) -> dict:
    return read_json(out / "metrics.json")


def test_there_is_a_cell_and_a_curve_for_every_variant_user_and_symbol(cfg: DictConfig, found: dict):
    for part in ("envelope", "curves"):
        assert set(found[part]) == set(VARIANTS)
        for by_user in found[part].values():
            assert {u: set(by_symbol) for u, by_symbol in by_user.items()} == {u: set(SYMBOLS) for u in cfg.users}
    assert (found["scenes"], found["seeds"]) == (SCENES, len(cfg.protocol.seeds))


def test_the_truths_own_answers_give_the_true_margins_and_no_others(cfg: DictConfig, found: dict):
    for user, by_symbol in found["oracle"].items():
        for symbol, cell in by_symbol.items():
            margin = cfg.users[user][symbol]
            assert cell["truth_m"] == margin and cell["right"]
            if margin is not None:
                assert cell["drop_at_contact"] == 1
                assert abs(cell["error_m"]) < cfg.envelope.step / 2


def test_in_truth_an_item_matters_within_the_margin_alone(cfg: DictConfig, found: dict):
    for user, by_symbol in found["curves"]["full"].items():
        for symbol, curve in by_symbol.items():
            margin, at = cfg.users[user][symbol] or -1.0, np.array(curve["clearance_m"])
            truth = np.array(curve["truth"])
            assert (truth[at < margin - cfg.envelope.step / 2] == 1).all()
            assert (truth[at > margin + cfg.envelope.step / 2] == 0).all()


def test_chosen_paths_have_the_dose_and_are_clear_of_everything_else(cfg: DictConfig):
    tables = envelope._set_tables(cfg)
    grid, chosen = envelope._choose_paths(cfg, tables)
    z = envelope._paths(tables, chosen)
    for symbol, layouts in enumerate(tables.added.layouts):
        distance = clearance(layouts, z[symbol])
        last = layouts.present.sum(1) - 1
        own = distance[np.arange(SCENES), :, last].reshape(chosen.shape[1:])
        others = np.where(np.arange(distance.shape[-1]) == last[:, None, None], np.inf, distance).min(-1)
        there = chosen[symbol] >= 0
        assert (np.abs(own - grid[:, None])[there] <= cfg.envelope.step / 2 + 1e-12).all()
        assert (others.reshape(there.shape)[there] >= cfg.envelope.clear_of_others).all()


def test_a_curve_is_the_models_own_drop(cfg: DictConfig, found: dict):
    tables = envelope._set_tables(cfg)
    _, chosen = envelope._choose_paths(cfg, tables)
    torch.set_num_threads(1)
    symbol, z = SYMBOLS.index("plate"), envelope._paths(tables, chosen)
    models = [load_model(cfg, "path", "normal", seed, cfg.main_n_demos) for seed in cfg.protocol.seeds]
    before = np.mean([m.probability(tables.images, z[symbol]) for m in models], axis=0)
    after = np.mean([m.probability(tables.added.images[symbol], z[symbol]) for m in models], axis=0)
    drop = np.where(chosen[symbol, ..., 0] >= 0, before - after, np.nan)  # (scene, dose)
    by_item = pd.DataFrame(drop).groupby(tables.added.item[symbol])
    expected = by_item.mean().mean()  # over an item's scenes, then over items
    np.testing.assert_allclose(found["curves"]["path"]["normal"]["plate"]["drop"], expected, atol=2e-6)


def test_planning_with_the_true_margins_is_perfect_and_with_none_is_no_better_than_chance(found: dict):
    nulls = found["planning_nulls"]
    for user, cell in nulls["true_margins"].items():
        free = nulls["no_envelope"][user]
        assert (cell["valid"], cell["wasted"]) == (1, 0)
        assert (free["kept"], free["wasted"]) == (1, 0)
        assert free["valid"] == pytest.approx(cell["kept"])
    assert nulls["no_envelope"]["aggressive"]["valid"] == 1


def test_paths_keep_the_upper_end_of_the_interval_or_only_from_what_flips():
    cells = {
        "glass": {"radius_m": 0.04, "ci_low": 0.03, "ci_high": 0.05, "flips": True},
        "plate": {"radius_m": 0.02, "ci_low": 0.01, "ci_high": 0.03, "flips": False},
        "bowl": {"radius_m": None, "ci_low": None, "ci_high": None, "flips": True},
    }
    of_all = {"glass": 0.05, "plate": 0.03, "bowl": None}
    assert envelope._keep_clear({"normal": cells}) == {"normal": of_all}
    assert envelope._keep_clear({"normal": cells}, flips=True) == {"normal": of_all | {"plate": None}}


def test_where_no_path_keeps_the_distance_there_is_no_plan(cfg: DictConfig):
    beyond_the_table = {user: {str(symbol): 2.0 for symbol in SYMBOLS} for user in cfg.users}
    found = envelope._plan_nearest(cfg, envelope._set_tables(cfg), beyond_the_table)
    assert {user: cell["plans"] for user, cell in found.items()} == dict.fromkeys(cfg.users, 0)


def test_the_specification_can_be_read_and_says_what_was_found(cfg: DictConfig, out: Path, found: dict):
    text = (out / "specification.yaml").read_text()
    assert text.startswith("#") and "metres" in text
    for user, by_symbol in yaml.safe_load(text).items():
        for symbol, cell in by_symbol.items():
            measured = found["envelope"][cfg.envelope.planner][user][symbol]
            assert cell["keep_clear_m"] == cell["ci_high_m"] == measured["ci_high"]
            assert cell["radius_m"] == measured["radius_m"]
    for user, plans in found["nearest"].items():
        assert f"{user}: {100 * plans['valid']:.1f} % of {plans['plans']} such plans are valid" in text


def test_a_second_run_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == ["metrics.json", "specification.yaml"]
    repeats_itself(envelope.main, cfg, out, tmp_path)


def test_only_paths_that_do_not_keep_the_distances_yet_are_moved(cfg: DictConfig):
    tables, starts = envelope._set_tables(cfg), cfg.envelope.starts
    keep: dict[str, dict[str, float | None]] = {user: {s: 0.01 for s in SYMBOLS} for user in cfg.users}
    inside = ~valid(tables.layouts, tables.z_theta[:, :starts], keep["careful"])
    plans = envelope._plan_nearest(cfg, tables, keep)["careful"]["plans"]
    assert 0 < plans <= inside.sum() < inside.size


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("doses", 1, "envelope.doses is 1: expected a whole number from 2"),
        ("paths", 0.5, "envelope.paths is 0.5"),
        ("candidates", 0, "envelope.candidates is 0"),
        ("step", 0.0, "envelope.step is 0.0"),
        ("clear_of_others", 0.04, "more than the widest margin in users, 0.045 m: raise it"),
        ("planner", "fulll", "envelope.planner is 'fulll': expected one of"),
        ("doses", 200, "raise envelope.candidates"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(envelope.main, cfg, f"envelope.{name}", value, message, tmp_path / "out")


def test_an_item_counts_once_however_many_training_scenes_show_it(cfg: DictConfig):
    scenes = read_scenes(Path(cfg.paths.scenes))
    shown = {s: set() for s in range(len(SYMBOLS))}
    for seed in cfg.protocol.seeds:
        layouts = scenes.layouts[train_pool(seed)]
        for symbol, item in zip(layouts.symbol[layouts.present], layouts.item[layouts.present], strict=True):
            shown[symbol].add(item)
    expected = tuple(max(1, len(items)) for items in shown.values())
    assert envelope._trained_items(scenes, cfg.protocol.seeds) == expected
    assert envelope._trained_items(scenes, [0, 0, 1]) == expected
    assert max(expected) > 1
