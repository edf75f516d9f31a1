"""The study asks at known clearances, recovers the true margins, and writes what a planner can read."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import train_pool
from pipeline.causal.envelope import dose_grid
from pipeline.models.trained import load_model
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, random_layouts
from pipeline.world.rules import clearance, valid
from studies.envelope import stage
from studies.envelope.stage import main
from tests.factories import models_in_rendered_scenes, symbols_added, write_rendered
from tests.stages.facts import refuses

pytestmark = pytest.mark.slow

SCENES = 10
VARIANTS = ("full", "clearance")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Ten sparse scenes, as they are and with an added item, and untrained models of two variants and two seeds."""
    cfg = models_in_rendered_scenes(tmp_path_factory.mktemp("envelope"), VARIANTS, SCENES)
    catalogue = read_catalogue(Path(cfg.paths.data))

    def draw(seed: int, count: int, items: int, split: str):
        rules = LayoutRules((items,), (0.5, 0.5), 0.12, 0.88, 0.12, 0.015, 0.97, 1.03)
        return random_layouts(np.random.default_rng(seed), count, catalogue.footprints, catalogue.pool(split), rules)

    layouts = {"new_items": draw(0, SCENES, 1, "unseen")}
    layouts |= {train_pool(seed): draw(1 + seed, 1, 3, "train") for seed in cfg.protocol.seeds}
    symbols_added(cfg, write_rendered(cfg, layouts), 2)
    return cfg


@pytest.fixture(scope="module")
def chosen(cfg: DictConfig) -> tuple[stage.Scenes, np.ndarray, np.ndarray]:
    """The scenes, the doses [m] and the chosen candidates (symbol, scene, dose, path)."""
    study, scenes = cfg.studies.envelope, stage.read_inputs(cfg)
    doses = dose_grid(study.step, study.doses)
    return scenes, doses, stage.choose_paths(cfg, scenes, doses)


def test_the_method_recovers_the_true_margins_from_the_true_answers(cfg: DictConfig, out: Path):
    for row in read_table(out / "envelope.csv").query("variant == 'truth'").itertuples():
        margin = cfg.users[row.user][row.symbol]
        assert row.right
        assert np.isnan(row.radius_m) == (margin is None)
        if margin is not None:
            assert row.true_radius_m == margin and row.response == 1
            assert abs(row.radius_m - margin) < cfg.studies.envelope.step / 2


def test_chosen_paths_have_the_dose_and_are_clear_of_other_items(cfg: DictConfig, chosen: tuple):
    scenes, doses, paths = chosen
    study = cfg.studies.envelope
    for symbol, layouts in enumerate(scenes.added.layouts):
        z = np.take_along_axis(scenes.z_theta, paths[symbol].reshape(SCENES, -1)[..., None], axis=1)
        distance = clearance(layouts, z).reshape(*paths.shape[1:], -1)
        last = layouts.present.sum(1) - 1
        slots = np.arange(distance.shape[-1])
        has_dose = paths[symbol] >= 0
        to_added = distance[np.arange(SCENES), ..., last]
        to_others = np.where(slots == last[:, None, None, None], np.inf, distance).min(-1)
        assert (np.abs(to_added - doses[:, None])[has_dose] <= study.step / 2 + 1e-12).all()
        assert (to_others[has_dose] >= study.clear_of_others).all()


def test_a_curve_is_the_models_own_loss_of_validity(cfg: DictConfig, out: Path, chosen: tuple):
    scenes, _, paths = chosen
    symbol = SYMBOLS.index("plate")
    z = np.take_along_axis(scenes.z_theta, paths[symbol].reshape(SCENES, -1)[..., None], axis=1)
    models = [load_model(cfg, "clearance", "normal", seed, cfg.main_n_demos) for seed in cfg.protocol.seeds]
    before = np.mean([m.probability(scenes.images, z) for m in models], axis=0)
    after = np.mean([m.probability(scenes.added.images[symbol], z) for m in models], axis=0)
    loss = np.where(paths[symbol, ..., 0] >= 0, before - after, np.nan)  # (scene, dose)
    expected = pd.DataFrame(loss).groupby(scenes.added.item[symbol]).mean().mean()  # scenes of an item, then items
    curve = read_table(out / "curve.parquet").query("variant == 'clearance' and user == 'normal' and symbol == 'plate'")
    np.testing.assert_allclose(curve["response"], expected, atol=1e-6)


def test_plans_that_keep_the_true_margins_are_all_valid(cfg: DictConfig):
    scenes = stage.read_inputs(cfg)
    margins = {user: margins for user, margins in cfg.users.items() if any(m is not None for m in margins.values())}
    learned = envelopes_of({user: {s: m[s] for s in SYMBOLS} for user, m in margins.items()})
    plans = stage.check_plans(cfg, scenes, learned)
    assert list(plans["user"]) == list(margins) and (plans["plans"] > 0).all()
    assert (plans["valid"] == 1).all() and (plans["shortfall_m"] == 0).all()


def test_paths_that_break_the_distances_are_moved_if_any_keeps_them(cfg: DictConfig):
    scenes = stage.read_inputs(cfg)
    keep_clear = dict.fromkeys(SYMBOLS, 0.01)
    inside = ~valid(scenes.layouts, scenes.z_theta[:, : cfg.studies.envelope.starts], keep_clear)
    plans = stage.check_plans(cfg, scenes, envelopes_of({"careful": keep_clear}))["plans"].item()
    assert 0 < plans <= inside.sum() < inside.size
    beyond_the_table = envelopes_of({user: dict.fromkeys(SYMBOLS, 2.0) for user in cfg.users})
    assert (stage.check_plans(cfg, scenes, beyond_the_table)["plans"] == 0).all()


def envelopes_of(distances: dict) -> pd.DataFrame:
    """Return a table of learned envelopes with these upper ends [m]."""
    rows = [
        (user, s, np.nan if x is None else x) for user, by_symbol in distances.items() for s, x in by_symbol.items()
    ]
    return pd.DataFrame(rows, columns=["user", "symbol", "ci_high"])


def test_the_specification_says_what_the_table_says(cfg: DictConfig, out: Path):
    content = yaml.safe_load((out / "specification.yaml").read_text())
    for row in read_table(out / "envelope.csv").query("variant == 'clearance'").itertuples():
        values = content[row.user][row.symbol]
        assert values["verdict"] == row.verdict and values["keep_clear_m"] == values["ci_high_m"]
        assert (values["radius_m"] is None) == np.isnan(row.radius_m)
        if values["radius_m"] is not None:
            assert values["radius_m"] == pytest.approx(row.radius_m, abs=1e-4)


def test_doses_that_too_few_candidates_reach_are_refused(cfg: DictConfig, tmp_path: Path):
    refuses(main, cfg, "studies.envelope.doses", 200, "raise studies.envelope.candidates", tmp_path / "out")
