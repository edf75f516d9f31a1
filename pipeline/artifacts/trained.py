"""Trained models of any kind, as the stages that ask them read them, and their answers to given pictures and paths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from safetensors import SafetensorError
from safetensors.torch import load_file

from pipeline.artifacts.models import model_dir, weights_path
from pipeline.models.base import ValidityModel
from pipeline.models.registry import build
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs


def load_model(cfg: DictConfig, variant: str, user: str, seed: int, n: int, step: int | None = None) -> ValidityModel:
    """A trained model, or as it was before `step` of its training, in eval mode.

    InputError if its weights are missing, damaged or of another shape.
    """
    path = weights_path(model_dir(cfg, variant), user, seed, n, step)
    if not path.is_file():
        raise InputError(f"{path} is missing: run `make repro` (or the stage that fits {variant}) first")
    model = build(cfg.variants[variant])
    try:
        model.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise InputError(f"{path} is not a {variant} model ({error}): delete it and fit it again") from error
    return model.eval()


def check_weights(cfg: DictConfig) -> None:
    """Raise InputError for the first model at main_n_demos that is missing, before any is asked."""
    for variant in cfg.variants:
        for user in cfg.users:
            for seed in cfg.protocol.seeds:
                path = weights_path(model_dir(cfg, variant), user, seed, cfg.main_n_demos)
                if not path.is_file():
                    stage = cfg.variants[variant].stage
                    raise InputError(f"{path} is missing: run stage {stage} for variant {variant} first")


@dataclass(frozen=True)
class _Question:
    cfg: DictConfig
    variant: str
    user: str
    images: Array
    z_theta: Array


def predict_all(
    cfg: DictConfig,
    users: Sequence[str],
    images: UInt8[Array, "picture 100 100 3"],
    z_theta: Float[Array, "picture path 2"],
    desc: str,
) -> dict[str, Float[Array, "user seed picture path"]]:
    """P(valid) of every path [m] in its picture, by every variant's models of these users at main_n_demos, every seed."""
    variants = list(cfg.variants)[::-1]  # those that take longest first, so that no process waits for another's last
    questions = [_Question(cfg, variant, user, images, z_theta) for variant in variants for user in users]
    answers = map_jobs(_answer, questions, cfg.workers, desc)
    found = {v: np.stack(answers[i * len(users) : (i + 1) * len(users)]) for i, v in enumerate(variants)}
    return {v: found[v] for v in cfg.variants}


def _answer(q: _Question) -> Float[Array, "seed picture path"]:
    seeds = q.cfg.protocol.seeds
    models = (load_model(q.cfg, q.variant, q.user, seed, q.cfg.main_n_demos) for seed in seeds)
    return np.stack([model.probability(q.images, q.z_theta) for model in models])
