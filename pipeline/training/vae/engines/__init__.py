"""Two engines that fit the paper's model by the same loss, Eq. 1 (models/vae/losses.py), behind one interface.

autograd: torch computes the gradient, of one model after the other on the processor ("reference") or of many at once on
a GPU ("cuda"). simd: the gradient derived by hand, of one model per vector lane of the processor (Numba); tests hold it
against autograd. Results differ by rounding, which training amplifies (docs/decisions/004-engines.md).
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch

from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.runtime.errors import InputError
from pipeline.training.loop import Checkpoints, Schedule, is_constant, rule_of_succession
from pipeline.training.sets import Fit, Trainer

NAMES = ("auto", "simd", "cuda", "reference")
CURVE = ("step", "reconstruction", "kl", "classification", "total")  # columns of a learning curve
MODELS_ON_GPU = 128  # models per batch: about 4 GB of activations at the paper's model size


class Engine(NamedTuple):
    """An engine with `fit`(models, images, z_theta, valid, weights=, schedule=, seeds=, checkpoints=) -> curves."""

    name: str
    fit: Fit
    batch_size: int  # models per call of `fit`


def engine(name: str) -> Engine:
    """Return the engine called `name`, for stages, studies and `pipeline.fit`; `auto`: cuda with a GPU, else simd.

    Raises InputError for an unknown name, and for cuda without a GPU.
    """
    if name not in NAMES:
        raise InputError(f"engine {name!r}: expected one of {', '.join(NAMES)} (train.engine)")
    gpu = torch.cuda.is_available()
    if name == "cuda" and not gpu:
        raise InputError("train.engine=cuda needs a GPU: choose train.engine=auto")
    if name == "simd" or (name == "auto" and not gpu):
        from pipeline.training.vae.engines.simd import LANES, fit_stack  # compiles on first import

        return Engine("simd", fit_stack, LANES)
    from pipeline.training.vae.engines.autograd import fit_batch

    if name == "reference":
        return Engine("reference", partial(fit_batch, device="cpu"), 1)
    return Engine("cuda", partial(fit_batch, device="cuda"), MODELS_ON_GPU)


def trainer(variant: Mapping[str, Any], train: Mapping[str, Any]) -> Trainer:
    """Return how a variant of the paper's model (conf/variants) is fitted with the settings of conf/train.yaml."""
    weights = Weights(*(float(variant[name]) for name in ("alpha", "beta", "gamma")))
    chosen = engine(train["engine"])
    return Trainer(BetaVae, partial(chosen.fit, weights=weights, schedule=Schedule.of(train)), CURVE, chosen.batch_size)


def fit_varied(
    descend: Callable[..., list[np.ndarray]], models, images, z_theta, valid, weights, schedule, seeds, checkpoints
) -> list[np.ndarray]:
    """Standardise each model, fit those with varying labels by one call of `descend`; return all curves in order.

    If all labels are equal, the encoder stays untrained and the classifier answers Laplace's probability everywhere.
    """
    curves: dict[int, np.ndarray] = {}
    for i, (model, scenes, labels) in enumerate(zip(models, images, valid, strict=True)):
        model.standardise(scenes)
        if is_constant(labels):
            probability = rule_of_succession(labels)
            model.set_constant_head(probability)
            loss = weights.gamma * -np.log(max(probability, 1 - probability))
            curves[i] = np.array([[0, 0, 0, loss, loss]])
    if varied := [i for i in range(len(models)) if i not in curves]:
        data = ([values[i] for i in varied] for values in (models, images, z_theta, valid))
        own_seeds = [seeds[i] for i in varied]
        curves |= zip(varied, descend(*data, weights, schedule, own_seeds, checkpoints or Checkpoints()), strict=True)
    for model in models:
        model.eval()
    return [curves[i] for i in range(len(models))]
