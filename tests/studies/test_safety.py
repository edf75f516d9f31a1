"""Envelopes are asked at known clearances and recover true margins; a promise costs accepted paths."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import read_table, write_arrays
from pipeline.artifacts.scenes import train_pool
from pipeline.causal.envelope import dose_grid
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import random_layouts
from pipeline.world.rules import clearance
from studies.safety import stage
from studies.safety.stage import main  # noqa: F401  # of the fixture `out`
from tests import factories

pytestmark = pytest.mark.slow

SCENES, TRAINING, LEVEL = 10, 4, 0.1
VARIANTS = ("full", "clearance")
SMALL = ["train.steps=2", "clearance.steps=2", "train.engine=reference", f"scenes.per_seed={TRAINING}"]
SMALL += [f"studies.safety.acceptance.{name}" for name in ("variants=[full,clearance]", "fitted=1", f"level={LEVEL}")]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Ten sparse scenes, as they are and with an added item, demonstrations, queries, and untrained models."""
    root = tmp_path_factory.mktemp("safety")
    cfg = factories.models_in_rendered_scenes(root, VARIANTS, SCENES, *SMALL)
    OmegaConf.update(cfg, "paths.demos", str(root / "demos"))
    catalogue = read_catalogue(Path(cfg.paths.data))

    def draw(seed: int, count: int, items: int, split: str):
        rules = factories.RULES.model_copy(update={"items_per_scene": (items,), "glasses_chance": (0.5, 0.5)})
        return random_layouts(np.random.default_rng(seed), count, catalogue.footprints, catalogue.pool(split), rules)

    layouts = {"new_items": draw(0, SCENES, 1, "unseen"), "new_scenes": draw(9, 5, 3, "train")}
    layouts |= {train_pool(seed): draw(1 + seed, TRAINING, 3, "train") for seed in cfg.protocol.seeds}
    scenes = factories.write_rendered(cfg, layouts)
    factories.symbols_added(cfg, scenes, 2)
    factories.labelled_demos(cfg, scenes)
    factories.labelled_queries(cfg, scenes, ["new_scenes", "new_items"], 12)
    prior = {user: np.full((2, 2), 0.7) for user in cfg.evaluate.users}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", prior)
    return cfg


@pytest.fixture(scope="module")
def chosen(cfg: DictConfig) -> tuple[stage.Scenes, np.ndarray, np.ndarray]:
    """The scenes, the doses [m] and the chosen candidates (symbol, scene, dose)."""
    study, scenes = cfg.studies.safety.envelope, stage.read_envelope_scenes(cfg)
    doses = dose_grid(study.step, study.doses)
    return scenes, doses, stage.choose_paths(cfg, scenes, doses)


def test_the_method_recovers_the_true_margins_from_the_true_answers(cfg: DictConfig, out: Path):
    for row in read_table(out / "envelope.csv").query("variant == 'truth'").itertuples():
        margin = cfg.users[row.user][row.symbol]
        assert row.right
        assert np.isnan(row.radius_m) == (margin is None)
        if margin is not None:
            assert row.true_radius_m == margin and row.response == 1
            assert abs(row.radius_m - margin) < cfg.studies.safety.envelope.step / 2


def test_chosen_paths_have_the_dose_and_are_clear_of_other_items(cfg: DictConfig, chosen: tuple):
    scenes, doses, paths = chosen
    study = cfg.studies.safety.envelope
    for symbol, layouts in enumerate(scenes.added.layouts):
        distance = clearance(layouts, np.take_along_axis(scenes.z_theta, paths[symbol][..., None], axis=1))
        last = layouts.present.sum(1) - 1
        has_dose = paths[symbol] >= 0
        to_added = distance[np.arange(SCENES), ..., last]
        to_others = np.where(np.arange(distance.shape[-1]) == last[:, None, None], np.inf, distance).min(-1)
        assert (np.abs(to_added - doses)[has_dose] <= study.step / 2 + 1e-12).all()
        assert (to_others[has_dose] >= study.clear_of_others).all()


def test_27_demonstrations_are_too_few_to_promise_two_per_cent_and_who_accepts_nothing_errs_in_nothing(out: Path):
    strict = read_table(out / "levels.csv").query("rule == 'conformal' and level <= 0.02")
    assert len(strict) == 3 * 2 * 2 and (strict["abstained"] == 1).all()
    assert (strict["invalid"] == 0).all()
