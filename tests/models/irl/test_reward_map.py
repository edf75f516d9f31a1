"""Facts about the reward map: returns are line averages, the partition is a sum, symmetries and constants cancel."""

import numpy as np
import torch

from pipeline.models.base import to_tensor
from pipeline.models.irl import reward_map
from pipeline.models.irl.reward_map import SYMMETRIES, RewardMap, contrast, path_return, path_weights, transform, turned
from pipeline.perception.background import subtract_background
from pipeline.world.bezier import curve, lattice
from tests.factories import reward_model


def drawn() -> RewardMap:
    """An untrained model in float64."""
    return reward_model(0, dropout=0.0, lattice_side=12).double()


def maps(scenes: int = 2) -> torch.Tensor:
    return torch.randn(scenes, 50, 50, generator=torch.Generator().manual_seed(3), dtype=torch.float64)


def paths(scenes: int = 2, count: int = 6) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(5).uniform(-0.2, 1.2, (scenes, count, 2)))


def tables(scenes: int = 2) -> np.ndarray:
    """Brown tables under uneven light with a blue disc each."""
    y, x = np.mgrid[0:100, 0:100]
    rng = np.random.default_rng(1)
    light = 0.8 + 0.002 * x[None, :, :, None] * rng.uniform(0.5, 1, (scenes, 1, 1, 1))
    image = np.broadcast_to(light * np.array([150.0, 110, 80]), (scenes, 100, 100, 3)).copy()
    image[:, (x - 40) ** 2 + (y - 70) ** 2 < 64] = (60, 80, 200)
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def test_returns_are_means_along_the_path_and_the_matrix_of_path_weights_gives_the_same():
    z = paths(1)
    torch.testing.assert_close(path_return(torch.full_like(maps(1), 2.5), z), torch.full_like(z[..., 0], 2.5))
    rows = torch.linspace(0.99, 0.01, 50, dtype=torch.float64)  # y of the rows' centres, the far edge first
    height = path_return(rows[None, :, None].expand(1, 50, 50), z)
    np.testing.assert_allclose(height, curve(z.numpy(), 48)[..., 1].mean(-1), rtol=1e-9)
    torch.testing.assert_close(maps(1).flatten(1) @ path_weights(z[0], 50).T, path_return(maps(1), z))


def test_probabilities_of_the_lattice_add_up_to_one_and_a_constant_reward_is_not_seen():
    model, reward = drawn(), maps()
    z = torch.from_numpy(lattice(12)).expand(2, -1, 2)
    model.paths = path_weights(z[0], 50)  # in float64 from the start
    p = model.advantage(reward, z).exp() / len(z[0])
    torch.testing.assert_close(p.sum(-1), torch.ones(2, dtype=torch.float64))
    torch.testing.assert_close(model.advantage(reward + 7.0, paths()), model.advantage(reward, paths()))


def test_every_symmetry_is_undone_and_a_turned_image_gives_the_turned_map():
    model = drawn()
    seen = contrast(*subtract_background(to_tensor(tables()))).double()
    cells = model.perceive_turned(turned(seen))[:, :-1].unflatten(1, (50, 50))
    for symmetry in range(SYMMETRIES):
        torch.testing.assert_close(reward_map.untransform(transform(maps(), symmetry), symmetry), maps())
        other = model.perceive_turned(turned(transform(seen, symmetry)))[:, :-1].unflatten(1, (50, 50))
        torch.testing.assert_close(reward_map.untransform(other, symmetry), cells)


def test_the_logit_of_the_percept_is_scaled_advantage_and_its_gradient_is_right():
    model = drawn()
    model.scale.fill_(2.0)
    model.offset.fill_(0.5)
    percept = model.perceive_turned(turned(contrast(*subtract_background(to_tensor(tables()))).double())).detach()
    z = paths().requires_grad_()
    reward = percept[:, :-1].unflatten(1, (50, 50))
    torch.testing.assert_close(model.logit(percept, z), 2 * model.advantage(reward, z) + 0.5)
    assert torch.autograd.gradcheck(lambda p: model.logit(percept, p), (z,), eps=1e-8, atol=1e-4)
