"""A training step of `full` at n = 9: every scene encoded once, against a row per (image, trajectory).

Both ways take the same full-batch step on the same loss (tests/spec/test_losses.py holds them equal), on one
thread with the same allocator settings; pytest-benchmark's table gives the ratio in brackets.
"""

import time
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader, TensorDataset

from pipeline.parallel import map_jobs
from pipeline.spec.losses import Weights, equation_1
from pipeline.spec.registry import build
from pipeline.spec.specification import to_tensor
from pipeline.spec.training import Schedule, fit
from pipeline.spec.vae import VaeSpecification

SCENES, N, STEPS = 20, 9, 10
FULL = Weights(alpha=10.0, beta=0.005, gamma=1.0)
RATE = 2e-3


def data():
    """Images, paths and labels of a training set's size; what is in them does not matter to the clock."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (SCENES, 100, 100, 3), dtype=np.uint8)
    return images, rng.uniform(-0.2, 1.2, (SCENES, N, 2)), rng.random((SCENES, N)) < 0.4


def shared_encoding() -> Callable[[], object]:
    """The stage's own loop: `STEPS` steps."""
    model, schedule = _model(), Schedule(STEPS, RATE, 0.01, STEPS)
    images, z_theta, valid = data()
    return lambda: fit(model, images, z_theta, valid, FULL, schedule, seed=0)


def row_by_row() -> Callable[[], object]:
    """The usual loop: a DataLoader hands out rows (image, path, label), an image encoded for every path."""
    model = _model().to(memory_format=torch.contiguous_format)  # pyright: ignore[reportCallIssue]
    images, z_theta, valid = data()
    rows = TensorDataset(
        to_tensor(images).contiguous().repeat_interleave(N, 0),
        torch.from_numpy(z_theta).float().reshape(-1, 1, 2),
        torch.from_numpy(valid).reshape(-1, 1),
    )
    optimiser = torch.optim.AdamW(model.parameters(), lr=RATE)
    loader = DataLoader(rows, batch_size=SCENES * N, shuffle=True)

    def steps() -> None:
        for _ in range(STEPS):
            for x, z, v in loader:
                noise = torch.randn(len(x), model.latent)
                optimiser.zero_grad()
                equation_1(model, x, z, v, FULL, noise).total.backward()
                optimiser.step()

    return steps


WAYS = {"shared_encoding": shared_encoding, "row_by_row": row_by_row}


@pytest.fixture(autouse=True)
def one_thread():
    """One torch thread and the workers' allocator settings, as in the stage."""
    threads = torch.get_num_threads()
    map_jobs(abs, [0], workers=1, desc="settings")
    yield
    torch.set_num_threads(threads)


@pytest.mark.benchmark(group=f"{STEPS} training steps, full, n = {N}")
@pytest.mark.parametrize("way", WAYS)
def test_training_steps(benchmark, way):
    steps = WAYS[way]()
    benchmark.pedantic(steps, rounds=5, warmup_rounds=1)


@pytest.mark.benchmark(group=f"{STEPS} training steps, full, n = {N}: the ratio")
def test_shared_encoding_is_several_times_faster(benchmark):
    fast, slow = shared_encoding(), row_by_row()
    benchmark.pedantic(fast, rounds=5, warmup_rounds=1)
    slow()
    start = time.perf_counter()
    slow()
    ratio = (time.perf_counter() - start) / benchmark.stats.stats.min
    benchmark.extra_info["times_faster"] = round(ratio, 1)
    assert ratio > 5, f"{ratio:.1f} times a row per (image, trajectory): the aim is 10"


def _model() -> VaeSpecification:
    model = build({"kind": "vae"}, seed=0)
    assert isinstance(model, VaeSpecification)
    return model
