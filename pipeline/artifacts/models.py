"""Trained models as stages exchange them: where they lie, their weights, their predictions' columns."""

from pathlib import Path

from omegaconf import DictConfig
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from pipeline.artifacts.files import write_whole
from pipeline.params import InputError
from pipeline.spec.registry import build
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


def load_model(cfg: DictConfig, variant: str, user: str, seed: int, n: int) -> Specification:
    """A trained model in eval mode; InputError if its weights are missing, damaged or of another shape."""
    path = weights_path(model_dir(cfg, variant), user, seed, n)
    if not path.is_file():
        raise InputError(f"{path} is missing: run `make repro` (or the stage that fits {variant}) first")
    model = build(cfg.variants[variant])
    try:
        model.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise InputError(f"{path} is not a {variant} model ({error}): delete it and fit it again") from error
    return model.eval()
