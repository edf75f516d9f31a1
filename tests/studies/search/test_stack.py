"""Models that share a stack have settings of their own, and the gradient of Eq. 1 with their own weights."""

import numpy as np
import torch
from torch import nn
from torch.optim import AdamW
from torch.optim.lr_scheduler import OneCycleLR

from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import Weights, equation_1
from pipeline.training.irl.augment import ColorJitter
from pipeline.training.loop import Schedule
from pipeline.training.refit import TrainingSet
from pipeline.training.vae.engines.simd import fit_stack
from pipeline.training.vae.engines.simd_kernels import LANES
from studies.search.stack import LaneAdamW, LaneSetting, SettingsStack, fit_settings
from tests.factories import vae

JITTER = ColorJitter(hue=0.3, gain=0.15, shift=0.01, scene_gain=0.1, other_table=0.67)
SHORT = Schedule(steps=3, rate=1.0, weight_decay=0.0, curve_every=1, adam_beta2=0.99)
SCENES, N = 4, 5


class Masked(nn.Module):
    """Multiplies by a fixed mask."""

    def __init__(self, mask: torch.Tensor):
        super().__init__()
        self.mask = mask

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x * self.mask


def setting(beta: float = 0.002, gamma: float = 6.0, rate: float = 0.01, decay: float = 0.01, **more) -> LaneSetting:
    return LaneSetting(Weights(100.0, beta, gamma), rate, decay, **{"dropout": 0.0, **no_augmentation(), **more})


def no_augmentation() -> dict[str, bool]:
    return {"jitter": False, "symmetries": False}


def training_set(seed: int) -> TrainingSet:
    rng = np.random.default_rng(seed)
    valid = rng.random((SCENES, N)) < 0.5
    valid.flat[:2] = False, True
    images = rng.integers(0, 128, (SCENES, 100, 100, 3), dtype=np.uint8)
    return TrainingSet("careful", seed, images, rng.uniform(-0.2, 1.2, (SCENES, N, 2)), valid)


def fitted(settings: list[LaneSetting], scenes_per_step: int = SCENES, schedule: Schedule = SHORT) -> list[BetaVae]:
    models = [vae(seed) for seed in range(len(settings))]
    sets, seeds = [training_set(seed) for seed in range(len(settings))], list(range(len(settings)))
    fit_settings(models, sets, settings, seeds, schedule, scenes_per_step, JITTER, 3, root_seed=1)
    return models


def test_each_lane_has_the_gradient_of_its_own_weights_and_dropout():
    settings = [setting(10.0**-lane, 3.0**lane, dropout=0.5 * (lane % 2)) for lane in range(LANES)]
    models, sets = [vae(seed) for seed in range(LANES)], [training_set(seed) for seed in range(LANES)]
    stack = SettingsStack(models, settings, N, SCENES)
    rng = np.random.default_rng(0)
    stack.masks = [2 * (rng.random((SCENES, *drop.y.shape)) < 0.5).astype(np.float32) for drop in stack.drops]
    images, z, valid = (np.stack([getattr(x, name) for x in sets], -1) for name in ("images", "z_theta", "valid"))
    noise = rng.normal(size=(SCENES, models[0].latent, LANES)).astype(np.float32)
    stack.gradient(images, ((z - Z_CENTRE) / Z_SCALE).astype(np.float32), valid, noise)
    gradients = dict(stack.tensors("gradient"))
    for lane, (model, x) in enumerate(zip(models, sets, strict=True)):
        names = {id(parameter): name for name, parameter in model.named_parameters()}
        masks = [Masked(torch.from_numpy(mask[..., lane])) for mask in stack.masks]
        first, relu, second, _, last = model.classifier
        model.classifier = nn.Sequential(first, relu, masks[0], second, relu, masks[1], last)
        data = torch.from_numpy(x.images).permute(0, 3, 1, 2) / 255, torch.from_numpy(x.z_theta).float()
        terms = equation_1(
            model, *data, torch.from_numpy(x.valid), settings[lane].weights, torch.from_numpy(noise[..., lane])
        )
        terms.total.backward()
        for parameter in model.parameters():
            ours, torchs = gradients[names[id(parameter)]][..., lane].reshape(parameter.shape), parameter.grad
            assert torchs is not None
            np.testing.assert_allclose(
                ours, torchs, atol=2e-4 * float(torchs.abs().max()), err_msg=names[id(parameter)]
            )


def test_the_default_setting_is_fitted_as_the_engine_fits_it():
    (ours,), theirs, x = fitted([setting()]), vae(0), training_set(0)
    schedule = Schedule(3, 0.01, 0.01, 1, adam_beta2=0.99)
    fit_stack([theirs], [x.images], [x.z_theta], [x.valid], Weights(100.0, 0.002, 6.0), schedule, [0])
    np.testing.assert_allclose(
        ours.probability(x.images, x.z_theta), theirs.probability(x.images, x.z_theta), atol=1e-4
    )
    assert np.abs(ours.probability(x.images, x.z_theta) - vae(0).probability(x.images, x.z_theta)).max() > 1e-3


def test_a_model_does_not_depend_on_its_neighbours_settings():
    one = setting(0.1, 20.0, dropout=0.3, jitter=True)
    other = setting(3.0, 0.5, 0.003, 0.5, symmetries=True)
    alone, beside = fitted([one], scenes_per_step=2)[0], fitted([one, other], scenes_per_step=2)[0]
    for name, value in alone.state_dict().items():
        np.testing.assert_array_equal(value, beside.state_dict()[name], err_msg=name)


def test_adamw_by_lane_is_torch_s_adamw_in_each_lane():
    rng = torch.Generator().manual_seed(0)
    rates, decays = torch.tensor([0.01, 0.1]), torch.tensor([0.5, 0.0])
    start, gradients = torch.randn(7, 2, generator=rng), torch.randn(20, 7, 2, generator=rng)
    stacked = nn.Parameter(start.clone())
    alone = [nn.Parameter(start[:, lane].clone()) for lane in range(2)]
    optimisers = [LaneAdamW([stacked], rates, decays, (0.9, 0.99))]
    optimisers += [
        AdamW([p], lr=float(r), weight_decay=float(d), betas=(0.9, 0.99))
        for p, r, d in zip(alone, rates, decays, strict=True)
    ]
    schedules = [OneCycleLR(o, m, total_steps=20) for o, m in zip(optimisers, [1.0, 0.01, 0.1], strict=True)]
    for gradient in gradients:
        stacked.grad = gradient.clone()
        for lane, parameter in enumerate(alone):
            parameter.grad = gradient[:, lane].clone()
        for part in [*optimisers, *schedules]:
            part.step()
    np.testing.assert_allclose(stacked.detach(), torch.stack([p.detach() for p in alone], -1), rtol=1e-5, atol=1e-6)
