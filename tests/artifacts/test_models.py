"""A model comes back bit for bit; a missing or damaged one is named."""

from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.models import model_dir, weights_path
from pipeline.artifacts.trained import load_model
from pipeline.runtime.errors import InputError
from tests.factories import composed


@pytest.fixture
def cfg(tmp_path: Path) -> DictConfig:
    cfg = composed()
    for stage in ("train", "irl"):
        OmegaConf.update(cfg, f"paths.{stage}", str(tmp_path / stage))
    return cfg


def test_a_missing_or_damaged_model_is_named(cfg: DictConfig):
    with pytest.raises(InputError, match=r"normal-s3-n9\.safetensors is missing"):
        load_model(cfg, "full", "normal", 3, 9)
    path = weights_path(model_dir(cfg, "full"), "normal", 3, 9)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"not weights")
    with pytest.raises(InputError, match="not a full model"):
        load_model(cfg, "full", "normal", 3, 9)
