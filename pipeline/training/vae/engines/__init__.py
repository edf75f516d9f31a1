"""Two engines that fit the paper's model by the same loss, Eq. 1 (models/vae/losses.py), behind one interface.

autograd (here): torch computes the gradient, of one model after the other on the processor ("reference") or of many at
once on a GPU ("cuda"). simd: the gradient derived by hand, of one model per vector lane of the processor (Numba); tests
hold it against autograd. The models of a batch share the weights of Eq. 1, the number of scenes and the schedule.
Results differ by rounding, which training amplifies (docs/decisions/004-engines.md).
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import nn
from torch.func import functional_call, stack_module_state, vmap

from pipeline.models.base import to_tensor
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Terms, Weights, equation_1
from pipeline.runtime.errors import InputError
from pipeline.training import loop

CURVE = ("step", "reconstruction", "kl", "classification", "total")  # columns of a learning curve
MODELS_ON_GPU = 128  # models per batch: about 4 GB of activations at the paper's model size


class Engine(NamedTuple):
    """An engine with `fit`(models, images, z_theta, valid, weights=, schedule=, seeds=, checkpoints=) -> curves."""

    name: str
    fit: Callable[..., list[Array]]
    batch_size: int  # models per call of `fit`


def engine(name: str) -> Engine:
    """Return an engine; raise InputError if it lacks its GPU."""
    if name == "simd":
        try:
            from pipeline.training.vae.engines.simd import LANES, fit_stack  # compiles on first import
        except ModuleNotFoundError as error:
            need = f"this variant needs {error.name}: pip install 'causal-specifications[pipeline]'"
            raise InputError(need) from error

        return Engine("simd", fit_stack, LANES)
    if name == "reference":
        return Engine(name, fit_batch, 1)
    if not torch.cuda.is_available():
        raise InputError("train.engine=cuda needs a GPU: choose train.engine=simd")
    return Engine("cuda", partial(fit_batch, device="cuda"), MODELS_ON_GPU)


def trainer(variant: Mapping[str, Any], train: Mapping[str, Any]) -> loop.Trainer:
    """Return how a variant of the paper's model (conf/variants) is fitted with the settings of conf/train.yaml."""
    _, fit, batch_size = engine(train["engine"])
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
    z_theta = [m.numbers(torch.tensor(z)).numpy() for m, z in zip(models, z_theta, strict=True)]
    descend = partial(descend, weights, schedule)
    return loop.fit_varied(descend, set_constant, models, images, z_theta, valid, seeds, checkpoints)


def fit_batch(*data, device: str = "cpu", **settings) -> list[Float[Array, "point 5"]]:
    """Train models as `fit_models` by torch's gradient of Eq. 1."""
    return fit_models(partial(_descend, torch.device(device)), *data, **settings)


class _Loss(nn.Module):
    """Eq. 1 as the output of a module, since `functional_call` needs a module."""

    def __init__(self, model: BetaVae, weights: Weights):
        super().__init__()
        self.model, self.weights = model, weights

    def forward(self, images, z_theta, valid, noise, share) -> Terms:
        return equation_1(self.model, images, z_theta, valid, self.weights, noise, share)


@torch.backends.cudnn.flags(enabled=True, deterministic=True, allow_tf32=False)
def _descend(device, weights, schedule, models, images, z_theta, valid, seeds, checkpoints) -> list[Array]:
    """Train all models at once under torch.func.vmap."""

    def stacked(tensors: Iterable[torch.Tensor]) -> torch.Tensor:
        return torch.stack(list(tensors)).to(device, models[0].mean.weight.dtype)  # (model, ...)

    x = stacked([to_tensor(of_model) for of_model in images])
    z, labels = (stacked(map(torch.from_numpy, loop.pad_demonstrations(demos))) for demos in (z_theta, valid))
    share = stacked(torch.from_numpy(loop.row_weights([of_model.shape[1] for of_model in valid])).unbind(1))
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    drawn, buffers = stack_module_state(list(models))
    parameters = {name: value.detach().to(device).requires_grad_() for name, value in drawn.items()}
    fixed = {name: value.to(device) for name, value in buffers.items()}
    named = {f"model.{name}": value for name, value in (parameters | fixed).items()}  # with the names inside `_Loss`
    losses = vmap(partial(functional_call, _Loss(models[0], weights)))

    def loss() -> loop.Losses:
        noise = stacked([torch.randn(x.shape[1], models[0].latent, generator=generator) for generator in generators])
        terms = losses(named, (x, z, labels, noise, share))  # (model,) each
        return terms.total.sum(), [*terms, terms.total]

    hand_over = partial(loop.unstack_models, parameters, models)
    curve = loop.minimise(loss, parameters.values(), schedule, partial(checkpoints.keep, models, hand_over))
    hand_over()
    return list(curve.transpose(2, 0, 1))
