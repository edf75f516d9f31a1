"""Fitted models as files: where they lie, their weights, their predictions' columns (`trained` reads them back)."""

from pathlib import Path

from omegaconf import DictConfig
from safetensors.torch import save_file

from pipeline.artifacts.files import write_whole
from pipeline.spec.specification import Specification

PREDICTION_COLUMNS = ["seed", "user", "n", "split", "scene", "query", "p", "valid"]


def model_dir(cfg: DictConfig, variant: str) -> Path:
    """Where the stage that fits `variant` writes."""
    return Path(cfg.paths[cfg.variants[variant].stage]) / variant


def weights_path(directory: Path, user: str, seed: int, n: int) -> Path:
    """The file of one model's weights."""
    return directory / "weights" / f"{user}-s{seed}-n{n}.safetensors"


def save_model(directory: Path, model: Specification, user: str, seed: int, n: int) -> None:
    """Write a model's parameters and buffers."""
    state = {name: value.contiguous() for name, value in model.state_dict().items()}
    write_whole(weights_path(directory, user, seed, n), lambda path: save_file(state, path))
