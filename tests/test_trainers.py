"""Models fitted for their answers alone."""

import numpy as np

from pipeline.params import compose
from pipeline.table.bezier import random_z_theta
from pipeline.trainers import Lesson, fit_each


def test_answers_come_in_the_order_of_the_lessons_though_only_those_of_as_many_scenes_are_fitted_together():
    cfg, rng = compose(["profile=smoke", "workers=1", "train.steps=1", "path.steps=1"]), np.random.default_rng(0)

    def lesson(seed: int, scenes: int) -> Lesson:
        images = rng.integers(0, 256, (scenes, 100, 100, 3), dtype=np.uint8)
        return Lesson("normal", seed, images, random_z_theta(rng, scenes, 4), rng.random((scenes, 4)) < 0.5)

    lessons = [lesson(seed, scenes) for seed, scenes in enumerate((3, 1, 3, 2, 1))]
    found = fit_each(cfg, {"full": lessons, "path": lessons[1:]}, lambda _, own: (own.seed, len(own.images)), "test")
    assert found == {"full": [(0, 3), (1, 1), (2, 3), (3, 2), (4, 1)], "path": [(1, 1), (2, 3), (3, 2), (4, 1)]}
