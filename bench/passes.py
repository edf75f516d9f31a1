"""Time and memory of one gradient step over a training set, implemented in three ways.

rows: the usual loop, with a DataLoader of rows (image, trajectory), one encoding per path, and eager torch.
eager: the autograd engine, with each scene encoded once, channels-last memory and fused AdamW.
stacked: the simd engine, with LANES models at once.
All make the same full-batch step on the same loss, including the optimiser, on one thread (tests/training check this).
"""

import multiprocessing
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numba import njit
from torch.utils.data import DataLoader, TensorDataset

from pipeline.models.base import to_tensor
from pipeline.models.trained import build
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights, equation_1
from pipeline.runtime.parallel import one_thread
from pipeline.training.loop import Schedule
from pipeline.training.vae.engines import fit_batch
from pipeline.training.vae.engines.simd import Convolution, Stack, allocate, fit_stack
from pipeline.training.vae.engines.simd_kernels import LANES, _add, outer, zeros

SCENES, N_DEMOS = 20, 9  # training scenes; demonstrations per scene
STEPS = 40  # steps per call: fixed costs before the first step are spread over them, as in the stages
VARIANTS = {"full": Weights(alpha=10.0, beta=0.005, gamma=1.0), "classifier": Weights(alpha=0.0, beta=0.0, gamma=1.0)}
SCHEDULE = Schedule(steps=STEPS, rate=2e-3, weight_decay=0.01, curve_every=STEPS)
GIB = 2**30  # bytes


def training_set(scenes: int = SCENES, n_demos: int = N_DEMOS):
    """Draw images, paths [m] and labels; their content does not affect the timing."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (scenes, 100, 100, 3), dtype=np.uint8)
    z_theta = rng.uniform(-0.2, 1.2, (scenes, n_demos, 2))
    return images, z_theta, np.arange(scenes * n_demos).reshape(scenes, n_demos) % 2 == 0


def untrained(seed: int = 0) -> BetaVae:
    model = build({"kind": "vae", "model": {}}, seed)
    assert isinstance(model, BetaVae)
    return model


def rows(weights: Weights, scenes: int = SCENES, n_demos: int = N_DEMOS) -> Callable[[], None]:
    """Return a function that makes one step of one model."""
    model = untrained().to(memory_format=torch.contiguous_format)  # pyright: ignore[reportCallIssue]
    images, z_theta, valid = training_set(scenes, n_demos)
    table = TensorDataset(
        to_tensor(images).contiguous().repeat_interleave(n_demos, 0),
        torch.from_numpy(z_theta).float().reshape(-1, 1, 2),
        torch.from_numpy(valid).reshape(-1, 1),
    )
    optimiser = torch.optim.AdamW(model.parameters(), lr=SCHEDULE.rate)
    loader = DataLoader(table, batch_size=scenes * n_demos, shuffle=True)

    def one_pass() -> None:
        for x, z, v in loader:
            noise = torch.randn(len(x), model.latent)
            optimiser.zero_grad()
            equation_1(model, x, z, v, weights, noise).total.backward()
            optimiser.step()

    return one_pass


def eager(weights: Weights, scenes: int = SCENES, n_demos: int = N_DEMOS) -> Callable[[], object]:
    """Return a function that makes STEPS steps of one model."""
    model, (images, z_theta, valid) = untrained(), training_set(scenes, n_demos)
    return lambda: fit_batch([model], [images], [z_theta], [valid], weights, SCHEDULE, seeds=[0])


def stacked(
    weights: Weights, scenes: int = SCENES, n_demos: int = N_DEMOS, models: int = LANES
) -> Callable[[], object]:
    """Return a function that makes STEPS steps of several models."""
    stack = [untrained(seed) for seed in range(models)]
    data = training_set(scenes, n_demos)

    def fit_all() -> None:
        for start in range(0, models, LANES):
            some = stack[start : start + LANES]
            arrays = ([array] * len(some) for array in data)
            fit_stack(some, *arrays, weights=weights, schedule=SCHEDULE, seeds=range(len(some)))

    return fit_all


WAYS: dict[str, tuple[Callable[..., Callable[[], object]], int]] = {  # way -> (function, steps per call)
    "rows": (rows, 1), "eager": (eager, STEPS), "stacked": (stacked, STEPS * LANES),
}  # fmt: skip


def fastest(action: Callable[[], object], rounds: int) -> float:
    """Return the duration [s] of the fastest of several rounds, after one warm-up round."""
    seconds = []
    for _ in range(rounds + 1):
        start = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])


def operations(weights: Weights) -> int:
    """Return the number of multiplications and additions of one step, summed over layers, without the optimiser."""
    stack, count = Stack([untrained()] * LANES, weights, [N_DEMOS] * LANES, SCENES), 0
    for layer in stack.layers.values():
        size = layer.weight.value[..., 0].size
        if isinstance(layer, Convolution):
            count += size * (len(layer.small) - 2) ** 2 * (2 if layer.back is None else 3)
        else:
            count += size * len(layer.x) * 3
    return 2 * SCENES * count


@njit
def _multiply_and_add(times, x, y):
    tile = zeros(3, 4)  # pyright: ignore[reportCallIssue]  # 12 sums hide the latency, and fit 16 registers
    for _ in range(times):
        tile = outer(tile, x, 0, 0, x, 0, 0)
    _add(tile, y, 0, 4)


def peak() -> float:
    """Return the operations per second of one core that only multiplies and adds in its widest vector registers."""
    x, y, times = allocate(1).reshape(-1), allocate(12).reshape(-1), 1_000_000
    return 2 * 12 * LANES * times / fastest(lambda: _multiply_and_add(times, x, y), 20)


def memory(way: str, variant: str) -> float:
    """Return the memory [GiB] that a new process allocates for training this way (models, data and activations)."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_growth, (way, variant))


def _growth(way: str, variant: str) -> float:
    one_thread()
    before = _high_water()
    WAYS[way][0](VARIANTS[variant])()
    return (_high_water() - before) / GIB


def _high_water() -> int:
    """Return the peak memory [bytes] of this process; getrusage would count the parent's before the fork."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) * 1024
