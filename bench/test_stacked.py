"""A training step of eight models in the processor's lanes, against eight steps of the reference, at n = 9.

One thread, same data and same process. `extra_info` gives milliseconds a model, GFLOP/s and the share of what this
core can multiply and add, which is measured beside it: a shared machine is not always the same.
"""

import time
from collections.abc import Callable

import numpy as np
import pytest
import torch
from numba import njit

from bench.test_train import SCENES, N, data
from pipeline.parallel import map_jobs
from pipeline.spec.lanes import LANES, _add, outer, zeros
from pipeline.spec.losses import Weights
from pipeline.spec.registry import build
from pipeline.spec.stacked import Convolution, Stack, allocate
from pipeline.spec.training import Schedule, fit
from pipeline.spec.vae import VaeSpecification

VARIANTS = {"full": Weights(10.0, 0.005, 1.0), "classifier": Weights(0.0, 0.0, 1.0)}
ROUNDS = 10


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_step_of_eight_models(benchmark, variant, capsys):
    threads = torch.get_num_threads()
    map_jobs(abs, [0], workers=1, desc="settings")  # one thread, the workers' allocator
    models = [_model(seed) for seed in range(LANES)]
    images, z_theta, valid = (np.stack([array] * LANES, -1) for array in data())
    noise = np.random.default_rng(0).standard_normal((SCENES, models[0].latent, LANES)).astype(np.float32)
    stack = Stack(models, VARIANTS[variant], N)
    arguments = images, z_theta.astype(np.float32), valid, noise
    benchmark.pedantic(stack.gradient, arguments, rounds=ROUNDS, warmup_rounds=1)
    own = benchmark.stats.stats.min / LANES
    schedule = Schedule(ROUNDS, 2e-3, 0.01, ROUNDS)
    theirs = _fastest(lambda: fit(_model(0), *data(), VARIANTS[variant], schedule, seed=0), 3) / ROUNDS
    rate, peak = _operations(stack) / own, _peak()
    torch.set_num_threads(threads)
    benchmark.extra_info |= {"ms a model": round(own * 1e3, 2), "reference ms": round(theirs * 1e3, 2)}
    benchmark.extra_info |= {"GFLOP/s": round(rate / 1e9, 1), "of peak": round(rate / peak, 2)}
    with capsys.disabled():
        print(f"\n{variant}: {benchmark.extra_info}, peak {peak / 1e9:.0f} GFLOP/s")
    assert theirs / own > 2


def _operations(stack: Stack) -> float:
    """Multiplications and additions of one model's gradient."""
    count = 0
    for layer in stack.layers.values():
        weights = layer.weight.value[..., 0].size
        if isinstance(layer, Convolution):
            side = layer.small.shape[1] - 2
            count += weights * side**2 * (2 if layer.back is None else 3)
        else:
            count += weights * len(layer.x) * 3
    return 2 * SCENES * count


@njit
def _multiply_and_add(times, x, y):
    tile = zeros(5, 4)  # pyright: ignore[reportCallIssue]
    for _ in range(times):
        tile = outer(tile, x, 0, 0, x, 0, 0)
    _add(tile, y, 0, 4)


def _peak() -> float:
    """Operations a second of one core that does nothing but multiply and add in registers."""
    x, y, times = allocate(1).reshape(-1), allocate(20).reshape(-1), 1_000_000
    return 2 * 20 * LANES * times / _fastest(lambda: _multiply_and_add(times, x, y), 20)


def _fastest(action: Callable[[], object], rounds: int) -> float:
    """Seconds of the fastest of some rounds after one to warm up."""
    seconds = []
    for _ in range(rounds + 1):
        start = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])


def _model(seed: int) -> VaeSpecification:
    model = build({"kind": "vae"}, seed)
    assert isinstance(model, VaeSpecification)
    return model
