"""Two engines that fit the paper's model by the same loss, Eq. 1 (models/vae/losses.py), behind one interface.

"reference" (here): torch computes the gradient, of one model after the other. "simd": the gradient derived by hand, of
one model per vector lane of the processor (Numba); tests hold it against torch's. The models of a batch share the
weights of Eq. 1, the number of scenes and the schedule. Results differ by rounding, which training amplifies
(docs/decisions/004-engines.md).
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.models.base import to_tensor
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights, equation_1
from pipeline.runtime.errors import InputError
from pipeline.training import loop

CURVE = ("step", "reconstruction", "kl", "classification", "total")  # columns of a learning curve


def trainer(variant: Mapping[str, Any], train: Mapping[str, Any]) -> loop.Trainer:
    """Return how a variant of the paper's model (conf/variants) is fitted with the settings of conf/train.yaml.

    Raises InputError if the engine lacks a package.
    """
    fit, batch_size = fit_by_autograd, 1
    if train["engine"] != "reference":
        try:
            from pipeline.training.vae.engines.simd import LANES, fit_stack  # compiles on first import
        except ModuleNotFoundError as error:
            need = f"this variant needs {error.name}: pip install 'causal-specifications[pipeline]'"
            raise InputError(need) from error
        fit, batch_size = fit_stack, LANES
    fit = partial(fit, weights=Weights.of(variant), schedule=loop.Schedule.of(train))
    return loop.Trainer(BetaVae, fit, CURVE, batch_size)


def fit_models(descend, models, images, z_theta, valid, weights, schedule, seeds, checkpoints=None) -> list[Array]:
    """Standardise models and train them in place by `descend`; return their learning curves (point, `CURVE`).

    Arguments as in `loop.fit_varied`. `seeds` draw the latent noise on the processor; torch's global generator is
    unchanged.
    """

    def set_constant(model: BetaVae, probability: float) -> tuple[float, float, float, float]:
        model.set_constant_head(probability)
        loss = weights.gamma * -np.log(max(probability, 1 - probability))
        return 0.0, 0.0, loss, loss

    for model, scenes in zip(models, images, strict=True):
        model.standardise(scenes)
    z_theta = [m.numbers(torch.from_numpy(z)).numpy() for m, z in zip(models, z_theta, strict=True)]
    descend = partial(descend, weights, schedule)
    return loop.fit_varied(descend, set_constant, models, images, z_theta, valid, seeds, checkpoints)


def fit_by_autograd(*data, **settings) -> list[Float[Array, "point 5"]]:
    """Train models as `fit_models` by torch's gradient of Eq. 1."""
    return fit_models(_descend, *data, **settings)


def _descend(weights, schedule, models, images, z_theta, valid, seeds, checkpoints) -> list[Array]:
    """Train one model after the other."""

    def fit(model: BetaVae, scenes: Array, paths: Array, labels: Array, seed: int) -> Float[Array, "point 5"]:
        x = to_tensor(scenes).to(model.mean.weight)
        z, valid, noise = torch.from_numpy(paths).to(x), torch.from_numpy(labels), torch.Generator().manual_seed(seed)

        def loss() -> loop.Losses:
            drawn = torch.randn(len(x), model.latent, generator=noise).to(x)
            terms = equation_1(model, x, z, valid, weights, drawn)
            return terms.total, [*terms, terms.total]

        return loop.minimise(loss, model.parameters(), schedule, partial(checkpoints.keep, [model], lambda: None))

    return [fit(*own) for own in zip(models, images, z_theta, valid, seeds, strict=True)]
