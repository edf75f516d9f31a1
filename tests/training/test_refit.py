"""Models fitted for their answers alone are the ones their own stage would fit."""

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.models.trained import build
from pipeline.runtime.streams import job_seed
from pipeline.training.refit import TrainingSet, refit_and_predict, trainer
from tests.factories import composed

FEW = ["train.steps=2", "clearance.steps=2", "irl.steps.maxent=3", "irl.steps.ranked=3"]
RNG = np.random.default_rng(0)
IMAGES, Z = RNG.integers(0, 255, (2, 100, 100, 3), dtype=np.uint8), RNG.uniform(0, 1, (2, 5, 2))


@pytest.fixture(scope="module")
def cfg() -> DictConfig:
    return composed("profile=smoke", "workers=1", *FEW)


def training_set(scenes: int, seed: int = 0) -> TrainingSet:
    rng = np.random.default_rng([scenes, seed])
    images, valid = rng.integers(0, 255, (scenes, 100, 100, 3), dtype=np.uint8), rng.random((scenes, 3)) < 0.5
    valid[0] = [True, False, True]
    return TrainingSet("careful", seed, images, rng.uniform(0, 1, (scenes, 3, 2)), valid)


def test_a_model_is_the_one_that_the_variants_trainer_fits_from_the_stages_seed(cfg: DictConfig):
    variant, one = cfg.variants.irl_ranked, training_set(3)
    answers = refit_and_predict(cfg, {"irl_ranked": [one]}, IMAGES, Z, "test")  # from here on by one torch thread
    seed = job_seed(0, "careful", cfg.main_n_demos, "irl_ranked")
    model = build(variant, seed)
    trainer(variant, cfg).fit([model], [one.images], [one.z_theta], [one.valid], seeds=[seed])
    np.testing.assert_array_equal(answers["irl_ranked"][0], model.probability(IMAGES, Z))


@pytest.mark.slow
def test_training_sets_of_several_sizes_are_answered_in_their_order(cfg: DictConfig):
    training_sets = [training_set(3), training_set(2), training_set(3, seed=1), training_set(2, seed=1)]
    variants = ("classifier", "irl_ranked", "clearance")
    together = refit_and_predict(cfg, dict.fromkeys(variants, training_sets), IMAGES, Z, "test")
    for i, one in enumerate(training_sets):
        alone = refit_and_predict(cfg, {variant: [one] for variant in variants}, IMAGES, Z, "test")
        for variant in variants:
            np.testing.assert_array_equal(together[variant][i], alone[variant][0], err_msg=variant)
