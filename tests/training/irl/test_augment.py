"""Augmented training scenes: one gain a scene, table tops turned and reflected."""

import numpy as np
import torch

from pipeline.models.irl.reward_map import SYMMETRIES, transform
from pipeline.training.irl.augment import ColorJitter, augment_appearances, recolour


def test_a_scenes_gain_is_one_factor_of_its_own():
    plain = np.random.default_rng(0).uniform(0.1, 0.3, (4, 3, 9, 9)).astype(np.float32)
    labels = np.zeros((4, 9, 9), np.int64)
    labels[:, 2:5, 2:5] = 1
    factor = recolour(np.random.default_rng(1), plain, labels, ColorJitter(0.0, 0.0, 0.0, 0.2, 0.0)) / plain
    np.testing.assert_allclose(factor, factor[:, :1, :1, :1] + np.zeros_like(plain), rtol=1e-5)
    assert len(np.unique(factor[:, 0, 0, 0].round(3))) == 4


def test_another_table_is_turned_and_reflected_in_every_way():
    top = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    rng, jitter = np.random.default_rng(0), ColorJitter(0.0, 0.0, 0.0, 0.0, 1.0)
    augmented = [
        augment_appearances(rng, np.stack([top, top]), np.zeros((2, 3, 3), np.int64), jitter) for _ in range(200)
    ]
    seen = {scene.tobytes() for scenes, table in augmented for scene in scenes[table != [0, 1]]}
    assert seen == {transform(torch.tensor(top), g).numpy().tobytes() for g in range(SYMMETRIES)}
