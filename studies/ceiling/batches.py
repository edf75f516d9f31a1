"""Fit models by Eq. 1 with a batch of scenes a step, for training sets too large for full-batch steps.

A batch as large as the training set gives the full-batch steps of stage train, with scenes in another order.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.training.loop import Losses, Schedule, minimise
from pipeline.training.vae.engines.simd import LANES, Stack


def batches(rng: np.random.Generator, count: int, size: int) -> Iterator[Int[Array, " index"]]:
    """Yield batches of `size` of `count` indices without end, each at most once a pass; the remainder is left out."""
    size = min(size, count)
    while True:
        yield from rng.permutation(count)[: count - count % size].reshape(-1, size)


def fit_stack(
    models: Sequence[BetaVae],
    images: Sequence[UInt8[Array, "scene 100 100 3"]],
    z_theta: Sequence[Float[Array, "scene n 2"]],
    valid: Sequence[Bool[Array, "scene n"]],
    weights: Weights,
    schedule: Schedule,
    seeds: Sequence[int],
    batch: int,
    rng: np.random.Generator,
) -> Float[Array, "point 5 lane"]:
    """Train up to `LANES` models in place on as many paths [m] in as many scenes; return their learning curves.

    All models see the same numbers of scenes in each batch. Labels must vary. `seeds` draw the latent noise.
    """
    for model, of_model in zip(models, images, strict=True):
        model.standardise(of_model)
    lane_models = [*range(len(models)), *[0] * (LANES - len(models))]  # unused lanes repeat the first model
    pixels, paths, labels = (np.stack([data[i] for i in lane_models], -1) for data in (images, z_theta, valid))
    paths = (paths.astype(np.float32) - Z_CENTRE) / Z_SCALE
    chosen, size = batches(rng, len(pixels), batch), min(batch, len(pixels))
    stack = Stack([models[i] for i in lane_models], weights, [labels.shape[1]] * LANES, size)
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]

    def loss() -> Losses:
        scenes = next(chosen)
        noise = [torch.randn(size, models[0].latent, generator=generator).numpy() for generator in generators]
        noise = np.stack([noise[i] for i in lane_models], -1)
        terms = stack.gradient(pixels[scenes], paths[scenes], labels[scenes], noise)
        return None, list(torch.from_numpy(np.vstack([terms, terms.sum(0)])))

    curve = minimise(loss, [parameter.tensor for parameter in stack.parameters()], schedule)
    stack.hand_over(models)
    return curve[..., : len(models)]
