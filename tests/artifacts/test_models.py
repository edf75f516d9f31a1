"""A model comes back bit for bit; a missing or damaged one is named."""

from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.models import model_dir, weights_path
from pipeline.artifacts.trained import load_model
from pipeline.models.registry import build
from pipeline.runtime.errors import InputError
from tests.factories import composed, save_model


@pytest.fixture
def cfg(tmp_path: Path) -> DictConfig:
    cfg = composed()
    for stage in ("train", "irl"):
        OmegaConf.update(cfg, f"paths.{stage}", str(tmp_path / stage))
    return cfg


@pytest.mark.parametrize("variant", ["full", "classifier", "irl_ranked"])
def test_a_model_predicts_the_same_after_a_round_trip(cfg: DictConfig, variant: str):
    torch.manual_seed(0)
    model = build(cfg.variants[variant])
    save_model(cfg, variant, model, "normal", 3, 9)
    images = np.random.default_rng(0).integers(0, 256, (2, 100, 100, 3), dtype=np.uint8)
    z = np.random.default_rng(1).random((2, 4, 2))
    back = load_model(cfg, variant, "normal", 3, 9)
    np.testing.assert_array_equal(back.probability(images, z), model.probability(images, z))


def test_a_missing_or_damaged_model_is_named(cfg: DictConfig):
    with pytest.raises(InputError, match=r"normal-s3-n9\.safetensors is missing"):
        load_model(cfg, "full", "normal", 3, 9)
    path = weights_path(model_dir(cfg, "full"), "normal", 3, 9)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"not weights")
    with pytest.raises(InputError, match="not a full model"):
        load_model(cfg, "full", "normal", 3, 9)
