"""A short training learns."""

from pathlib import Path

import numpy as np
import pytest
import torch

from making.segmenter import pool, train
from making.segmenter.pool import draw
from pipeline.perception.segmenter import read_segmenter


@pytest.mark.slow
def test_a_short_training_lowers_the_loss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for part in range(3):
        np.save(pool.part_file(tmp_path, part), np.concatenate(draw(np.random.default_rng(part), 20, "data")))
    monkeypatch.setattr(train, "PART", 20)
    monkeypatch.setattr(train, "FIRST_PARTS", 2)
    monkeypatch.setattr(train, "WARM_UP", 2)
    losses = train.train(tmp_path, tmp_path / "weights.safetensors", steps=12)
    assert losses[-1] < 0.9 * losses[0]
    assert torch.isfinite(read_segmenter(tmp_path / "weights.safetensors").head.weight).all()
