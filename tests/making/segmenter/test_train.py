"""Training pictures are changed together with their truth, and a short training learns."""

from pathlib import Path

import numpy as np
import pytest
import torch

from making.segmenter import pool, train
from making.segmenter.pool import draw
from making.segmenter.train import change
from pipeline.perception.segmenter import read_segmenter


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pool of two small parts."""
    folder = tmp_path_factory.mktemp("pool")
    for part in range(2):
        np.save(pool.part_file(folder, part), np.concatenate(draw(np.random.default_rng(part), 20, "data")))
    return folder


def test_items_stay_where_their_truth_is(few: Path):
    """The difference from the empty table is larger on items than elsewhere."""
    pictures = np.load(pool.part_file(few, 0))
    inputs, truth = change(np.random.default_rng(0), pictures[pictures[..., 6].any((1, 2))])
    known = inputs[:, 6, 0, 0] == 1
    difference, item = inputs[known, 3:6].abs().mean(1), truth[known, 0] == 1
    assert difference[item].mean() > 3 * difference[~item].mean()


def test_a_short_training_lowers_the_loss(few: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(train, "PART", 20)
    monkeypatch.setattr(train, "FIRST_PARTS", 2)
    monkeypatch.setattr(train, "WARM_UP", 2)
    losses = train.train(few, tmp_path / "weights.safetensors", steps=12)
    assert losses[-1] < 0.9 * losses[0]
    assert torch.isfinite(read_segmenter(tmp_path / "weights.safetensors").head.weight).all()
