"""The rule families study fits models to users of each family and judges them by that family."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.params import compose
from studies.rule_families import stage as rule_families
from studies.rule_families.families import FAMILIES
from studies.rule_families.stage import main
from tests.factories import labelled_demos, rendered_scenes, symbols_added
from tests.stages.facts import refuses

pytestmark = pytest.mark.slow
TRAINING, SCENES, PATHS = 4, 3, 8
SMALL = [
    "profile=smoke", "workers=1", f"scenes.per_seed={TRAINING}", "clearance.steps=2", "variants.irl_ranked.steps=2",
    "scenes.prior_side=4",
]  # fmt: skip


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' scenes with demonstrations, scenes of unseen items, and each symbol added to those."""
    root = tmp_path_factory.mktemp("rule_families")
    cfg = compose([*SMALL, *(f"paths.{name}={root / name}" for name in ("scenes", "demos", "intervene"))])
    training = {train_pool(seed): (TRAINING, "train") for seed in cfg.seeds}
    scenes = rendered_scenes(cfg, training | {"new_items": (SCENES, "unseen")})
    labelled_demos(cfg, scenes)
    symbols_added(cfg, scenes, PATHS)
    return cfg


@pytest.fixture
def summary(out: Path) -> pd.DataFrame:
    """One row a family and variant."""
    return read_table(out / "summary.csv").set_index(["family", "variant"])


def test_the_margin_family_loses_no_accuracy_and_every_other_forgives_paths(summary):
    assert (summary.loc["margin"][["loss", "loss_ci_low", "loss_ci_high"]] == 0).all(axis=None)
    assert (summary["valid"] >= summary.loc["margin"]["valid"].iloc[0]).all()


def test_posterior_probabilities_of_the_fitted_families_add_up_to_one(cfg: DictConfig, out: Path):
    posterior = read_table(out / "posterior.csv")
    assert {*FAMILIES, "progress", "constant"} == set(posterior["fitted_family"])
    total = posterior.groupby(["family", "seed", "user"])["probability"].sum()
    assert len(total) == len(cfg.studies.rule_families.families) * len(cfg.evaluate.users) * len(cfg.protocol.seeds)
    np.testing.assert_allclose(total, 1, atol=1e-4)


def test_training_sets_hold_the_same_paths_with_the_labels_of_each_family(cfg: DictConfig):
    scenes, demos = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    by_family = rule_families.draw_training_sets(cfg, scenes)
    for family, amount in cfg.studies.rule_families.families.items():
        for training_set in by_family[family]:
            z_theta, _ = demo_arrays(demos, training_set.seed, training_set.user, cfg.main_n_demos)
            np.testing.assert_array_equal(training_set.z_theta, z_theta)
            layouts, margins = scenes.layouts[train_pool(training_set.seed)], cfg.users[training_set.user]
            np.testing.assert_array_equal(training_set.valid, FAMILIES[family](layouts, z_theta, margins, amount))


def test_a_seed_without_scenes_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    refuses(main, cfg, "protocol.seeds", [0, 100], "no scenes train-s100", tmp_path / "out")
