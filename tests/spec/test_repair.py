"""Gradient repair climbs specifications whose shape is known."""

import numpy as np
import pytest
import torch
from torch import Tensor

from pipeline.spec.repair import OPTIMISERS, Ascent, repair
from pipeline.spec.specification import Specification
from pipeline.table.bezier import Z_HIGH, Z_LOW, random_z_theta

IMAGES = np.zeros((3, 100, 100, 3), dtype=np.uint8)
STARTS = random_z_theta(np.random.default_rng(0), 3, 20)
RATES = {"gradient": 0.02, "normalised": 0.05, "adam": 0.05}


class Hill(Specification):
    """Concave log-odds: 4 at a peak, falling with the squared distance."""

    def __init__(self, peak: tuple[float, float] = (0.3, 0.8)):
        super().__init__()
        self.peak = torch.tensor(peak)

    def perceive(self, images: Tensor) -> Tensor:
        return torch.zeros(len(images), 1)

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return 4 - 16 * ((z_theta - self.peak) ** 2).sum(-1)


class Plain(Hill):
    """Flat log-odds: the gradient is zero everywhere, though the path is looked at."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return -1 + 0 * z_theta.sum(-1)


class Blind(Hill):
    """Log-odds that do not depend on the path at all."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return torch.full(z_theta.shape[:-1], -1.0)


class Wall(Hill):
    """A peak out of reach: the log-odds grow with x for ever."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return z_theta[..., 0] * 10


@pytest.mark.parametrize("optimiser", OPTIMISERS)
@pytest.mark.parametrize("settle", [False, True])
def test_no_start_out_of_a_steps_reach_of_the_peak_ends_less_valid(optimiser: str, settle: bool):
    done = repair(Hill(), IMAGES, STARTS, Ascent(30, optimiser, RATES[optimiser], settle))
    far = np.linalg.norm(STARTS - [0.3, 0.8], axis=-1) > 0.1
    assert (done.p[..., -1] > done.p[..., 0])[far].all()
    assert (done.p[..., -1] > 0.5).all()


def test_plain_steps_climb_a_concave_hill_at_every_step():
    done = repair(Hill(), IMAGES, STARTS, Ascent(30, "gradient", 0.02, False))
    assert (np.diff(done.p, axis=-1) >= -1e-6).all()


@pytest.mark.parametrize(("settle", "pace"), [(False, [1, 1, 1, 1, 1]), (True, [1, 0.8, 0.6, 0.4, 0.2])])
def test_normalised_steps_have_the_length_asked_for(settle: bool, pace: list[float]):
    done = repair(Hill(), IMAGES, STARTS, Ascent(5, "normalised", 0.01, settle))
    lengths = np.linalg.norm(np.diff(done.z, axis=2), axis=-1)[(np.abs(done.z - 0.5) < 0.68).all((-2, -1))]
    np.testing.assert_allclose(lengths, np.broadcast_to(0.01 * np.array(pace), lengths.shape), atol=1e-5)


@pytest.mark.parametrize("optimiser", OPTIMISERS)
@pytest.mark.parametrize("model", [Plain(), Blind()])
def test_without_a_gradient_a_path_stays_where_it_is(optimiser: str, model: Specification):
    done = repair(model, IMAGES, STARTS, Ascent(30, optimiser, RATES[optimiser], False))
    np.testing.assert_array_equal(done.z, np.repeat(STARTS[:, :, None].astype(np.float32), 31, axis=2))


@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_paths_never_leave_the_square_of_z_theta(optimiser: str):
    done = repair(Wall(), IMAGES, STARTS, Ascent(30, optimiser, 0.1, False))
    assert done.z.min() >= np.float32(Z_LOW) and done.z.max() <= np.float32(Z_HIGH)
    np.testing.assert_allclose(done.z[..., -1, 0], Z_HIGH)


@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_a_start_is_repaired_alike_alone_and_among_others(optimiser: str):
    ascent = Ascent(10, optimiser, RATES[optimiser], False)
    together = repair(Hill(), IMAGES, STARTS, ascent)
    alone = repair(Hill(), IMAGES[:1], STARTS[:1, 3:4], ascent)
    np.testing.assert_allclose(alone.z[0, 0], together.z[0, 3], atol=1e-6)


def test_settings_that_make_no_ascent_are_refused():
    with pytest.raises(ValueError, match="expected one of gradient, normalised, adam"):
        Ascent(30, "newton", 0.1, False)
    with pytest.raises(ValueError, match="must be positive"):
        Ascent(30, "adam", 0.0, False)
