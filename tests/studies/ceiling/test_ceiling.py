"""Learners of the ceiling study read what they are said to read, and are judged in scenes of the study's own."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays
from pipeline.params import compose
from pipeline.world.layout import EMPTY, SYMBOLS, random_layouts
from studies.ceiling import stage
from studies.ceiling.models import true_code
from studies.ceiling.stage import NEW, PERFECT, SEEN, draw_jobs
from tests.factories import ITEMS, RULES


def test_the_true_code_knows_each_item_and_nothing_of_empty_slots():
    layouts = random_layouts(np.random.default_rng(0), 40, ITEMS, np.arange(4), RULES)
    code = true_code(layouts, 3).reshape(40, 3, -1)
    present = layouts.present[:, :3]
    assert (code[~present] == 0).all() and (~present).any()
    np.testing.assert_array_equal(code[..., -len(SYMBOLS) :].argmax(-1)[present], layouts.symbol[:, :3][present])
    np.testing.assert_allclose(code[..., 0][present] * 0.7 + 0.5, layouts.centre[:, :3, 0][present])
    layouts.angle[:] += np.pi
    np.testing.assert_allclose(true_code(layouts, 3).reshape(code.shape), code, atol=1e-9)
    assert (layouts.symbol[:, 3:] == EMPTY).all()


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """A smoke run's settings, and a prior that prefers no position."""
    cfg = compose(["profile=smoke", "workers=1", "train.steps=2", f"paths.scenes={tmp_path_factory.mktemp('ceiling')}"])
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", {u: np.ones((2, 2)) for u in cfg.evaluate.users})
    return cfg


def test_fewer_scenes_are_the_first_ones_and_judges_are_the_same_for_all(cfg: DictConfig):
    jobs = draw_jobs(cfg)
    for job in jobs:
        largest = next(
            x for x in jobs if (x.user, x.seed, x.clear_cm, x.learner) == (job.user, job.seed, job.clear_cm, PERFECT)
        )
        np.testing.assert_array_equal(job.z_theta, largest.z_theta[: len(job.z_theta)])
        np.testing.assert_array_equal(job.code, largest.code[: len(job.code)])
        assert len(job.images) == (0 if job.learner == PERFECT else len(job.z_theta))
        assert [len(x.valid) for x in job.judged.values()] == [6, 6]
    new = {x.judged[NEW].images.tobytes() for x in jobs}
    assert len(new) == 1 and not new & {x.judged[SEEN].images.tobytes() for x in jobs}


def test_steps_grow_with_the_scenes_and_are_never_fewer_than_in_stage_train():
    cfg = compose(["train.steps=500", "studies.ceiling.batch=20", "studies.ceiling.growth=0.5"])
    assert [stage.steps(cfg, "full", scenes) for scenes in (10, 20, 80, 500)] == [500, 500, 1000, 2500]
    assert stage.steps(cfg, PERFECT, 80) == 500, "full-batch steps, whatever the number of scenes"
