"""Trained models of any kind, as the stages that ask them read them."""

from omegaconf import DictConfig
from safetensors import SafetensorError
from safetensors.torch import load_file

from pipeline.artifacts.models import model_dir, weights_path
from pipeline.params import InputError
from pipeline.spec.registry import build
from pipeline.spec.specification import Specification


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
