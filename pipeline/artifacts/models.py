"""Paths and weights of fitted models, and the columns of their predictions (`trained` loads them)."""

from collections.abc import Mapping
from pathlib import Path

from omegaconf import DictConfig
from safetensors.torch import save
from torch import Tensor

from pipeline.runtime.writing import atomic_write

PREDICTION_COLUMNS = ["seed", "user", "n_demos", "split", "scene", "query", "p", "valid"]


def compared(cfg: DictConfig) -> list[str]:
    """Return the variants that studies, figures and recordings show beside each other; three if none says so."""
    names = [str(name) for name, settings in cfg.variants.items() if settings.compared]
    return names or [str(name) for name in cfg.variants][:3]


def model_dir(cfg: DictConfig, variant: str) -> Path:
    """Return the output folder of the stage that fits `variant`."""
    return Path(cfg.paths[cfg.variants[variant].stage]) / variant


def fitted_n_demos(cfg: DictConfig, variant: str) -> list[int]:
    """Return those of the experiment's numbers of demonstrations that `variant` is fitted at (conf/variants)."""
    numbers = cfg.variants[variant].n_demos
    return [n for n in cfg.n_demos if numbers is None or n in numbers or n == cfg.main_n_demos]


def weights_path(directory: Path, user: str, seed: int, n_demos: int, step: int | None = None) -> Path:
    """Return the file of one model's weights, or of its weights before training step `step`."""
    name = f"{user}-s{seed}-n{n_demos}"
    if step is None:
        return directory / "weights" / f"{name}.safetensors"
    return directory / "checkpoints" / f"{name}-step{step:05d}.safetensors"


def save_weights(path: Path, weights: Mapping[str, Tensor]) -> None:
    """Write parameters and buffers by name."""
    state = {name: value.contiguous() for name, value in weights.items()}
    atomic_write(path, lambda part: part.write_bytes(save(state)))  # `save_file` makes files private
