"""Build models from a variant's settings (conf/variants), load fitted ones and predict with all of them."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from safetensors import SafetensorError
from safetensors.torch import load_file

from pipeline.artifacts.models import model_dir, weights_path
from pipeline.models.base import Images, ValidityModel, untrained
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.irl.reward_map import RewardMap
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs

KINDS: dict[str, type[ValidityModel]] = {"vae": BetaVae, "reward": RewardMap, "clearance": ClearanceModel}


def build(variant: Mapping[str, Any], seed: int = 0) -> ValidityModel:
    """Return the untrained model of `variant.kind` and shape `variant.model`; raise InputError for other kinds."""
    if variant["kind"] not in KINDS:
        raise InputError(f"kind {variant['kind']!r} of variant: expected one of {', '.join(KINDS)}; see conf/variants")
    return untrained(KINDS[variant["kind"]], variant["model"], seed)


def load_model(
    cfg: DictConfig, variant: str, user: str, seed: int, n_demos: int, step: int | None = None
) -> ValidityModel:
    """Return a fitted model, or its state before training step `step`, in eval mode.

    Raises InputError if the weights are missing, damaged, not finite or of a wrong shape.
    """
    path = weights_path(model_dir(cfg, variant), user, seed, n_demos, step)
    _check_file(cfg, variant, path)
    model = build(cfg.variants[variant])
    read_weights(model, path, variant)
    return model.eval()


def read_weights(model: ValidityModel, path: Path, variant: str) -> None:
    """Set the model's parameters and buffers from a file; raise InputError if it is damaged or not finite."""
    try:
        model.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise InputError(f"{path} is not a {variant} model ({error}): delete it and fit it again") from error
    for name, value in model.state_dict().items():
        if not value.isfinite().all():
            raise InputError(f"{path} has NaN or infinite values in {name}: delete it and fit it again")


def check_weights(cfg: DictConfig) -> None:
    """Raise InputError for the first missing model at main_n_demos."""
    for variant, user, seed in product(cfg.variants, cfg.users, cfg.protocol.seeds):
        _check_file(cfg, variant, weights_path(model_dir(cfg, variant), user, seed, cfg.main_n_demos))


def _check_file(cfg: DictConfig, variant: str, path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path} is missing: run stage {cfg.variants[variant].stage} for variant {variant} first")


def predict_all(
    cfg: DictConfig, users: Sequence[str], images: Images, z_theta: Float[Array, "scene path 2"], desc: str
) -> dict[str, Float[Array, "user seed scene path"]]:
    """Return P(valid) of every path [m] in its image by each variant's models of these users at main_n_demos."""

    def predict(model: tuple[str, str]) -> Float[Array, "seed scene path"]:
        models = (load_model(cfg, *model, seed, cfg.main_n_demos) for seed in cfg.protocol.seeds)
        return np.stack([model.probability(images, z_theta) for model in models])

    longest_first = [(variant, user) for variant in reversed(list(cfg.variants)) for user in users]
    p = map_jobs(predict, longest_first, cfg.workers, desc)
    by_model = dict(zip(longest_first, p, strict=True))
    return {variant: np.stack([by_model[variant, user] for user in users]) for variant in cfg.variants}
