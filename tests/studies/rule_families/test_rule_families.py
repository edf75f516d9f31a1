"""The misspecify stage fits models to rules of other forms, and holds them against those."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_json
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.models import baselines as nulls
from pipeline.models.base import ValidityModel
from pipeline.params import compose
from pipeline.training.refit import TrainingSet
from pipeline.world.layout import SYMBOLS
from studies.rule_families import stage as misspecify
from studies.rule_families.families import FORMS
from tests.stages.facts import refuses, repeats_itself
from tests.stages.inputs import labelled_demos, pictured_scenes, symbols_added

TRAINING, SCENES, PATHS = 4, 3, 8
SMALL = [
    "profile=smoke", "workers=1", f"scenes.per_seed={TRAINING}", "path.steps=2", "variants.irl_ranked.steps=2",
    "scenes.prior_side=4",
]  # fmt: skip


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' scenes with demonstrations, scenes of unseen items, and each symbol added to those."""
    root = tmp_path_factory.mktemp("misspecify")
    cfg = compose([*SMALL, *(f"paths.{name}={root / name}" for name in ("scenes", "demos", "intervene"))])
    scenes = pictured_scenes(
        cfg, {train_pool(s): (TRAINING, "train") for s in cfg.seeds} | {"new_items": (SCENES, "unseen")}
    )
    labelled_demos(cfg, scenes)
    symbols_added(cfg, scenes, PATHS)
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    misspecify.main(cfg, directory)
    return directory


def test_every_form_and_variant_has_a_score_and_a_verdict_on_every_cell(cfg: DictConfig, out: Path):
    found = read_json(out / "metrics.json")
    assert found["order"] == list(cfg.misspecify.forms) and set(found["forms"]) == set(found["order"])
    assert found["paths"] == PATHS
    for of in found["forms"].values():
        assert set(of["models"]) == {*cfg.misspecify.variants, misspecify.AVERAGED, nulls.POSITION}
        for variant in (*cfg.misspecify.variants, misspecify.AVERAGED):
            assert of["verdicts"][variant]["cells"] == 8
            assert set(of["interventions"][variant]) == set(cfg.evaluate.users)
            assert all(set(by) == set(SYMBOLS) for by in of["interventions"][variant].values())


def test_against_the_users_own_form_the_own_form_changes_nothing_and_forgives_nothing(cfg: DictConfig, out: Path):
    forms = read_json(out / "metrics.json")["forms"]
    assert forms["margin"]["forgiven"] == 0
    assert all(forms["margin"]["models"][v]["difference"] == 0 for v in cfg.misspecify.variants)
    assert all(of["valid"]["careful"] >= forms["margin"]["valid"]["careful"] for of in forms.values())


def test_models_are_taught_the_same_paths_with_the_labels_of_each_form(cfg: DictConfig, monkeypatch):
    scenes, demos, taught = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos)), []

    def kept(_cfg, training_sets, _ask, desc):
        taught.extend(next(iter(training_sets.values())))
        return {v: [(np.zeros((SCENES, PATHS)), np.float64(1))] * len(of) for v, of in training_sets.items()}

    monkeypatch.setattr(misspecify, "refit", kept)
    misspecify._answers(cfg, scenes, np.full((1, SCENES, 100, 100, 3), 128, np.uint8), np.zeros((SCENES, PATHS, 2)))
    rest = iter(taught)
    for form, amount in cfg.misspecify.forms.items():
        for user in cfg.evaluate.users:
            for seed in cfg.protocol.seeds:
                training_set, (z, _) = next(rest), demo_arrays(demos, seed, user, cfg.main_n_demos)
                np.testing.assert_array_equal(training_set.z_theta, z)
                labels = FORMS[form](scenes.layouts[train_pool(seed)], z, cfg.users[user], float(amount))
                np.testing.assert_array_equal(training_set.valid, labels)


def test_what_position_alone_tells_is_the_mean_over_the_training_scenes(cfg: DictConfig):
    scenes = read_scenes(Path(cfg.paths.scenes))
    prior = misspecify._prior(cfg, scenes, "brief", "careful")
    corner = np.full((TRAINING, 1, 2), -0.2 + 1.4 / 8)  # the middle of the first of 4 cells
    shares = [
        FORMS["brief"](scenes.layouts[train_pool(s)], corner, cfg.users.careful, 0.1).mean() for s in cfg.protocol.seeds
    ]
    assert prior.shape == (4, 4) and prior[0, 0] == pytest.approx(np.mean(shares))


def test_a_second_run_on_two_workers_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    repeats_itself(misspecify.main, cfg, out, tmp_path, workers=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("forms", {"brief": 0.1}, r"misspecify.forms is \['brief'\]: expected margin among them"),
        ("forms", {"margin": 0.0, "taste": 1.0}, "expected 'margin', 'brief', 'right', 'beside', 'late' or 'several'"),
        ("forms.brief", -0.1, "misspecify.forms.brief is -0.1: expected a length from 0"),
        ("forms.several", 0.5, "misspecify.forms.several is 0.5: expected at least 1"),
        ("variants", ["nobody"], r"misspecify.variants is \['nobody'\]: expected some of full"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(misspecify.main, cfg, f"misspecify.{name}", value, message, tmp_path / "out")


def test_a_seed_without_scenes_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    refuses(misspecify.main, cfg, "protocol.seeds", [0, 100], "no scenes train-s100", tmp_path / "out")


def test_a_model_is_asked_about_the_demonstrations_it_was_fitted_to():
    class Knowing(ValidityModel):
        """Says that paths are valid whose control point lies right of what the picture's shade says."""

        def perceive(self, images):
            return 255 * images[:, 0, 0, :1]

        def logit(self, percept, z_theta):
            return 100 * z_theta[..., 0] - percept

    z = np.array([[[0.1, 0], [0.3, 0]], [[0.1, 0], [0.3, 0]]])
    images = np.stack([np.full((100, 100, 3), shade, np.uint8) for shade in (20, 40)])
    own = TrainingSet("careful", 0, images, z, np.array([[False, True], [True, False]]))
    p, right = misspecify._ask(images[::-1].copy(), z[::-1], Knowing(), own)
    np.testing.assert_array_equal(p > 0.5, [[False, False], [False, True]])
    assert right == 0.75
